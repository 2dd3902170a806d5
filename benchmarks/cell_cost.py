"""What a cell of a sweep takes on the shipped models: a verdict, a count, a comparison.

    python -m benchmarks.cell_cost [MODEL …] [--old RELEASE] [--new RELEASE] [--kind KIND …]

runs `mjbench versions`, `mjbench instructions` and `mjbench compare` on each model, one after the
other, and writes results/cells.json: seconds, and what the run set of a sweep stores. Named models
and kinds replace their rows. It takes about half an hour, and needs the machine for itself, and
valgrind.
"""

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import tally_command, tally_file
from benchmarks.studies.scale_tally import CellCost, CellKind, CellTally, load_cells
from mjbench.errors import InputError, MachineError
from mjbench.instrument import machine
from mjbench.paired.outcomes import Metric
from mjbench.paths import BASE
from mjbench.releases import installs
from mjbench.simulation import models
from mjbench.status import ExitCode
from mjbench.sweep.cells import Cell, Kind

if TYPE_CHECKING:
    from mjbench.instrument.runs import Run

ROOT = Path(__file__).resolve().parent.parent
TALLY = ROOT / "results" / "cells.json"
OLD, NEW = "3.14.0", "4.0.0"
# The exit codes of a command that has measured all that it was asked to.
_MEASURED = (ExitCode.OK, ExitCode.FINDING)


@dataclass(frozen=True)
class _CommandRun:
    """A command that was run.

    Attributes:
      lines: of its run file.
      run: the same, read.
      code: its exit code.
      seconds: that it took.
    """

    lines: Sequence[bytes]
    run: "Run"
    code: int
    seconds: float


def measured(model: str, old: str, new: str, kind: CellKind, step_us: float | None) -> CellCost:
    """Return what a cell of one model takes.

    Args:
      model: a shipped one.
      old: release of the verdict's baseline; counts are of both releases.
      new: release of its candidate.
      kind: of the cell.
      step_us: microseconds of a step; None where a comparison is to say it.

    Raises:
      MachineError: a command failed, or left no result.
    """
    match kind:
        case CellKind.VERDICT:
            ran = _run("versions", "--old", old, "--new", new, model)
            cells = [Cell(Kind.VERSIONS, model, new, old, path=BASE, metric=Metric.TIME)]
        case CellKind.COUNT:
            ran = _run("instructions", "--release", old, "--release", new, model)
            cells = [Cell(Kind.INSTRUCTIONS, model, release) for release in (old, new)]
        case CellKind.COMPARISON:
            ran = _run("compare", model)
            cells = [Cell(Kind.COMPARE, model)]
            step_us = _step_us(ran.run)
    assert step_us is not None, "a comparison is measured first"
    return _cost(kind, cells, ran, step_us)


def _cost(kind: CellKind, cells: Sequence[Cell], ran: _CommandRun, step_us: float) -> CellCost:
    """Return what cells take by their records, and what their command takes beside that.

    Raises:
      MachineError: a cell has no result.
    """
    from mjbench.instrument.run_set import RunSetFile
    from mjbench.report.documents import RECORD_TYPES
    from mjbench.sweep.results import Collector

    for _ in range(2):  # the first time prepares what reads records
        with tempfile.TemporaryDirectory() as folder:
            file = RunSetFile.create(Path(folder) / "set.jsonl")
            begin = time.perf_counter()
            collector = Collector(cells, RECORD_TYPES)
            results = [*collector.add(ran.lines), *collector.end(ran.code)]
            for result in results:
                file.append(result.section)
            store_s = (time.perf_counter() - begin) / len(cells)
            file.close()
    if len(results) != len(cells):
        raise MachineError(f"{cells[0].model}: {kind}: {len(results)} of {len(cells)} results")
    written = [sum(map(len, result.section.lines)) for result in results]
    # a comparison says of none of its parts how long all of it took
    seconds = [result.outcome.seconds or ran.seconds for result in results]
    return CellCost(
        kind,
        cells[0].model,
        step_us,
        start_s=ran.seconds - sum(seconds),
        cell_s=statistics.fmean(seconds),
        cell_bytes=round(statistics.fmean(written)),
        store_s=store_s,
    )


def _run(*arguments: str) -> _CommandRun:
    """Run a command.

    Raises:
      MachineError: it failed.
    """
    from mjbench.instrument import runs
    from mjbench.report.documents import RECORD_TYPES

    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "mjbench", *arguments, "--results", folder],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - begin
        if done.returncode not in _MEASURED:
            reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise MachineError(f"mjbench {' '.join(arguments)}: {reason}")
        (file,) = Path(folder).glob("*.jsonl")
        return _CommandRun(
            lines=file.read_bytes().splitlines(keepends=True),
            run=runs.load(file, RECORD_TYPES),
            code=done.returncode,
            seconds=seconds,
        )


def _step_us(comparison: "Run") -> float:
    """Return the microseconds of a step in the plain loop of a comparison."""
    from mjbench.paired.race import RaceRecord

    (race,) = comparison.of_type(RaceRecord)
    assert race.base_step_ns is not None, "the plain loop was timed"
    return 1e-3 * race.base_step_ns


def _install_bytes(release: str) -> int:
    """Return how large an installed release is; it is installed where it is not."""
    folder = installs.install(installs.parse_release(release))
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def run(names: Sequence[str], old: str, new: str, kinds: Sequence[CellKind] = ()) -> CellTally:
    """Measure models, and write the tally after each.

    Args:
      names: of models; empty for all.
      old: release of the verdicts' baseline.
      new: release of their candidate.
      kinds: what to measure; empty for all. What is not measured stays as it was.

    Raises:
      InputError: a model is not shipped, or what stays was measured in other releases, or is
        missing.
      MachineError: valgrind is missing, or a command failed.
    """
    if shutil.which("valgrind") is None:
        raise MachineError("counts need valgrind")
    shipped = models.shipped()
    unknown = sorted({*names} - {*shipped})
    if unknown:
        raise InputError(f"no shipped model is named {unknown[0]}; there are {', '.join(shipped)}")
    cells = _earlier(old, new) if names or kinds else {}
    install_bytes = round(statistics.fmean(map(_install_bytes, (old, new))))
    for name in names or shipped:
        costs = cells.setdefault(name, {})
        if kinds and {*kinds, *costs} != {*CellKind}:
            raise InputError(f"{TALLY.name} lacks {name}: measure all kinds first")
        # the comparison says how long a step takes
        for kind in sorted(kinds or CellKind, key=lambda kind: kind != CellKind.COMPARISON):
            compared = costs.get(CellKind.COMPARISON)
            costs[kind] = measured(name, old, new, kind, compared.step_us if compared else None)
        tally = CellTally(
            date=datetime.now(UTC).date().isoformat(),
            processor=machine.describe().cpu,
            usable_cores=machine.usable_cores(),
            old=old,
            new=new,
            install_bytes=install_bytes,
            cells=[of_model[kind] for of_model in cells.values() for kind in CellKind],
        )
        TALLY.write_text(tally_file.dumps(tally), encoding="utf-8")
        for kind, cell in costs.items():
            print(f"{name}: {kind}: {cell.start_s:.1f} s and {cell.cell_s:.1f} s", flush=True)
    return tally


def _earlier(old: str, new: str) -> dict[str, dict[CellKind, CellCost]]:
    """Return what the tally has; see `run` for the arguments and errors."""
    cells: dict[str, dict[CellKind, CellCost]] = {}
    if TALLY.exists():
        tally = load_cells(TALLY)
        if (tally.old, tally.new) != (old, new):
            raise InputError(
                f"{TALLY.name} is of {tally.old} and {tally.new}: give these, or no model"
            )
        for cell in tally.cells:
            cells.setdefault(cell.model, {})[cell.kind] = cell
    return cells


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*")
    parser.add_argument("--old", default=OLD, help="release of the baseline")
    parser.add_argument("--new", default=NEW, help="release of the candidate")
    parser.add_argument(
        "--kind",
        action="append",
        choices=[kind.name.lower() for kind in CellKind],
        help="measure only this; may be given several times",
    )
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        kinds = [CellKind[name.upper()] for name in options.kind or ()]
        run(options.models, options.old, options.new, kinds)
        return ExitCode.OK

    return tally_command.run("cell_cost", action, "the tally has what was measured")


if __name__ == "__main__":
    sys.exit(main())
