"""Which command of mjbench measures which cells, and how many of them at once.

Cells that share releases, models or start states are cheaper in one command: it starts once, and
keeps what it has loaded. Fewer at once spread better over nodes.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mjbench.releases.release_names import INSTALLED
from mjbench.sweep.cells import Cell, CellKind


@dataclass(frozen=True)
class CommandLine:
    """A command line without the options that say where results go."""

    arguments: tuple[str, ...]
    operands: tuple[str, ...]


@dataclass(frozen=True)
class Command:
    """How cells of one kind are measured.

    Attributes:
      options: that the plan can set, by their names without dashes, such as `time-limit`.
      together: what cells must have in common to be measured by one command line.
      least: as many are measured at once where there are as many, also if nodes are idle.
    """

    options: tuple[str, ...]
    name: tuple[str, ...]
    together: Callable[[Cell], tuple[str, ...]]
    most: int
    line: Callable[[Sequence[Cell]], CommandLine]
    needs_quiet: bool = True
    least: int = 1


def _version_argument(cell: Cell, version: str) -> str:
    return INSTALLED if version == cell.installed else version


def _versions(cells: Sequence[Cell]) -> CommandLine:
    first = cells[0]
    assert first.metric is not None
    old, new = (_version_argument(first, each) for each in (first.baseline, first.release))
    options = ["--old", old, "--new", new, "--paths", first.path, "--metric", first.metric.value]
    return CommandLine(("versions", *options), tuple(cell.model for cell in cells))


def _compare(cells: Sequence[Cell]) -> CommandLine:
    (cell,) = cells
    return CommandLine(("compare",), (cell.model,))


def _instructions(cells: Sequence[Cell]) -> CommandLine:
    """Count one model in several releases, all with what the first release of the plan draws."""
    first = cells[0]
    options: list[str] = []
    for version in dict.fromkeys([first.baseline, *(cell.release for cell in cells)]):
        options += ["--release", _version_argument(first, version)]
    return CommandLine(("profile", "--instructions", *options), (first.model,))


def _history(cells: Sequence[Cell]) -> CommandLine:
    models = [argument for cell in cells for argument in ("--model", cell.model)]
    release = _version_argument(cells[0], cells[0].release)
    return CommandLine(("history", "measure", "--no-operations", *models), (release,))


# Options without a value: `true` is `--name`.
SWITCHES = frozenset({"as-shipped"})
_SIZES = ("nbatch", "nstep", "hold", "seed", "settle")
COMMANDS: Mapping[CellKind, Command] = {
    CellKind.VERSIONS: Command(
        options=(
            *("min-effect", "confidence", "precision", "budget", "time-limit", "as-shipped"),
            *_SIZES,
        ),
        name=("versions",),
        together=lambda c: (c.baseline, c.release, c.path, c.metric or ""),
        most=10,
        line=_versions,
    ),
    CellKind.COMPARE: Command(
        options=(
            *("paths", "threads", "chunk", "budget", "returns", "total-steps", "time-limit"),
            *_SIZES,
        ),
        name=("compare",),
        together=lambda c: (c.model,),
        most=1,
        line=_compare,
    ),
    CellKind.INSTRUCTIONS: Command(
        options=("time-limit", *_SIZES),
        name=("profile", "--instructions"),
        needs_quiet=False,
        together=lambda c: (c.model,),
        least=4,  # the release that draws start states is counted again in each command
        most=16,
        line=_instructions,
    ),
    CellKind.HISTORY: Command(
        options=(),
        name=("history", "measure"),
        together=lambda c: (c.release,),
        most=10,  # as many as the shipped models, which fit into the time that a release may take
        line=_history,
    ),
}


def batches(cells: Sequence[Cell], nodes: Mapping[str, int]) -> list[tuple[Cell, ...]]:
    """Return the cells that one command each measures, in their order.

    Each node is to get two commands or more of a kind, so that none waits long for the last ones.

    Args:
      nodes: how many may measure, by the label that cells have; all of them for no label.
    """
    sorts = Counter((cell.machine, cell.kind) for cell in cells)
    groups: dict[tuple[str, ...], list[Cell]] = {}
    for cell in cells:
        together = COMMANDS[cell.kind].together(cell)
        groups.setdefault((cell.machine, cell.kind, *together), []).append(cell)
    batched = []
    for group in groups.values():
        machine, kind = group[0].machine, group[0].kind
        command, count = COMMANDS[kind], nodes.get(machine, 1)
        share = math.ceil(sorts[machine, kind] / (2 * count)) if count > 1 else command.most
        size = min(command.most, max(command.least, share))
        batched += [tuple(group[begin : begin + size]) for begin in range(0, len(group), size)]
    return batched
