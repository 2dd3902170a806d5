"""A program that imports what all workers need, and forks them (Linux).

To import NumPy and the standard library takes more than half of a worker's start. MuJoCo is not
imported here: its libraries and its data lie elsewhere in each worker. `memory_layout` says how
many launches use one server.

This module runs inside the environment of any one release: it needs only the standard library.
"""

import contextlib
import functools
import gc
import importlib
import importlib.metadata
import os
import signal
import socket
import struct
import sys
import time
import traceback
from collections.abc import Iterator

from mjbench.host import child

# What workers import, or MuJoCo does.
_MODULES = (
    *("copy", "csv", "ctypes.util", "hashlib", "importlib.metadata", "json", "mmap", "pkgutil"),
    *("platform", "random", "subprocess", "typing", "warnings", "zipfile"),
    *("numpy", "numpy.random", "numpy.typing"),
    *("mjbench.paired.worker", "mjbench.releases.install_check", "mjbench.releases.moved_install"),
)
# A request is a mark, with two files: the worker's connection and its output. The answer is the
# worker's process id and the mark again.
PID = struct.Struct("<q")
MAX_MARK_BYTES, _FILES = 256, 2


def main(control: int, parent: int) -> None:
    """Fork a worker for every request on the inherited socket, until `parent` hangs up."""
    child.die_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in _MODULES:
        with contextlib.suppress(Exception):  # a worker that needs it says what is wrong
            importlib.import_module(name)
    _remember_entry_points()
    gc.collect()
    gc.freeze()  # collections in workers leave the memory alone that they share
    with socket.socket(fileno=control) as requests:
        requests.set_inheritable(False)
        while True:
            mark, descriptors, _, _ = socket.recv_fds(requests, MAX_MARK_BYTES, _FILES)
            if not mark:
                os._exit(0)
            pid = _fork(mark.decode(), descriptors, requests, parent)
            for descriptor in descriptors:
                os.close(descriptor)
            requests.send(PID.pack(pid) + mark)


def _remember_entry_points() -> None:
    """Have workers share one search for entry points, that of MuJoCo for its plugins.

    Otherwise every import of MuJoCo 4.0.0 reads the metadata of all distributions: 10 ms for 127 of
    them (`python -X importtime -c "import mujoco"`). This replaces `metadata.entry_points`, whose
    result for any group stays the same while nothing is installed: a moved install has the entry
    points of the original.
    """
    importlib.metadata.entry_points = functools.cache(  # type: ignore[assignment]
        importlib.metadata.entry_points
    )
    with contextlib.suppress(Exception):  # a distribution is damaged: MuJoCo says what it does then
        importlib.metadata.entry_points(group="mujoco.plugins")


def _fork(mark: str, descriptors: list[int], requests: socket.socket, parent: int) -> int:
    """Fork a worker whose parent is `parent`, not this process; return its process id."""
    reader, writer = os.pipe()
    middle = os.fork()
    if middle == 0:
        with _exiting():
            _orphan(writer)
            requests.close()
            os.close(reader)
            os.close(writer)
            connection, output = descriptors
            _work(mark, connection, output, parent)
    os.close(writer)
    (pid,) = PID.unpack(os.read(reader, PID.size))
    os.close(reader)
    os.waitpid(middle, 0)
    return int(pid)


@contextlib.contextmanager
def _exiting() -> Iterator[None]:
    """End this process after the block, whatever it raises: it must not go on as its parent."""
    status = 1
    try:
        yield
        status = 0
    except BaseException:
        traceback.print_exc()
        with contextlib.suppress(Exception):
            sys.stdout.flush()
    finally:
        os._exit(status)


def _orphan(writer: int) -> None:
    """Go on in a child of this process, which ends; write the child's process id to a pipe."""
    middle = os.getpid()
    pid = os.fork()
    if pid != 0:
        os.write(writer, PID.pack(pid))
        os._exit(0)  # its child is an orphan now, which is adopted
    while os.getppid() == middle:
        time.sleep(0)


def _work(mark: str, connection: int, output: int, parent: int) -> None:
    from mjbench.paired import worker

    os.setsid()
    os.environ[child.MARK] = mark
    for stream in (1, 2):
        os.dup2(output, stream)
    os.close(output)
    worker.main(connection, parent)
