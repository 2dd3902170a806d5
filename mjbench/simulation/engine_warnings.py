"""What MuJoCo's warnings mean: of a program that is run, and of simulations that were measured.

Warnings have the names of mjtWarning, without its prefix.
"""

from collections.abc import Mapping

from mjbench.formats import count_of

_DIVERGED = "the simulation diverged, and MuJoCo reset it, unless autoreset is disabled"
# What a warning in a program means, by name.
MEANINGS: Mapping[str, str] = {
    "BADQPOS": _DIVERGED,
    "BADQVEL": _DIVERGED,
    "BADQACC": _DIVERGED,
    "BADCTRL": "a control was no number, or too large, and MuJoCo took all controls as zero",
    "CONTACTFULL": "contacts were dropped for want of memory: raise <size memory>",
    "CNSTRFULL": "constraints were dropped for want of memory: raise <size memory>",
    "INERTIA": "the inertia matrix is almost singular",
}
# Values of mjtWarning by which MuJoCo says that memory was full and it left something out.
_MEMORY_WARNINGS = ("CONTACTFULL", "CNSTRFULL", "VGEOMFULL")


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
