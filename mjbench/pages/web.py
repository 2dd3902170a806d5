"""Reports of WebAssembly builds: agreement with C, speed, start-up, memory."""

from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import describe_options
from mjbench.pages.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.report import web
from mjbench.status import Status
from mjbench.web.records import WebPath, WebRecord

_MIB = 1 << 20


def sections(records: Sequence[WebRecord], command: str) -> Iterator[Section]:
    """Yield a section for each model."""
    for record in records:
        yield _section(record, command)


def _section(record: WebRecord, command: str) -> Section:
    is_good = all(status in (Status.OK, Status.UNAVAILABLE) for status in record.statuses())
    conclusion = web.conclusion(record)
    return Section(
        heading=f"{record.model} in WebAssembly",
        command=command,
        conclusions=[Conclusion(conclusion) if is_good else Conclusion(conclusion, Tone.BAD)],
        tables=[_table(record)] if record.paths else [],
        notes=web.notes(record),
    )


def _table(record: WebRecord) -> DataTable:
    columns = (
        Column("path"),
        Column("options"),
        Column("status"),
        Column("ns/step", 4),
        Column("× C", 3),
        Column("low", 3),
        Column("high", 3),
        Column("difference", 2),
        Column("heap MiB", 3),
        Column("process MiB", 3),
    )
    return DataTable(
        f"Steps of {record.model}, and times over those of C",
        columns,
        [_cells(p) for p in record.path_results],
    )


def _cells(path: WebPath) -> tuple[str | float | None, ...]:
    ratio = path.ratio
    return (
        path.path,
        describe_options(path.options),
        path.status.value,
        path.step_ns,
        *((None, None, None) if ratio is None else (ratio.median, ratio.low, ratio.high)),
        path.difference,
        *(None if size is None else size / _MIB for size in (path.heap_bytes, path.rss_bytes)),
    )
