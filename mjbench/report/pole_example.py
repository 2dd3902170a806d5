"""The falls of the cart-pole as bars, and the time that each path took."""

from rich.console import Console

from mjbench.loop.pole_example import FallExperiment
from mjbench.report import tables

_WIDTH = 40


def print_falls(out: Console, experiment: FallExperiment, usable_cores: int) -> None:
    """Print the probability at each angle with its interval, then the paths."""
    angles = tables.plain_table(["angle", "falls", "probability", "95 %", ""], right=(0, 1, 2, 3))
    for row in experiment.angles:
        angles.add_row(
            f"{row.angle:.2f} rad",
            str(row.falls),
            f"{row.probability:.3f}",
            f"{row.low:.3f}–{row.high:.3f}",
            "█" * round(_WIDTH * row.probability),
        )
    out.print(angles)
    paths = tables.plain_table(["path", "seconds", "speed-up"], right=(1, 2))
    for path in experiment.paths:
        paths.add_row(path.path, f"{path.seconds:.3f}", f"{path.speedup:.2f}×")
    out.print()
    out.print(paths)
    out.print(f"Every path counts the same falls. Usable cores here: {usable_cores}.")
