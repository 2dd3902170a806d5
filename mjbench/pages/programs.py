"""The part of a report that `mjbench run` gives."""

from collections.abc import Iterator, Sequence

from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.program.loop_time import LoopTime
from mjbench.program.records import LoopReport, ProgramRow
from mjbench.report import program, vega
from mjbench.status import Status


def sections(rows: Sequence[ProgramRow], command: str) -> Iterator[Section]:
    """Yield a section for each program, and one for each further loop of it."""
    for row in rows:
        tone = Tone.NEUTRAL if row.status == Status.OK else Tone.BAD
        first = Conclusion(f"{row.program}: {program.conclusion(row)}", tone)
        if not row.loops:
            yield Section(row.program, command, [first])
        for i, report in enumerate(row.loops):
            yield _section(row, report, command, [first] if i == 0 else [])


def _section(
    row: ProgramRow, report: LoopReport, command: str, conclusions: Sequence[Conclusion]
) -> Section:
    """Return where the time of one loop goes, and what to do about it."""
    time = report.time
    return Section(
        heading=f"{row.program}: the loop in {program.where(time)}",
        command=command,
        conclusions=conclusions,
        figures=[_figure(time)],
        tables=[_remedies(report), _lines("Lines of the program", time)],
        notes=[
            f"{time.samples:,} samples of this loop;"
            f" observing took {program.cost(row)} of the program's time.",
            *filter(None, [program.gil_wait(row)]),
        ],
    )


def _figure(time: LoopTime) -> Figure:
    columns = (Column("activity"), Column("% of the loop", 3), Column("±", 2))
    rows = [
        (str(activity), 100 * share, 100 * time.error(share))
        for activity, share in time.activities.items()
    ]
    data = DataTable("Where the time goes", columns, rows)
    layer: vega.Spec = {
        "mark": {"type": "bar", "height": 12, "color": vega.BLUE},
        "encoding": {
            "x": charts.quantity("% of the loop", "% of the loop", zero=True),
            "y": charts.names("activity"),
        },
    }
    return Figure(
        title=f"Where the time of {program.where(time)} goes",
        alternative=charts.bars("activities", rows),
        specification=charts.chart(data, [layer]),
        data=data,
    )


def _remedies(report: LoopReport) -> DataTable:
    columns = (Column("saves at most"), Column("where"), Column("what to do"), Column("rule"))
    rows = [
        (
            program.saving(remedy),
            str(remedy.place) if remedy.place is not None else "the loop",
            remedy.text,
            remedy.code,
        )
        for remedy in report.remedies
    ]
    return DataTable("What to do first", columns, rows)


def _lines(title: str, time: LoopTime) -> DataTable:
    columns = (Column("line"), Column("% of the loop", 3), Column("mostly"), Column("text"))
    rows = [
        (str(line.place), 100 * line.share, str(line.main_activity), line.place.text)
        for line in (*time.lines, *time.inner_functions)
    ]
    return DataTable(title, columns, rows)
