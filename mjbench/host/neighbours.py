"""Notice other mjbench that measure on this machine at the same time: they disturb each other.

Every process that measures has a file in a shared folder, which it keeps locked. A process that
begins reads the files of the others, and appends a line to each. At its end it reads its own file,
which then names those that began later. Where the folder cannot be used, nothing is noticed.

Any user of the machine can write into the folder, so nothing in it is trusted: only files with the
names that this module gives are read, a few kilobytes of each, and no lock is awaited for long.
"""

import contextlib
import json
import os
import re
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import ClassVar

from mjbench.bounds import NonNegativeFloat
from mjbench.errors import one_line
from mjbench.host import platforms

# Environment variable that names the folder in which the shared folder is.
FOLDER_VARIABLE = "MJBENCH_LOCKS"
_FOLDER = "mjbench-measuring"
# How often a process that waits looks again, in seconds.
_POLL_S = 1.0
# Processes begin one at a time; how long one tries to be the one, in seconds, and how often.
_ENTRY_LOCK, _ENTRY_LIMIT_S, _ENTRY_POLL_S = "entry", 5.0, 0.05
_NAME = re.compile(r"\d+-\d+\.json")
_MAX_BYTES = 4096


@dataclass(frozen=True)
class Neighbour:
    """Another process that measures."""

    pid: int
    command: str


@dataclass(frozen=True)
class Disturbance:
    """What disturbed a run: its last record, where anything did.

    Attributes:
      commands: of other mjbench that measured on this machine meanwhile; empty for a process that
        could not be identified.
      stolen_share: of the processor time, which the host gave to others; None where that was small.
    """

    record_type: ClassVar[str] = "disturbance"
    commands: Sequence[str] = ()
    stolen_share: NonNegativeFloat | None = None

    @property
    def sentences(self) -> list[str]:
        """What people should know before the numbers."""
        sentences = []
        if self.commands:
            names = (f"mjbench {name}" if name else "an unidentified one" for name in self.commands)
            sentences.append(
                "Another mjbench measured on this machine at the same time"
                f" ({', '.join(dict.fromkeys(names))}): these timings are unreliable."
            )
        if self.stolen_share is not None:
            sentences.append(
                f"The host took {100 * self.stolen_share:.0f} % of this machine's processor time"
                " for others: timings are noisier for it, and verdicts take longer."
            )
        return sentences


def describe(others: Sequence[Neighbour]) -> str:
    return ", ".join(
        f"mjbench {other.command}, process {other.pid}" if other.pid else "an unidentified process"
        for other in others
    )


def shared_folder() -> Path:
    root = Path("/tmp")  # not TMPDIR, which may be each user's own
    if named := os.environ.get(FOLDER_VARIABLE):
        root = Path(named)
    elif not root.is_dir():
        root = Path(tempfile.gettempdir())
    return root / _FOLDER


def measuring_now(folder: Path | None = None) -> list[Neighbour]:
    if sys.platform == "win32":
        return []
    folder = folder or shared_folder()
    try:
        with _entry_lock(folder, time.sleep):
            return [*_others(folder).values()]
    except OSError:
        return []


class Presence:
    """This process among those that measure; a context manager, which leaves at its end."""

    def __init__(self, command: str, folder: Path | None = None):
        self._me = Neighbour(os.getpid(), command)
        self._folder = folder or shared_folder()
        self._file: Path | None = None
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> "Presence":
        return self

    def __exit__(self, *exception: object) -> None:
        with contextlib.suppress(OSError), self._closing:
            if self._file is not None:
                self._file.unlink(missing_ok=True)

    def enter(
        self,
        wait: bool,
        on_wait: Callable[[Sequence[Neighbour]], None] = lambda others: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> list[Neighbour]:
        """Begin to measure; return the others that measure now."""
        if sys.platform == "win32":  # it has no such locks, and no command there measures
            return []
        has_waited = False
        try:
            while True:
                with _entry_lock(self._folder, sleep):
                    others = _others(self._folder)
                    if not (wait and others):
                        self._announce(others)
                        return [*others.values()]
                if not has_waited:
                    on_wait([*others.values()])
                has_waited = True
                sleep(_POLL_S)
        except OSError:
            return []

    def later_neighbours(self) -> list[Neighbour]:
        if self._file is None:
            return []
        try:
            _, *lines = _lines(self._file)
        except (OSError, ValueError):
            return []
        return [neighbour for line in lines if (neighbour := _parse(line))]

    def _announce(self, others: Iterable[Path]) -> None:
        line = json.dumps(asdict(self._me)) + "\n"
        file = self._folder / f"{self._me.pid}-{time.monotonic_ns()}.json"
        _create_file(file)
        descriptor = self._closing.enter_context(_opened(file, os.O_RDWR | os.O_APPEND))
        platforms.lock_file(descriptor, shared=False, wait=False)
        os.write(descriptor, line.encode())
        self._file = file
        for other in others:
            with contextlib.suppress(OSError), _opened(other, os.O_WRONLY | os.O_APPEND) as opened:
                os.write(opened, line.encode())


def _others(folder: Path) -> dict[Path, Neighbour]:
    others = {}
    for path in sorted(folder.iterdir()):
        if not _NAME.fullmatch(path.name):
            continue
        with contextlib.suppress(OSError):
            try:
                with _opened(path, os.O_RDONLY) as descriptor:
                    platforms.lock_file(descriptor, shared=True, wait=False)
                    path.unlink(missing_ok=True)  # its lock is free: its process is gone
            except BlockingIOError:
                first, *_ = [*_lines(path), ""]
                others[path] = _parse(first) or Neighbour(0, "")
    return others


def _lines(path: Path) -> list[str]:
    with _opened(path, os.O_RDONLY) as descriptor:
        return os.read(descriptor, _MAX_BYTES).decode(errors="replace").splitlines()


def _parse(line: str) -> Neighbour | None:
    try:
        value = json.loads(line)
        return Neighbour(int(value["pid"]), one_line(value["command"], limit=40))
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return None


def _create_shared_folder(folder: Path) -> None:
    """Create a folder in which every user may create files, and remove only their own."""
    with contextlib.suppress(FileExistsError):
        folder.mkdir(parents=True)
        folder.chmod(0o1777)
    mode = folder.lstat().st_mode
    if not stat.S_ISDIR(mode) or (mode & stat.S_IWOTH and not mode & stat.S_ISVTX):
        raise OSError(f"{folder} is not a folder for all users")


def _create_file(path: Path) -> None:
    """Create a file that every user may write, unless it exists."""
    with contextlib.suppress(FileExistsError):
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC)
        os.close(descriptor)
        path.chmod(0o666)


@contextlib.contextmanager
def _entry_lock(folder: Path, sleep: Callable[[float], None]) -> Iterator[None]:
    """Let one process at a time begin in the shared folder, which is created if it is missing."""
    _create_shared_folder(folder)
    path = folder / _ENTRY_LOCK
    _create_file(path)
    with _opened(path, os.O_RDONLY) as descriptor:
        for _ in range(round(_ENTRY_LIMIT_S / _ENTRY_POLL_S)):
            try:
                platforms.lock_file(descriptor, shared=False, wait=False)
                break
            except BlockingIOError:
                sleep(_ENTRY_POLL_S)
        else:
            raise OSError(f"{path} stays locked")
        yield


@contextlib.contextmanager
def _opened(path: Path, flags: int) -> Iterator[int]:
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(f"{path} is not a regular file")
        yield descriptor
    finally:
        os.close(descriptor)
