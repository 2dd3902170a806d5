"""Whether moved libraries do what the installed ones do: seen once for each release."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paired_examples import INSTALLED

from mjbench.host.child_connection import ChildError
from mjbench.paired import moved_check
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import movable
from mjbench.releases.moved_install import ImmovableError
from mjbench.releases.placement import AS_SHIPPED, RESIDUES, Placement
from mjbench.releases.release_names import ReleaseSpec
from mjbench.status import Status

STATES = np.arange(6.0).reshape(2, 3)


class Process:
    """Stands for a worker that steps to given states, or fails."""

    def __init__(self, states: np.ndarray | Exception):
        self._states, self.has_ended = states, False

    def call(self, task: Any, *arguments: Any) -> Any:
        if task == Worker.observe:
            if isinstance(self._states, Exception):
                raise self._states
            return SimpleNamespace(final_state=self._states)
        return SimpleNamespace(workload=None)

    def end(self) -> None:
        self.has_ended = True


class Pool:
    """Stands for a pool whose processes step to given states, one after the other."""

    def __init__(self, *states: np.ndarray | Exception, forbids_programs: bool = False):
        self._states, self._forbids_programs = list(states), forbids_programs
        self.immovable: dict[str, ImmovableError] = {}
        self.placements: list[Placement | None] = []
        self.processes: list[Process] = []

    def movable(self, release: object) -> str:
        return "install"

    def forbids_programs(self) -> bool:
        return self._forbids_programs

    def start(self, release: object, placement: Placement | None) -> Process:
        self.placements.append(placement)
        self.processes.append(Process(self._states.pop(0) if self._states else STATES))
        return self.processes[-1]

    def wait_for(self, process: Process, release: object) -> None: ...

    def save(self, value: object) -> Path:
        return Path("workload")

    def end(self, processes: Sequence[Process]) -> None:
        for process in processes:
            process.end()


@pytest.fixture(autouse=True)
def checked(monkeypatch: pytest.MonkeyPatch) -> set[Any]:
    """Replace what is noted in the cache by a set."""
    noted: set[Any] = set()
    monkeypatch.setattr(movable, "was_checked", noted.__contains__)
    monkeypatch.setattr(movable, "note_checked", noted.add)
    return noted


def check(pool: Any) -> None:
    moved_check.check_movable(pool, INSTALLED)


def test_every_residue_is_compared_with_the_libraries_as_installed(checked: set[Any]) -> None:
    pool = Pool()
    check(pool)
    as_installed, *moved = pool.placements
    assert as_installed is None
    assert [placement.residue for placement in moved if placement] == list(RESIDUES)
    assert len({p.engine_bytes // 64 for p in moved if p}) > 1
    assert checked == {"install"}
    assert all(process.has_ended for process in pool.processes)


def test_a_release_that_passed_is_not_checked_again() -> None:
    check(Pool())
    again = Pool()
    check(again)
    assert again.processes == []


@pytest.mark.parametrize(
    ("third", "message"),
    [
        (np.nextafter(STATES, 9.0), "with moved libraries it steps to other states"),
        (
            ChildError(Status.FAILED, "MuJoCo 9: killed by SIGSEGV"),
            "it fails: MuJoCo 9: killed by SIGSEGV",
        ),
    ],
)
def test_a_release_that_does_otherwise_when_it_is_moved_is_refused(
    checked: set[Any], third: np.ndarray | Exception, message: str
) -> None:
    pool = Pool(STATES, STATES, third)
    with pytest.raises(ImmovableError, match=message):
        check(pool)
    assert checked == set()
    assert all(process.has_ended for process in pool.processes)


def test_a_temporary_folder_without_programs_is_refused_even_after_a_check() -> None:
    check(Pool())
    with pytest.raises(ImmovableError, match="permits no programs: set TMPDIR"):
        check(Pool(forbids_programs=True))


def test_the_folder_of_a_moved_install_goes_with_its_process(pool: WorkerPool) -> None:
    process = pool.start(INSTALLED, placement=Placement(48, 4080))
    pool.wait_for(process, INSTALLED)
    maps = Path(f"/proc/{process.pid}/maps").read_text()
    folders = {line.split()[-1].partition("/mujoco/")[0] for line in maps.splitlines()}
    (moved,) = (Path(folder) for folder in folders if folder.endswith(".moved"))
    assert (moved / "mujoco").is_dir()
    pool.end([process])
    assert not moved.exists()


# averaging


def test_launches_are_moved_or_as_shipped_where_nothing_can_be_moved() -> None:
    moved = itertools.islice(PlacementControl(True).placements(), 90)
    assert sum(pair.is_moved for pair in moved) == 80
    assert set(itertools.islice(PlacementControl(False).placements(), 100)) == {AS_SHIPPED}


def test_only_moved_launches_count_for_a_verdict() -> None:
    assert PlacementControl(True).launches_with(6) == 7
    assert PlacementControl(False).launches_with(6) == 6


def test_both_releases_must_move(pool: WorkerPool, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(pool: WorkerPool, release: object) -> None:
        if release is not INSTALLED:
            raise ImmovableError("it is a program")

    monkeypatch.setattr(moved_check, "check_movable", refuse)
    other = ReleaseSpec("3.5.0", "3.5.0")
    assert moved_check.placement_control(pool, INSTALLED, INSTALLED) == PlacementControl(True)
    for pair in ((INSTALLED, other), (other, INSTALLED)):
        assert moved_check.placement_control(pool, *pair) == PlacementControl(
            False, "the code of MuJoCo 3.5.0 cannot be moved: it is a program"
        )


def test_elsewhere_than_on_linux_the_reason_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(movable.platform, "machine", lambda: "aarch64")
    with WorkerPool() as pool:
        averaged = moved_check.placement_control(pool, INSTALLED, INSTALLED)
    version = INSTALLED.version
    reason = "only libraries for Linux on x86-64 can be moved"
    problem = f"the code of MuJoCo {version} cannot be moved: {reason}"
    assert averaged == PlacementControl(False, problem)
