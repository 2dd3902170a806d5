"""Notice other mjbench that measure on this machine at the same time: both figures suffer.

Every process that measures has a file in a shared folder, which it keeps locked. A process that
begins reads the others' files, and leaves a line in each; at its end, it finds in its own the lines
of those that came later. Where the folder cannot be used, nothing is noticed.
"""

import contextlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mjbench.instrument import platforms

# Environment variable that names another folder.
FOLDER_VARIABLE = "MJBENCH_LOCKS"
# How often a process that waits looks again, in seconds.
_POLL_S = 1.0
_DOOR = "door"
_SUFFIX = ".json"


@dataclass(frozen=True)
class Neighbour:
    """Another process that measures.

    Attributes:
      pid: of the process.
      command: of mjbench.
    """

    pid: int
    command: str


def shared_folder() -> Path:
    """Return the folder that all users of this machine share."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    root = Path("/tmp")  # not TMPDIR, which may be each user's own
    return (root if root.is_dir() else Path(tempfile.gettempdir())) / "mjbench-measuring"


class Presence:
    """This process among those that measure; a context manager, which leaves at its end."""

    def __init__(self, command: str, folder: Path | None = None):
        """Prepare to take part.

        Args:
          command: of mjbench, for the others to name.
          folder: shared by all that measure; None for that of this machine.
        """
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
        """Begin to measure; return the others that measure now.

        Args:
          wait: whether to begin only when no other measures.
          on_wait: called once with the others that are waited for.
          sleep: waits for seconds.
        """
        has_waited = False
        if sys.platform == "win32":  # it has no such locks, and no command there measures
            return []
        try:
            while True:
                _create(self._folder)
                with _locked(self._folder / _DOOR):  # one at a time looks and enters
                    others = list(self._others())
                    if not (wait and others):
                        self._announce(others)
                        return [neighbour for _, neighbour in others]
                if not has_waited:
                    on_wait([neighbour for _, neighbour in others])
                has_waited = True
                sleep(_POLL_S)
        except OSError:
            return []

    def arrivals(self) -> list[Neighbour]:
        """Return the others that began to measure after this process did."""
        if self._file is None:
            return []
        try:
            _, *lines = self._file.read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            return []
        return [neighbour for line in lines if (neighbour := _parse(line))]

    def _announce(self, others: Sequence[tuple[Path, Neighbour]]) -> None:
        """Create this process's file, and leave a line in those of the others."""
        line = json.dumps(asdict(self._me)) + "\n"
        file = self._folder / f"{self._me.pid}-{time.monotonic_ns()}{_SUFFIX}"
        self._closing.enter_context(_locked(file))
        with file.open("a", encoding="utf-8") as mine:
            mine.write(line)
        self._file = file
        for other, _ in others:
            with contextlib.suppress(OSError), _opened(other, os.O_WRONLY | os.O_APPEND) as opened:
                os.write(opened, line.encode())

    def _others(self) -> Iterator[tuple[Path, Neighbour]]:
        """Yield the files of processes that measure; remove those of processes that are gone."""
        for path in sorted(self._folder.glob(f"*{_SUFFIX}")):
            with contextlib.suppress(OSError):
                try:
                    with _opened(path, os.O_RDONLY) as descriptor:
                        platforms.lock_file(descriptor, shared=True, wait=False)
                        path.unlink(missing_ok=True)  # its lock is free: its process is gone
                except BlockingIOError:
                    first, *_ = [*path.read_text(errors="replace").splitlines(), ""]
                    yield path, _parse(first) or Neighbour(0, "")


def names(others: Sequence[Neighbour]) -> str:
    """Return the others in a line, such as `mjbench compare (process 4711)`."""
    return ", ".join(f"mjbench {other.command} (process {other.pid})" for other in others)


def _parse(line: str) -> Neighbour | None:
    try:
        value = json.loads(line)
        return Neighbour(int(value["pid"]), str(value["command"]))
    except (ValueError, TypeError, KeyError):
        return None


def _create(folder: Path) -> None:
    """Create the shared folder, in which every user may create files, but remove only their own."""
    if not folder.is_dir():
        folder.mkdir(parents=True)
        folder.chmod(0o1777)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock on a file; it is created, writable for every user, where it is missing."""
    with contextlib.suppress(FileExistsError):
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
        path.chmod(0o666)
        os.close(descriptor)
    with _opened(path, os.O_RDONLY) as descriptor:
        platforms.lock_file(descriptor, shared=False, wait=True)
        yield


@contextlib.contextmanager
def _opened(path: Path, flags: int) -> Iterator[int]:
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        yield descriptor
    finally:
        os.close(descriptor)
