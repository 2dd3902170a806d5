"""The table of what habits of a Python loop cost."""

from rich.console import Console
from rich.markup import escape

from mjbench.loop import habits
from mjbench.loop.overhead import Table
from mjbench.report import tables


def print_table(out: Console, found: Table, code: bool) -> None:
    """Print what every source adds to a step, the dearest first."""
    out.print(
        f"\n[bold]{escape(found.model)}[/bold]: a step of the bare loop {found.bare_ns:,.0f} ns,"
        f" engine {found.engine_ns:,.0f} + binding {found.binding_ns:,.0f};"
        f" an episode is {found.nstep} steps",
        soft_wrap=True,
    )
    headings = ["in the loop", "adds ns/step", "95 %", "of a step", "cheaper", "saves ns"]
    table = tables.plain_table(headings, right=(1, 2, 3, 5))
    for cost in found.costs:
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
        for cost in found.costs:
            out.print(f"\n[bold]{cost.source}[/bold]\n{escape(cost.code)}", soft_wrap=True)
            if cost.cheaper:
                cheaper = habits.code(habits.find(cost.cheaper))
                out.print(f"# cheaper: {cost.cheaper}\n{escape(cheaper)}", soft_wrap=True)
