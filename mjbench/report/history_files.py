"""Read a history of speed from the run files of `mjbench history measure` and `history explain`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import InputError
from mjbench.instrument import runs
from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import Run
from mjbench.releases import changelog, known_causes
from mjbench.releases.release_ratios import RatioRecord
from mjbench.report import speed_history
from mjbench.report.documents import RECORD_TYPES
from mjbench.report.speed_history import SpeedHistory


def run_files(folder: Path) -> list[Path]:
    """Return the run files of a folder: committed ones first, then by when they began."""
    return sorted(
        folder.glob("*.jsonl"), key=lambda file: (not file.name.startswith("reference-"), file.name)
    )


def read(files: Sequence[Path], causes: Path | None, since: str | None = None) -> SpeedHistory:
    """Return the history that run files hold, with MuJoCo's changelog if it is installed.

    Args:
      files: in the order that they were written; of several builds of a release the last counts.
      causes: a table of causes that no measurement names; None for none.
      since: the first release whose changes are listed; None for all.

    Raises:
      InputError: a file cannot be read, or is of another machine; nothing was measured, or not
        `since`.
    """
    loaded = {file: runs.load(file, RECORD_TYPES) for file in files}
    return of_runs(loaded, causes, since)


def of_runs(
    loaded: Mapping[Path, Run], causes: Path | None, since: str | None = None
) -> SpeedHistory:
    """Return the history that runs hold, by their files; see `read`."""
    known = known_causes.load(causes) if causes else []
    machine, records = _records(loaded)
    history = speed_history.from_records(records, changelog.installed(), known, machine, since)
    if not history.models:
        raise InputError("there are no times of steps; `mjbench history measure` measures some")
    releases = history.releases()
    if since is not None and since not in releases:
        raise InputError(f"{since} was not measured; these releases were: {', '.join(releases)}")
    return history


def _records(loaded: Mapping[Path, Run]) -> tuple[Machine | None, list[Any]]:
    """Return the machine and the records of runs, whose times must be of one machine."""
    records: list[Any] = []
    timed: dict[Path, Machine] = {}
    for file, run in loaded.items():
        records += run.records
        if run.of_type(RatioRecord):  # counts hold for any machine
            timed[file] = run.header.machine
    for file, machine in timed.items():
        first, of_first = next(iter(timed.items()))
        if (machine.cpu, machine.cores) != (of_first.cpu, of_first.cores):
            raise InputError(
                f"{first} and {file} are of different machines: measure with --results and a folder"
                " of your own, and give that folder here"
            )
    return next(iter(timed.values()), None), records
