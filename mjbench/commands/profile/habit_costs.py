"""What `mjbench profile --habits` comes to: what habits of a Python loop cost."""

from collections.abc import Iterator, Sequence

from mjbench import formats
from mjbench.commands.profile import habits
from mjbench.commands.profile.habit_timing import HabitCost, OverheadRow
from mjbench.interval import Interval
from mjbench.results import charts, content
from mjbench.results.content import Column, Conclusion, DataTable, Figure, Section, Snippet, Tone
from mjbench.results.starts import starts_lines

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
    python_ns, binding_ns = table.bare_ns - table.engine_ns, table.binding_ns or 0.0
    shares = "; the share of Python was not resolved: measure on a quieter machine"
    if python_ns > 0:
        shares = f", of which the engine has {table.engine_ns:,.0f} and Python {python_ns:,.0f}"
    call = f"; a call that steps nothing takes {binding_ns:,.0f} ns" if binding_ns > 0 else ""
    return Section(
        heading=f"{table.model}: what a Python loop wastes",
        conclusions=[
            Conclusion(f"{table.model}: {_most_expensive(table.costs)}", Tone.UNSURE),
            Conclusion(
                f"{table.model}: a step of the bare loop takes {table.bare_ns:,.0f} ns{shares}"
            ),
        ],
        facts=[f"An episode is {table.nstep} steps{call}", *starts_lines(table.starts)],
        figures=[_waterfall(table)],
        tables=[_table(table)],
        notes=["`mjbench lint train.py` finds habits like these in a program of yours"],
        snippets=[snippet for cost in table.costs for snippet in _snippets(cost)],
    )


def _most_expensive(costs: Sequence[HabitCost]) -> str:
    cost = next((cost for cost in costs if cost.low > 0), None)
    if cost is None:
        return "no habit certainly costs anything: give a longer --budget, or end other programs"
    habit = "the most expensive habit"
    if cost is not costs[0]:
        habit = "of the habits that certainly cost time, the most expensive"
    remedy = f"; `{cost.cheaper}` does the same for less" if cost.cheaper else ""
    size = f"{cost.ns:,.0f} ns a step, {formats.whole_percent(cost.share)} of it"
    return f"{habit} is {cost.source}: {size}{remedy}"


def _table(table: OverheadRow) -> DataTable:
    return DataTable.of(
        "Habits",
        table.costs or (),
        (Column("in the loop"), lambda cost: cost.source),
        (Column("adds ns/step", formats.count), lambda cost: cost.ns),
        (
            Column("95 %", formats.ends_in(formats.count), leaves=2),
            lambda cost: Interval(cost.ns, cost.low, cost.high),
        ),
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
    count = formats.count
    columns = [Column("part"), Column("from", count), Column("to", count), Column("kind")]
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
