"""Read histories of speed from what `mjbench history measure` and `history explain` stored."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from benchmarks.history import known_causes, speed_history
from benchmarks.history.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from benchmarks.history.speed_history import SpeedHistory
from benchmarks.history.speed_series import in_order
from mjbench.counts.records import ExplainRecord
from mjbench.errors import InputError, shown, suggestion
from mjbench.store import runs
from mjbench.store.machine_identity import MachineIdentity, identify
from mjbench.store.runs import Run


def run_files(folder: Path) -> list[Path]:
    """Return the run files of a folder: committed ones first, then by when they began."""
    return sorted(
        folder.glob("*.jsonl"), key=lambda file: (not file.name.startswith("reference-"), file.name)
    )


def read(files: Sequence[Path], causes: Path | None) -> SpeedHistory:
    """Return the history that files hold of the only machine; see `read_each` and `choose`."""
    return choose(read_each(files, causes), None)


def choose(histories: Sequence[SpeedHistory], machine: str | None) -> SpeedHistory:
    """Return the history of the machine of some name, or of the only one.

    Raises:
      InputError: there is no such machine, or several and none is named.
    """
    named = {each.name: each for each in histories}
    if machine is None and len(histories) == 1:
        return histories[0]
    if machine in named:
        return named[machine]
    names = ", ".join(named)
    if machine is None:
        raise InputError(f"there are several machines: {names}; give --machine NAME for one")
    raise InputError(f"no machine {shown(machine)}{suggestion(machine, named)}; there are {names}")


def read_each(
    files: Sequence[Path], causes: Path | None, since: str | None = None
) -> list[SpeedHistory]:
    """Return the histories that run files hold.

    Args:
      files: in the order that they were written; of several builds of a release the last counts.

    Returns:
      One of each machine, in the order that they were first measured.

    Raises:
      InputError: a file cannot be read; nothing was measured, or not `since`.
    """
    return of_runs([runs.load(file, RECORD_TYPES) for file in files], causes, since)


def of_runs(
    measured: Sequence[Run], causes: Path | None, since: str | None = None
) -> list[SpeedHistory]:
    """Return the histories that runs hold; see `read_each`.

    A machine on which only operations were timed has no history of its own: its operations are
    part of every history that has none.
    """
    known = known_causes.load(causes) if causes else []
    # counts hold for any machine
    counts = [record for run in measured for record in run.of_type(ExplainRecord)]
    timed = [run for run in measured if run.of_type(RatioRecord)]
    by_machine: dict[MachineIdentity, list[Run]] = defaultdict(list)
    for machine, run in zip(identify([r.header.machine for r in timed]), timed, strict=True):
        by_machine[machine].append(run)
    steps = {machine: each for machine, each in by_machine.items() if _has(each, StepRatioRecord)}
    operations = next((each for machine, each in by_machine.items() if machine not in steps), [])
    histories = []
    for machine, of_machine in steps.items():
        borrowed = [] if _has(of_machine, OperationRatioRecord) else operations
        ratios = [r for run in (*of_machine, *borrowed) for r in run.of_type(RatioRecord)]
        history = speed_history.from_records(
            [*counts, *ratios],
            known,
            machine.name,
            of_machine[0].header.machine,
            since,
            borrowed[0].header.machine if borrowed else None,
        )
        histories.append(history)
    histories = [each for each in histories if each.releases()]
    if not any(each.models for each in histories):
        raise InputError("there are no times of steps; `mjbench history measure` measures some")
    releases = in_order({r for each in histories for r in each.releases()})
    if since is not None and since not in releases:
        raise InputError(f"{since} was not measured; these releases were: {', '.join(releases)}")
    return histories


def _has(runs: Sequence[Run], kind: type[RatioRecord]) -> bool:
    return any(run.of_type(kind) for run in runs)
