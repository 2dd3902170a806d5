"""What MuJoCo's warnings, and a solver that stops at its limit, mean, in lines."""

from collections.abc import Mapping

from mjbench.report.formats import short_percent
from mjbench.simulation.starts import Window
from mjbench.units import count_of

# Values of mjtWarning by which MuJoCo says that memory was full and it left something out.
_MEMORY_WARNINGS = ("CONTACTFULL", "CNSTRFULL", "VGEOMFULL")
# A solver that stops at its limit of iterations in more than this share of the steps is mentioned.
_MENTIONED_LIMITED = 0.5


def limited_lines(window: Window) -> list[str]:
    """Return that the solver mostly stops at its limit of iterations, where it does."""
    if window.solver_limited <= _MENTIONED_LIMITED:
        return []
    limited = short_percent(window.solver_limited)
    return [
        f"The solver stopped at its limit of iterations in {limited} of the steps: states and times"
        " depend on that limit"
    ]


def warning_lines(warnings: Mapping[str, int] | None) -> list[str]:
    """Return what warnings, the number of simulations that raised each, mean, a line each."""
    counts = warnings or {}
    full = {name: count for name, count in counts.items() if name in _MEMORY_WARNINGS}
    other = {name: count for name, count in counts.items() if name not in _MEMORY_WARNINGS}
    lines = []
    if full:
        lines.append(
            f"The model's memory was full ({_simulations(full)}), so MuJoCo left out contacts or"
            ' constraints: enlarge it with <size memory="…"/>'
        )
    if other:
        lines.append(f"MuJoCo warned ({_simulations(other)}) but the simulations did not diverge")
    return lines


def _simulations(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} in {count_of(count, 'simulation')}" for name, count in counts.items())
