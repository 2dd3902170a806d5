"""The part of a report that `mjbench compare --scaling` gives."""

from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import Variant
from mjbench.comparison.scaling import ScalingPoint, Stage
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import comparison, vega
from mjbench.report.scaling import describe_advice, problem_lines
from mjbench.report.thread_advice import ScalingResults, ThreadAdvice
from mjbench.status import Status

_IDEAL, _HAD, _MEASURED = "one core a thread", "cores that there were", "measured"
_COLOURS = {_MEASURED: vega.BLUE, _HAD: vega.GREEN, _IDEAL: vega.GREY}


def section(results: ScalingResults, command: str) -> Section:
    """Return the section of one model."""
    record, all_advice = results.records[0].model, results.advice()
    notes = [str(line) for line in comparison.heading_lines(record)]
    return Section(
        heading=f"{record.model}: how many threads?",
        command=command,
        conclusions=[*_failures(results), *(_conclusion(a, results) for a in all_advice)],
        figures=[_thread_figure(results.points, advice) for advice in all_advice],
        tables=[_table(results)],
        notes=[*notes, *(str(line) for line in problem_lines(results))],
    )


def _failures(results: ScalingResults) -> Iterator[Conclusion]:
    """Yield what went wrong, each once."""
    texts = []
    for record in results.records:
        model = record.model
        if model.status not in (Status.OK, Status.INTERRUPTED):
            texts.append(f"{model.model}: {model.status}: {model.detail}")
        texts += [
            f"{model.model}: {Variant(m.path, m.options)} does other work than the plain loop:"
            f" {m.agreement}"
            for m in record.measurements
            if m.status == Status.DISAGREES
        ]
    yield from (Conclusion(text, Tone.BAD) for text in dict.fromkeys(texts))


def _conclusion(advice: ThreadAdvice, results: ScalingResults) -> Conclusion:
    tone = Tone.GOOD if advice.nthread > 1 else Tone.NEUTRAL
    return Conclusion(f"{advice.model}: {describe_advice(advice, results.topology)}", tone)


def _thread_figure(points: Sequence[ScalingPoint], advice: ThreadAdvice) -> Figure:
    by_count = {
        p.nthread: p
        for p in points
        if p.variant.path == advice.path and p.stage == Stage.THREADS and p.over_one
    }
    columns = (Column("threads", 3), Column("speed-up over one thread", 3), Column("line"))
    rows: list[tuple[int, float, str]] = []
    for count in sorted(by_count):
        point = by_count[count]
        assert point.over_one is not None, "points without it are left out"
        rows.append((count, point.over_one.median, _MEASURED))
        rows.append((count, float(count), _IDEAL))
        if point.cores_had is not None:
            rows.append((count, min(count, point.cores_had), _HAD))
    data = DataTable(f"{advice.path}: speed-up by threads", columns, rows)
    layer: vega.Spec = {
        "mark": {"type": "line", "point": True},
        "encoding": {
            "x": charts.quantity("threads", "threads"),
            "y": charts.quantity("speed-up over one thread", "× one thread", zero=True),
            "color": charts.colour("line", _COLOURS),
        },
    }
    best = max((row for row in rows if row[2] == _MEASURED), key=lambda row: row[1])
    return Figure(
        title=f"{advice.path}: speed-up by threads",
        alternative=f"The speed-up over one thread is largest with {best[0]} threads,"
        f" {best[1]:.2f}×.",
        specification=charts.chart(data, [layer], height=240),
        data=data,
    )


def _table(results: ScalingResults) -> DataTable:
    columns = (
        Column("tried"),
        Column("path"),
        Column("threads", 3),
        Column("chunk", 3),
        Column("simulations", 4),
        Column("ns/step", 4),
        Column("× plain loop", 3),
        Column("× one thread", 3),
        Column("efficiency", 2),
        Column("cores had", 3),
        Column("limits exceeded"),
    )
    rows = [
        (
            row.stage.value,
            str(Variant(row.path, row.options)),
            row.nthread,
            row.chunk,
            row.nbatch,
            row.step_ns,
            row.speedup,
            row.over_one,
            row.efficiency,
            row.cores_had,
            "; ".join(row.beyond),
        )
        for row in results.rows()
    ]
    return DataTable("Runs of the search", columns, rows)
