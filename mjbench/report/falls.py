"""The falls of the cart-pole, as bars, and the time that each path took."""

from rich.console import Console

from mjbench.loop.pole_example import Result
from mjbench.report import tables

_WIDTH = 40


def print_falls(out: Console, found: Result, cores: int) -> None:
    """Print the probability at each angle with its interval, then the paths."""
    table = tables.plain_table(["angle", "falls", "probability", "95 %", ""], right=(0, 1, 2, 3))
    for angle, count, (share, low, high) in zip(
        found.angles, found.ways[0].counts, found.intervals(), strict=True
    ):
        bar = "█" * round(_WIDTH * share)
        table.add_row(f"{angle:.2f} rad", str(count), f"{share:.3f}", f"{low:.3f}–{high:.3f}", bar)
    out.print(table)
    ways = tables.plain_table(["path", "seconds", "speed-up"], right=(1, 2))
    for way in found.ways:
        ways.add_row(way.name, f"{way.seconds:.3f}", f"{found.ways[0].seconds / way.seconds:.2f}×")
    out.print()
    out.print(ways)
    out.print(f"Every path counts the same falls. Usable cores here: {cores}.")
