"""What `mjbench tune` comes to: printed, and as a part of a report."""

from collections.abc import Iterator, Sequence

from rich.console import Console

from mjbench.instrument.ratio import Ratio
from mjbench.pages import charts, console
from mjbench.pages.content import Cell, Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import tables, tuning, vega
from mjbench.status import Status
from mjbench.tuning import knobs
from mjbench.tuning.distance import Distance
from mjbench.tuning.records import Attempt, Effect, Program, TuneRecord
from mjbench.tuning.reference import Present
from mjbench.tuning.settings import Setting, label

_PRESENT, _TRIED, _CONFIRMED = "present settings", "tried", "confirmed"
_COLOURS = {_PRESENT: vega.GREY, _TRIED: vega.BLUE, _CONFIRMED: vega.ORANGE}
_RESULTS = {
    Effect.FREE: "same (free)",
    Effect.EQUIVALENT: "within tolerance (equivalent)",
    Effect.APPROXIMATE: "differ (approximate)",
}
# Settings alone that are printed.
_MOST_ALONE = 12


def print_record(out: Console, record: TuneRecord) -> None:
    """Print what a search came to."""
    heading, _, rest = tuning.conclusion(record).partition(": ")
    out.print(tables.headed(f"\n{heading}", f": {rest}"), soft_wrap=True)
    if not _is_measured(record):
        return
    if record.front or record.batch is not None:
        console.print_table(out, _front_table(record))
    if alone := tuning.faster_alone(record)[:_MOST_ALONE]:
        console.print_table(out, _alone_table(record, alone, has_changes=False))
    lines = []
    for each in tuning.advised(record):
        lines += [f"To apply {label(each.settings)}:", *tuning.paste_lines(each.settings)]
    for line in [*lines, *tuning.notes(record)]:
        out.print(line, soft_wrap=True)


def sections(records: Sequence[TuneRecord], command: str) -> Iterator[Section]:
    """Yield a section for each model for which settings were searched."""
    for record in records:
        tone = Tone.GOOD if record.best() is not None else Tone.NEUTRAL
        first = Conclusion(
            tuning.conclusion(record), tone if record.status == Status.OK else Tone.BAD
        )
        if not _is_measured(record):
            yield Section(record.model, command, [first])
            continue
        present = record.present
        alone = [each for each in record.attempts if len(each.settings) == 1]
        yield Section(
            heading=f"{tuning.subject(record)}: settings",
            command=command,
            conclusions=[first],
            figures=[_front_figure(record, present)] if present else [],
            tables=[_front_table(record), *([_alone_table(record, alone)] if present else [])],
            notes=tuning.notes(record),
        )


def _is_measured(record: TuneRecord) -> bool:
    """Return whether there is more to say than the conclusion."""
    batch = record.batch
    return record.present is not None or (
        batch is not None and batch.facts is not None and batch.present is not None
    )


def _front_figure(record: TuneRecord, present: Present) -> Figure:
    """Return time against error: what was tried from all starts, and what was confirmed."""
    columns = (
        Column("settings"),
        Column("error, % of the motion", 3),
        Column("time of a simulated second", 4),
        Column("point"),
    )
    most = max(
        (len(row.accuracy.run_errors) for row in record.attempts if row.accuracy is not None),
        default=0,
    )
    rows = [(label(()), 100 * present.error.share, 1.0, _PRESENT)]
    rows += [
        (label(row.settings), 100 * row.accuracy.error.share, row.time_ratio, _TRIED)
        for row in record.attempts
        if row.accuracy is not None
        and row.time_ratio is not None
        and len(row.accuracy.run_errors) == most  # errors of fewer runs are of another kind
    ]
    rows += [
        (label(each.settings), 100 * each.error.share, each.ratio.estimate, _CONFIRMED)
        for each in record.front
    ]
    data = DataTable("Time and error", columns, rows)
    error, time_ratio = columns[1].title, columns[2].title
    layer: vega.Spec = {
        "mark": {"type": "point", "filled": True, "size": 60, "tooltip": {"content": "data"}},
        "encoding": {
            "x": charts.quantity(time_ratio, f"{time_ratio}, present settings = 1"),
            "y": charts.quantity(error, error, log=all(row[1] > 0 for row in rows)),
            "color": charts.colour("point", _COLOURS),
        },
    }
    return Figure(
        title=f"{record.model}: time and error of settings",
        alternative=f"{len(rows)} points: the farther left, the faster; the lower, the more"
        f" accurate. {len(record.front)} are confirmed from new starts.",
        specification=charts.chart(data, [layer], height=320),
        data=data,
    )


def _front_table(record: TuneRecord) -> DataTable:
    """Return what is recommended; of MJX and Warp, also what else was tried."""
    batch, listed = record.batch, tuning.advised(record)

    def row(
        ratio: Ratio,
        error: Distance | None,
        settings: Sequence[Setting],
        recommended: str = "",
        effect: Effect | None = None,
        program: Program | None = None,
    ) -> list[Cell]:
        in_units = tuning.in_units(error) if error else ""
        return [
            recommended,
            *([_RESULTS[effect] if effect else ""] if batch is None else []),
            ratio.estimate,
            ratio.low,
            ratio.high,
            100 * error.share if error else None,
            in_units if batch is None else (program.compile_s if program else None),
            label(settings),
        ]

    columns = (
        Column("recommended"),
        *([Column("results")] if batch is None else []),
        Column("time of a simulated second" if batch is None else "time of a batched step", 4),
        Column("low", 4),
        Column("high", 4),
        Column(f"{tuning.error_name(record)}, % of the motion", 3),
        Column("in units") if batch is None else Column("compile s", 3),
        Column("settings"),
    )
    present = batch.present if batch else None
    in_c = present or record.present
    assert in_c is not None, "it was measured"
    rows = [row(Ratio(1.0, None, None), in_c.error, (), program=present)]
    rows += [
        row(
            each.ratio,
            each.error,
            each.settings,
            "yes" if each in listed or batch else "",
            each.effect,
            each.program,
        )
        for each in record.front
    ]
    rows += [
        row(Ratio(each.time_ratio, None, None), each.error, each.settings, program=each.program)
        for each in (tuning.tried(record) if batch else ())
        if each.time_ratio
    ]
    return DataTable("Confirmed from new starts" if batch is None else "Settings", columns, rows)


def _alone_table(
    record: TuneRecord, attempts: Sequence[Attempt], has_changes: bool = True
) -> DataTable:
    """Return what settings do alone."""
    columns = (
        Column("setting alone"),
        Column("results"),
        Column("time of a simulated second", 4),
        Column("why it can help"),
        *([Column("what it may change")] if has_changes else []),
    )
    rows = []
    for each in attempts:
        (setting,) = each.settings
        rows.append(
            [
                setting.label,
                _RESULTS[each.accuracy.effect] if each.accuracy else each.detail,
                each.ratio.estimate if each.ratio else each.time_ratio,
                tuning.why(setting, record),
                *([knobs.find(setting.knob).changes] if has_changes else []),
            ]
        )
    return DataTable("Settings", columns, rows)
