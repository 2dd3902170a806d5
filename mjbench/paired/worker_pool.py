"""Processes in the environment of any release, each answering requests (see `requests`)."""

import contextlib
import pickle
import random
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import writing
from mjbench.instrument import platforms, scratch
from mjbench.paired import launch_seeds, release_python, requests
from mjbench.paired.launch_seeds import LaunchSeeds
from mjbench.paired.worker_process import WorkerProcess
from mjbench.paired.worker_programs import WorkerProgram, WorkerPrograms
from mjbench.releases import installs, movable
from mjbench.releases.moved_image import ImmovableError
from mjbench.releases.moved_install import MovableInstall
from mjbench.releases.placement import Placement


class WorkerPool:
    """Starts processes in the environment of any release, and ends all of them when it closes.

    Used as a context manager.

    Attributes:
      limit_s: seconds without an answer after which a process is killed.
      immovable: why releases cannot be moved, by their key (see `moved_check`).
    """

    def __init__(self, limit_s: float = 60.0):
        self.limit_s = limit_s
        self.immovable: dict[str, ImmovableError] = {}
        self._closing = contextlib.ExitStack()
        self._processes: list[WorkerProcess] = []
        # By the key of a release: its install, what moves in it, and the file that holds that.
        self._installs: dict[str, Path | None] = {}
        self._movable: dict[str, MovableInstall] = {}
        self._moves: dict[str, tuple[Path, Path]] = {}
        # Releases whose files were checked. They cannot change while the install is in use.
        self._checked: set[str] = set()
        self._file_count = 0
        self._seeds = LaunchSeeds(0, 0)
        # Of launches, by the keys of their two releases.
        self._schedules: dict[tuple[str, str], Iterator[LaunchSeeds]] = {}

    def __enter__(self) -> "WorkerPool":
        with contextlib.ExitStack() as closing:
            self._root = closing.enter_context(scratch.folder())
            self._work = self._root / "work"
            with writing(self._root):
                release_python.link_mjbench(self._root)
                self._work.mkdir()
            self._programs = WorkerPrograms(self._root, self._work, self.limit_s)
            self._closing = closing.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        with self._closing:  # folders and locks last until no process uses them
            self.end(list(self._processes))
            self._programs.end()

    def new_file(self, suffix: str) -> Path:
        """Return a new path in a folder that lasts as long as this pool."""
        self._file_count += 1
        return self._work / f"{self._file_count}{suffix}"

    def new_folder(self) -> Path:
        """Return a new folder that lasts as long as this pool."""
        folder = self.new_file("")
        with writing(folder):
            folder.mkdir()
        return folder

    def forbids_programs(self) -> bool:
        """Return whether no library can be loaded from this pool's files (mount option noexec)."""
        return platforms.forbids_programs(self._work)

    def save(self, value: Any) -> Path:
        """Pickle a value to a new file, for a worker to read; return the file.

        Raises:
          MachineError: it cannot be written.
        """
        file = self.new_file(".pickle")
        with writing(file):
            file.write_bytes(pickle.dumps(value))
        return file

    @contextlib.contextmanager
    def saved(self, value: Any) -> Iterator[Path]:
        """Yield a file that holds a pickled value for as long as the block runs."""
        file = self.save(value)
        try:
            yield file
        finally:
            file.unlink(missing_ok=True)

    def start(
        self,
        release: installs.ReleaseSpec,
        name: str = "",
        placement: Placement | None = None,
        side: int = 0,
        cores: Collection[int] = (),
        seeds: LaunchSeeds | None = None,
    ) -> WorkerProcess:
        """Start a process that imports a release, without waiting for it (see `wait_for`).

        Args:
          release: of MuJoCo; installed first if it is missing.
          name: of the process, for error messages.
          placement: of the release's libraries; None for as shipped.
          side: 0 or 1 for baseline and candidate, which are never forked from one program.
          cores: that it may run on, for now; none for all that this process may use.
          seeds: of the launch that it is of; None for those used last.

        Raises:
          InputError: there is no such release.
          MachineError: it cannot be installed, or no process can be started.
          ImmovableError: its libraries cannot be moved.
        """
        install, output_file = self._install(release), self.new_file(".output")
        move = None
        if placement is not None:
            movable_file, others = self._movable_files(release)
            move = requests.Move(movable_file, others, self.new_file(".moved"), placement)
        self._seeds = seeds or self._seeds
        program = WorkerProgram(release.key, install, side, self._seeds.program)
        connection, process = self._programs.start(program, output_file, cores)
        name = name or f"MuJoCo {release.version}"
        moved_install = move.folder if move else None
        worker = WorkerProcess(connection, name, self.limit_s, process, output_file, moved_install)
        self._processes.append(worker)
        check_files = release.key not in self._checked
        worker.ask(requests.StartRelease(release.version, check_files, self._seeds.memory, move))
        return worker

    def seeds(
        self, releases: tuple[installs.ReleaseSpec, installs.ReleaseSpec]
    ) -> Iterator[LaunchSeeds]:
        """Return the seeds of the next launches of two releases.

        Programs that fork their workers are always started for both at the same time. Comparisons
        of the same two releases, one after the other, share them: to start a program takes as long
        as a launch.
        """
        keys = releases[0].key, releases[1].key
        if keys not in self._schedules:
            launches = launch_seeds.launches_of_a_program()
            self._schedules[keys] = launch_seeds.schedule(random.Random(), launches)
        return self._schedules[keys]

    def start_program_early(
        self, release: installs.ReleaseSpec, side: int, cores: Collection[int], seeds: LaunchSeeds
    ) -> None:
        """Start the program that workers of a later launch are forked from, where they are forked.

        Args:
          release: of MuJoCo.
          side: 0 or 1 for baseline and candidate.
          cores: that it may run on, for now; none for all that this process may use.
          seeds: of the launch.

        Raises:
          MachineError: no process can be started.
        """
        program = WorkerProgram(release.key, self._install(release), side, seeds.program)
        self._programs.start_early(program, cores)

    def movable(self, release: installs.ReleaseSpec) -> MovableInstall:
        """Return what moves in a release; it is installed first if it is missing.

        Raises:
          InputError: there is no such release.
          MachineError: it cannot be installed.
          ImmovableError: its libraries cannot be moved.
        """
        if release.key not in self._movable:
            site = movable.site_folder(self._install(release))
            self._movable[release.key] = movable.read(site)
        return self._movable[release.key]

    def wait_for(self, process: WorkerProcess, release: installs.ReleaseSpec) -> None:
        """Wait until a process has imported its release and answered all other requests.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: it failed, crashed or did not answer in time.
        """
        process.wait()
        self._checked.add(release.key)

    def end(self, processes: Sequence[WorkerProcess]) -> None:
        """End processes of this pool, all of them even where ending one is interrupted."""
        with contextlib.ExitStack() as ending:
            for process in processes:
                ending.callback(self._end, process)

    def _end(self, process: WorkerProcess) -> None:
        process.end()
        if process in self._processes:
            self._processes.remove(process)

    def _install(self, release: installs.ReleaseSpec) -> Path | None:
        """Return the folder of a release's install, which lasts as long as this pool."""
        if release.key not in self._installs:
            install = self._closing.enter_context(installs.use(release))
            self._installs[release.key] = install
        return self._installs[release.key]

    def _movable_files(self, release: installs.ReleaseSpec) -> tuple[Path, Path]:
        """Return the file that holds what moves in a release, and the folder of what does not."""
        if release.key not in self._moves:
            install, others = self.movable(release), self.new_file(".others")
            with writing(others):
                install.link_others(others)
            self._moves[release.key] = self.save(install), others
        return self._moves[release.key]
