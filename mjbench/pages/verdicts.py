"""The part of a report that paired comparisons and instruction counts give."""

from collections.abc import Iterator, Sequence

from mjbench.counts.function_differences import NetDifference, largest_differences
from mjbench.counts.records import ExplainRecord, InstructionsRecord
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.paired import family
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRow
from mjbench.report import vega, verdicts
from mjbench.status import Status

_TONES = {
    Verdict.SLOWER: Tone.BAD,
    Verdict.FASTER: Tone.GOOD,
    Verdict.SAME: Tone.NEUTRAL,
    Verdict.INCONCLUSIVE: Tone.UNSURE,
}
_COLOURS = {
    Verdict.FASTER.value: vega.BLUE,
    Verdict.SAME.value: vega.GREY,
    Verdict.SLOWER.value: vega.ORANGE,
    Verdict.INCONCLUSIVE.value: vega.SKY,
}
# Functions of a change that are drawn.
_MOST_FUNCTIONS = 12


def _conclusions(rows: Sequence[VerdictRow], confidence: float) -> Iterator[Conclusion]:
    """Yield what all comparisons come to together, then each of them."""
    if len(rows) > 1 and all(verdicts.has_evidence(row) for row in rows):
        yield Conclusion(verdicts.describe_family(family.decide(rows, confidence), confidence))
    yield from map(_conclusion, rows)


def _conclusion(row: VerdictRow) -> Conclusion:
    tone = Tone.BAD if row.verdict is None else _TONES[row.verdict]
    if row.changed_work and tone == Tone.NEUTRAL:
        tone = Tone.UNSURE
    return Conclusion(verdicts.describe_verdict(row), tone)


def section(rows: Sequence[VerdictRow], confidence: float, command: str) -> Section:
    """Return the section of paired comparisons; `confidence`: of what they show together."""
    timed = [row for row in rows if row.ratio is not None]
    return Section(
        heading="Verdicts",
        command=command,
        conclusions=[*_conclusions(rows, confidence)],
        notes=[f"{_label(row)}: {line}" for row in rows for line in verdicts.notes(row)],
        figures=[_forest(timed)] if timed else [],
        tables=[_table(rows)],
    )


def _label(row: VerdictRow) -> str:
    label = f"{row.model}, {verdicts.describe_targets(row)}"
    return label if row.path == "python_loop" else f"{label}, {row.path}"


def _table(rows: Sequence[VerdictRow]) -> DataTable:
    columns = (
        Column("comparison"),
        Column("verdict"),
        Column("change, %", 3),
        Column("low, %", 3),
        Column("high, %", 3),
        Column("cause"),
        Column("placement adds, %", 3),
        Column("work"),
        Column("launches", 3),
        Column("seconds", 3),
    )
    return DataTable("Verdicts", columns, [_cells(row) for row in rows])


def _cells(row: VerdictRow) -> tuple[str | float | None, ...]:
    ratio, effect = row.ratio, row.placement.effect if row.placement else None
    return (
        _label(row),
        (row.verdict or row.status).value,
        _percent(ratio.estimate if ratio else None),
        _percent(ratio.low if ratio else None),
        _percent(ratio.high if ratio else None),
        row.cause.value if row.cause else None,
        _percent(effect.estimate if effect else None),
        verdicts.describe_work(row) or ("" if row.work is None else "same"),
        row.launches,
        row.seconds,
    )


def _percent(ratio: float | None) -> float | None:
    return None if ratio is None else 100 * (ratio - 1)


def _forest(rows: Sequence[VerdictRow]) -> Figure:
    columns = (
        Column("comparison"),
        Column("change", 3),
        Column("low", 3),
        Column("high", 3),
        Column("verdict"),
        Column("cause"),
    )
    cells = []
    for row in rows:
        assert row.ratio is not None, "rows without a ratio are left out"
        verdict = (row.verdict or Verdict.INCONCLUSIVE).value
        ends = (_percent(row.ratio.low), _percent(row.ratio.high))
        cause = row.cause.value if row.cause else ""
        cells.append((_label(row), _percent(row.ratio.estimate), *ends, verdict, cause))
    data = DataTable("Changes in percent", columns, cells)
    y = charts.names("comparison")
    title = "change, % (above 0 is slower)"
    colour = charts.colour("verdict", _COLOURS, "verdict")
    layers: list[vega.Spec] = [
        charts.rule_at(0.0),
        {
            "mark": {"type": "rule", "strokeWidth": 3},
            "transform": [{"filter": "isValid(datum.low) && isValid(datum.high)"}],
            "encoding": {
                "x": charts.quantity("low", title),
                "x2": {"field": "high"},
                "y": y,
                "color": colour,
            },
        },
        {
            "mark": {"type": "point", "filled": True, "size": 70},
            "encoding": {"x": charts.quantity("change", title), "y": y, "color": colour},
        },
    ]
    counts = {v: sum(cell[4] == v for cell in cells) for v in _COLOURS}
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    return Figure(
        title="Changes with their intervals",
        alternative=f"{len(cells)} comparisons: {summary}.",
        specification=charts.chart(data, layers),
        data=data,
    )


def explanation_sections(rows: Sequence[ExplainRecord], command: str) -> Iterator[Section]:
    """Yield a section for each model and pair of releases: which functions account for a change.

    Operations around the step have sections, too, where both releases have the operation.
    """
    for row in rows:
        if row.status == Status.UNAVAILABLE:
            continue
        old, new = row.instructions_per_step.old, row.instructions_per_step.new
        heading = f"{row.series}, instructions, {row.old} → {row.new}"
        if not old or not new:
            text = f"{heading}: not counted"
            if row.status != Status.OK:
                text += f" ({row.status})"
            yield Section(heading, command, [Conclusion(text, Tone.BAD)])
            continue
        change = 100 * (new / old - 1)
        subject = "it" if row.operation else "a step"
        counts = f"{change:+.1f} % instructions ({old:,.0f} → {new:,.0f})"
        conclusion = Conclusion(f"{heading}: {subject} executes {counts}")
        changes = largest_differences(row.functions, _MOST_FUNCTIONS)
        figures = [_function_figure(changes, old)] if changes else []
        yield Section(heading, command, [conclusion], figures)


def count_sections(rows: Sequence[InstructionsRecord], command: str) -> Iterator[Section]:
    """Yield one section with the instructions of all models and releases; none without rows."""
    if not rows:
        return
    columns = (
        Column("model"),
        Column("release"),
        Column("instructions per step", 6),
        Column("outside the engine", 6),
        Column("why not"),
    )
    cells = [
        (r.model, r.release, r.instructions_per_step, r.outside_per_step, r.detail) for r in rows
    ]
    failed = [
        Conclusion(f"{r.model}, MuJoCo {r.release}: not counted ({r.status})", Tone.BAD)
        for r in rows
        if r.instructions_per_step is None
    ]
    table = DataTable("Instructions", columns, cells)
    yield Section("Instructions", command, failed, tables=[table])


def _function_figure(changes: Sequence[NetDifference], total: float) -> Figure:
    columns = (
        Column("function"),
        Column("instructions per step", 4),
        Column("% of a step", 3),
    )
    cells = [
        (
            " and ".join(change.names),
            change.difference,
            100 * change.difference / total,
        )
        for change in changes
    ]
    data = DataTable("Functions that changed most", columns, cells)
    layer: vega.Spec = {
        "mark": {"type": "bar", "height": 12},
        "encoding": {
            "x": charts.quantity("% of a step", "% of the instructions of a step", zero=True),
            "y": charts.names("function"),
            "color": {
                "condition": {"test": "datum['% of a step'] > 0", "value": vega.ORANGE},
                "value": vega.BLUE,
            },
        },
    }
    return Figure(
        title="Functions that account for most of the change",
        alternative=f"Bars of {len(cells)} functions; the largest change is that of"
        f" {cells[0][0]}, {cells[0][2]:+.1f} % of a step.",
        specification=charts.chart(data, [charts.rule_at(0.0), layer]),
        data=data,
    )
