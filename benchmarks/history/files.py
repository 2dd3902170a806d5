"""Read the history of speed from what `benchmarks.history measure` and `explain` stored."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from benchmarks.history import known_causes, speed_history
from benchmarks.history.measurements import RECORD_TYPES
from benchmarks.history.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from benchmarks.history.speed_history import SpeedHistory
from mjbench.counts.records import ExplainRecord
from mjbench.errors import InputError
from mjbench.results import runs
from mjbench.results.machine_identity import MachineIdentity, identify
from mjbench.results.runs import Run

ROOT = Path(__file__).resolve().parents[2]


def run_files(folder: Path) -> list[Path]:
    """Return the run files of a folder: committed ones first, then by when they began."""
    return sorted(
        folder.glob("*.jsonl"), key=lambda file: (not file.name.startswith("reference-"), file.name)
    )


def read(files: Sequence[Path], causes: Path) -> SpeedHistory:
    """Return the history that run files hold.

    Args:
      files: in the order that they were written; of several builds of a release the last counts.

    Raises:
      InputError: a file cannot be read, no step was timed, or steps were on several machines.
    """
    return of_runs([runs.load(file, RECORD_TYPES) for file in files], causes)


def of_runs(measured: Sequence[Run], causes: Path) -> SpeedHistory:
    """Return the history that runs hold; see `read`.

    Counts hold for any machine. Operations that were timed on a machine of their own are part of
    the history where its machine has none.
    """
    timed = [run for run in measured if run.of_type(RatioRecord)]
    by_machine: dict[MachineIdentity, list[Run]] = defaultdict(list)
    for machine, run in zip(identify([r.header.machine for r in timed]), timed, strict=True):
        by_machine[machine].append(run)
    steps = {machine: each for machine, each in by_machine.items() if _has(each, StepRatioRecord)}
    if len(steps) != 1:
        names = ", ".join(machine.name for machine in steps)
        reason = f"steps were timed on several machines: {names}" if steps else "no step was timed"
        raise InputError(f"{reason}; give the run files of one machine")
    (of_machine,) = steps.values()
    others = next((each for each in by_machine.values() if each is not of_machine), [])
    borrowed = [] if _has(of_machine, OperationRatioRecord) else others
    return speed_history.from_records(
        [
            *(record for run in measured for record in run.of_type(ExplainRecord)),
            *(record for run in (*of_machine, *borrowed) for record in run.of_type(RatioRecord)),
        ],
        known_causes.load(causes),
        of_machine[0].header.machine,
        borrowed[0].header.machine if borrowed else None,
    )


def _has(runs_of_machine: Sequence[Run], kind: type[RatioRecord]) -> bool:
    return any(run.of_type(kind) for run in runs_of_machine)
