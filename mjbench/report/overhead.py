"""What `mjbench profile --habits` comes to: what habits of a Python loop cost."""

from collections.abc import Iterator, Sequence

from mjbench.loop import habits
from mjbench.loop.overhead import HabitCost, OverheadRow
from mjbench.report import charts, content, formats
from mjbench.report.content import Column, Conclusion, DataTable, Figure, Section, Snippet, Tone
from mjbench.report.starts import starts_lines

# Habits that are drawn: those that add most.
_MOST_HABITS = 12


def sections(rows: Sequence[OverheadRow]) -> Iterator[Section]:
    for row in rows:
        if row.is_measured:
            yield _section(row)
        else:
            yield content.failure(row.model, row.status, row.detail)


def _section(table: OverheadRow) -> Section:
    assert table.bare_ns is not None and table.engine_ns is not None and table.costs is not None
    python_ns = table.bare_ns - table.engine_ns
    conclusions = []
    cost = next((cost for cost in table.costs if cost.low > 0), None)
    if cost is None:
        text = "no habit certainly costs anything: give a longer --budget, or end other programs"
        conclusions.append(Conclusion(f"{table.model}: {text}", Tone.UNSURE))
    else:
        certain = "" if cost is table.costs[0] else ", of those that are certain,"
        remedy = f"; `{cost.cheaper}` does the same for less" if cost.cheaper else ""
        conclusions.append(
            Conclusion(
                f"{table.model}: the most expensive habit{certain} is {cost.source}:"
                f" {cost.ns:,.0f} ns a step, {100 * cost.share:.0f} % of it{remedy}",
                Tone.UNSURE,
            )
        )
    conclusions.append(
        Conclusion(
            f"{table.model}: a step of the bare loop takes {table.bare_ns:,.0f} ns"
            + (
                f", of which the engine has {table.engine_ns:,.0f} and Python {python_ns:,.0f}"
                if python_ns > 0
                else "; the share of Python was not resolved: measure on a quieter machine"
            )
        )
    )
    return Section(
        heading=f"{table.model}: what a Python loop wastes",
        conclusions=conclusions,
        facts=[
            f"An episode is {table.nstep} steps{_binding(table.binding_ns or 0.0)}",
            *starts_lines(table.starts),
        ],
        figures=[_waterfall(table)],
        tables=[_table(table)],
        notes=["`mjbench lint train.py` finds habits like these in a program of yours"],
        snippets=[snippet for cost in table.costs for snippet in _snippets(cost)],
    )


def _binding(ns: float) -> str:
    """Return what a call that steps nothing takes; nothing where that was not resolved."""
    return f"; a call that steps nothing takes {ns:,.0f} ns" if ns > 0 else ""


def _table(table: OverheadRow) -> DataTable:
    return DataTable.of(
        "Habits",
        table.costs or (),
        (Column("in the loop"), lambda cost: cost.source),
        (Column("adds ns/step", formats.count), lambda cost: cost.ns),
        (Column("95 %", formats.ends_in(formats.count), leaves=2), lambda cost: cost),
        (Column("of a step", formats.percent, leaves=1), lambda cost: cost.share),
        (Column("cheaper"), lambda cost: cost.cheaper),
        (Column("saves ns", formats.count), lambda cost: cost.saved_ns),
    )


def _snippets(cost: HabitCost) -> Iterator[Snippet]:
    yield Snippet(cost.source, cost.code)
    if cost.cheaper in habits.BY_NAME:  # a later version may know others
        yield Snippet(f"cheaper, {cost.cheaper}", habits.script(habits.BY_NAME[cost.cheaper]))


def _waterfall(table: OverheadRow) -> Figure:
    """Return a step, part by part: the engine, the loop, and then each habit on top of it."""
    columns = (
        Column("part"),
        Column("from", formats.count),
        Column("to", formats.count),
        Column("kind"),
    )
    assert table.bare_ns is not None and table.engine_ns is not None and table.costs is not None
    loop = table.bare_ns
    rows: list[tuple[str, float, float, str]] = [
        ("engine", 0.0, table.engine_ns, "step"),
        ("Python loop", table.engine_ns, loop, "step"),
    ]
    rows += [
        (f"+ {cost.source}", loop, loop + max(0.0, cost.ns), "habit")
        for cost in table.costs[:_MOST_HABITS]
    ]
    data = DataTable("Nanoseconds of a step", columns, rows)
    bars = {
        "x": charts.quantity("from", "ns of a step", zero=True),
        "x2": {"field": "to"},
        "y": charts.names(data),
        "color": charts.colour("kind", {"step": charts.BLUE, "habit": charts.ORANGE}),
    }
    return charts.figure(
        f"{table.model}: a step, and what each habit adds to it",
        f"The engine takes {table.engine_ns:,.0f} ns; the loop ends at {loop:,.0f} ns; habits"
        " begin there.",
        data,
        [charts.layer("bar", bars, height=12)],
    )
