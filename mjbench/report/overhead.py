"""The table of what habits of a Python loop cost."""

from rich.console import Console

from mjbench.loop import habits
from mjbench.loop.compiled_loop import script
from mjbench.loop.overhead import OverheadRow
from mjbench.report import tables
from mjbench.report.starts import starts_lines


def print_table(out: Console, overhead: OverheadRow, code: bool) -> None:
    """Print what every habit adds to a step, the most expensive first; its loop, too, on `code`."""
    out.print(
        tables.headed(
            f"\n{overhead.model}",
            f": a step of the bare loop {overhead.bare_ns:,.0f} ns, engine"
            f" {overhead.engine_ns:,.0f} + binding {overhead.binding_ns:,.0f}; an episode is"
            f" {overhead.nstep} steps",
        ),
        soft_wrap=True,
    )
    for line in starts_lines(overhead.starts):
        out.print(line, soft_wrap=True)
    headings = ["in the loop", "adds ns/step", "95 %", "of a step", "cheaper", "saves ns"]
    table = tables.plain_table(headings, right=(1, 2, 3, 5))
    for cost in overhead.costs or ():
        table.add_row(
            cost.source,
            f"{cost.ns:,.0f}",
            f"{cost.low:,.0f}–{cost.high:,.0f}",
            f"{100 * cost.share:.1f} %",
            cost.cheaper,
            "" if cost.saved_ns is None else f"{cost.saved_ns:,.0f}",
        )
    out.print(table)
    if code:
        _print_code(out, overhead)


def _print_code(out: Console, overhead: OverheadRow) -> None:
    """Print the loop of each habit, and that of its cheaper form."""
    known = {habit.name: habit for habit in habits.HABITS}
    for cost in overhead.costs or ():
        out.print(tables.headed(f"\n{cost.source}", f"\n{cost.code}"), soft_wrap=True)
        if cost.cheaper in known:  # a later version may know others
            cheaper = script(known[cost.cheaper])
            out.print(f"# cheaper: {cost.cheaper}\n{cheaper}", soft_wrap=True)
