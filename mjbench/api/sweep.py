"""What `mjbench sweep` measures: the cells of a matrix on a cluster, each stored in a run set."""

import contextlib
import itertools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import writing
from mjbench.measuring.timing import Progress
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import FINISHED
from mjbench.store import run_set
from mjbench.store.run_set import RunSetFile
from mjbench.sweep import ray_cluster, results
from mjbench.sweep.cells import Cell
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.results import CellOutcome, CellResult
from mjbench.sweep.run import Summary, Sweep


@dataclass(frozen=True)
class Swept:
    """How each cell of a run set ended; `summary` is of those measured now, None without any."""

    outcomes: Mapping[Cell, CellOutcome]
    summary: Summary | None = None


def stored(target: Path, matrix: Matrix) -> dict[Cell, CellOutcome]:
    """Return how the cells in a run set ended; the last result of each counts."""
    if not os.path.lexists(target):
        return {}
    sections = run_set.read(target, RECORD_TYPES).sections
    by_key = {section.cell: section.run for section in sections if section.cell}
    return {cell: results.outcome(by_key[cell.key]) for cell in matrix.cells if cell.key in by_key}


def measure_missing(
    matrix: Matrix,
    target: Path,
    address: str | None,
    retry: bool,
    progress: Callable[[], contextlib.AbstractContextManager[Progress]],
    report: Callable[[str], None],
) -> Swept:
    """Measure the cells that a run set lacks, and append each to it as it comes.

    Args:
      retry: whether cells that failed are missing, too.
      progress: begins to show progress, where something is missing.
    """
    with contextlib.ExitStack() as on_error, contextlib.closing(_open(target, on_error)) as file:
        outcomes = stored(target, matrix)
        done = [cell for cell, how in outcomes.items() if not retry or how.status in FINISHED]
        if len(done) == len(matrix.cells):
            return Swept(outcomes)
        tries = matrix.plan.rules.tries
        with progress() as on_progress, ray_cluster.RayCluster(address, tries) as cluster:
            for left_out in cluster.left_out:
                report(f"{left_out.name} is left out: {left_out.reason}")

            def on_result(result: CellResult, node: str, ndone: int) -> None:
                file.append(result.section)
                text = f"{ndone} of {len(matrix.cells)} results; {result.cell.name} from {node}"
                on_progress(text, ndone / len(matrix.cells))

            summary = Sweep(matrix, done, cluster, on_result).measure()
        on_error.pop_all()
        return Swept({**outcomes, **summary.outcomes}, summary)


def _open(target: Path, on_error: contextlib.ExitStack) -> RunSetFile:
    # not Path.exists, which fails where a name is too long; create has a message for that
    if os.path.lexists(target):
        return RunSetFile.open(target)
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    file = RunSetFile.create(target)
    on_error.callback(_remove_empty, target)
    return file


def _remove_empty(target: Path) -> None:
    """Remove a run set that has no section: nothing began to measure."""
    with contextlib.suppress(OSError):
        with target.open("rb") as file:
            lines = list(itertools.islice(file, 2))
        if len(lines) < 2:
            target.unlink()
