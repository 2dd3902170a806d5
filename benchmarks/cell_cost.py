"""What a cell of a sweep takes on the shipped models: a verdict, a count, a comparison.

    python -m benchmarks.cell_cost [MODEL …] [--old RELEASE] [--new RELEASE]

runs `mjbench versions`, `mjbench instructions` and `mjbench compare` on each model, one after the
other, and writes results/cells.json: seconds, and bytes of the run file. Named models replace their
rows. It takes about half an hour, and needs the machine for itself, valgrind, and both releases.
"""

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.scale_tally import CellCost, CellKind, CellTally, load_cells
from mjbench.errors import InputError, MachineError, MjbenchError
from mjbench.instrument import machine
from mjbench.paths import BASE
from mjbench.releases import installs
from mjbench.simulation import models
from mjbench.status import ExitCode

ROOT = Path(__file__).resolve().parent.parent
TALLY = ROOT / "results" / "cells.json"
OLD, NEW = "3.3.0", "4.0.0"
# The exit codes of a command that has measured all that it was asked to.
_MEASURED = (ExitCode.OK, ExitCode.FINDING)


def measured(model: str, old: str, new: str) -> list[CellCost]:
    """Return what the cells of one model take.

    Args:
      model: a shipped one.
      old: release of the verdict's baseline; counts are of both releases.
      new: release of its candidate.

    Raises:
      MachineError: a command failed.
    """
    compared, compared_s = _run("compare", model)
    verdicts, verdicts_s = _run("versions", "--old", old, "--new", new, model)
    counts, counts_s = _run("instructions", "--release", old, "--release", new, model)
    step_us = _step_us(compared)
    return [
        _cost(CellKind.VERDICT, model, step_us, verdicts, verdicts_s),
        _cost(CellKind.COUNT, model, step_us, counts, counts_s),
        CellCost(
            CellKind.COMPARISON, model, step_us, 0.0, compared_s, sum(map(len, compared.values()))
        ),
    ]


def _cost(
    kind: CellKind,
    model: str,
    step_us: float,
    lines: Mapping[str, Sequence[bytes]],
    command_s: float,
) -> CellCost:
    """Return what a cell takes by its record, and what the command takes beside that."""
    (cells,) = (records for name, records in lines.items() if name != "run")
    seconds = [json.loads(line)["seconds"] for line in cells]
    return CellCost(
        kind,
        model,
        step_us,
        start_s=command_s - sum(seconds),
        cell_s=statistics.fmean(seconds),
        cell_bytes=round(statistics.fmean(map(len, cells))),
    )


def _run(*words: str) -> tuple[dict[str, list[bytes]], float]:
    """Run a command; return the lines of its run file by their type, and its seconds.

    Raises:
      MachineError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "mjbench", *words, "--results", folder],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - begin
        if done.returncode not in _MEASURED:
            reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise MachineError(f"mjbench {' '.join(words)}: {reason}")
        (file,) = Path(folder).glob("*.jsonl")
        lines: dict[str, list[bytes]] = {}
        for line in file.read_bytes().splitlines(keepends=True):
            lines.setdefault(json.loads(line)["type"], []).append(line)
    return lines, seconds


def _step_us(lines: Mapping[str, Sequence[bytes]]) -> float:
    """Return the microseconds of a step in the plain loop, by the records of a comparison."""
    records = map(json.loads, lines["measurement"])
    (base,) = (each for each in records if (each["path"], each["options"]) == (BASE, {}))
    steps = base["nbatch"] * base["nstep"]
    return 1e6 * statistics.median(base["samples_s"]) / steps


def _install_bytes(release: str) -> int:
    """Return how large an installed release is; it is installed where it is not."""
    folder = installs.install(installs.parse_release(release))
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def run(names: Sequence[str], old: str, new: str) -> CellTally:
    """Measure models, and write the tally after each.

    Args:
      names: of models; empty for all.
      old: release of the verdicts' baseline.
      new: release of their candidate.
    """
    if shutil.which("valgrind") is None:
        raise MachineError("counts need valgrind")
    shipped = models.shipped()
    unknown = sorted({*names} - {*shipped})
    if unknown:
        raise InputError(f"no shipped model is named {unknown[0]}; there are {', '.join(shipped)}")
    cells: dict[str, list[CellCost]] = {}
    for cell in load_cells(TALLY).cells if names and TALLY.exists() else ():
        cells.setdefault(cell.model, []).append(cell)
    install_bytes = round(statistics.fmean(map(_install_bytes, (old, new))))
    for name in names or shipped:
        cells[name] = measured(name, old, new)
        tally = CellTally(
            date=datetime.now(UTC).date().isoformat(),
            processor=machine.describe().cpu,
            usable_cores=machine.usable_cores(),
            old=old,
            new=new,
            install_bytes=install_bytes,
            cells=[cell for of_model in cells.values() for cell in of_model],
        )
        save(tally)
        for cell in cells[name]:
            print(f"{name}: {cell.kind}: {cell.start_s:.1f} s and {cell.cell_s:.1f} s", flush=True)
    return tally


def save(tally: CellTally) -> None:
    """Write the tally."""
    from mjbench.instrument.runs import to_json

    TALLY.write_text(json.dumps(to_json(tally), indent=1, ensure_ascii=False) + "\n")


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*")
    parser.add_argument("--old", default=OLD, help="release of the baseline")
    parser.add_argument("--new", default=NEW, help="release of the candidate")
    options = parser.parse_args(arguments)
    try:
        run(options.models, options.old, options.new)
    except MjbenchError as error:
        print(f"cell_cost: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("cell_cost: interrupted; the tally has what was measured", file=sys.stderr)
        return ExitCode.INTERRUPTED
    return ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
