"""Tasks that the tests of `isolate` run in child processes, with their requests and messages."""

import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError
from mjbench.host.isolate import Channel
from mjbench.status import Status


@dataclass(frozen=True)
class Text:
    """Some text, asked for or answered."""

    text: str


@dataclass(frozen=True)
class Process:
    """A process that the task started, or its own."""

    pid: int


@dataclass(frozen=True)
class WaitRequest:
    """The file to wait for."""

    file: Path


@dataclass(frozen=True)
class BlobsRequest:
    """How many bytes each message is to have."""

    sizes: tuple[int, ...]


@dataclass(frozen=True)
class Blob:
    """A message of a given size.

    Attributes:
      index: which of the messages this is.
      content: the same byte over and over.
    """

    index: int
    content: bytes

    @classmethod
    def of(cls, index: int, size: int) -> "Blob":
        """Return the message at `index`; its byte distinguishes it from the others."""
        return cls(index, bytes([index % 256]) * size)


def echo(request: Text, channel: Channel) -> None:
    print("this goes to the log, not to the parent")
    channel.send(request)


def add(one: int, other: float, channel: Channel) -> tuple[float, object]:
    if one == other:
        raise InputError(f"{one} is not to be added to {one}")
    return one + other, os.getpid()


def send_blobs(request: BlobsRequest, channel: Channel) -> None:
    for index, size in enumerate(request.sizes):
        channel.send(Blob.of(index, size))


def refuse(request: Any, channel: Channel) -> None:
    raise InputError("bad file: what to do")


def fail(request: Any, channel: Channel) -> None:
    channel.doing("work that fails")
    raise RuntimeError("two\nlines")


def crash(request: Any, channel: Channel) -> None:
    channel.send(Text("before the crash"))
    channel.doing("something dangerous", position=3)
    os.kill(os.getpid(), signal.SIGSEGV)


def hang(request: Any, channel: Channel) -> None:
    grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    channel.doing("nothing at all", position=0)
    channel.send(Process(grandchild.pid))
    while True:
        time.sleep(600)


def wait_for_file(request: WaitRequest, channel: Channel) -> None:
    channel.allow_silence(3600.0)
    channel.send(Process(os.getpid()))
    channel.allow_silence(3600.0)
    while not request.file.exists():
        time.sleep(0.01)
    channel.send(Text("done"))


def close_every_descriptor(request: Any, channel: Channel) -> None:
    channel.doing("something strange")
    os.closerange(3, 256)


def print_everywhere(request: Any, channel: Channel) -> None:
    channel.send(Text("before"))
    print("to the output")
    os.write(1, b"to descriptor 1")
    os.write(2, b"to descriptor 2")
    subprocess.run([sys.executable, "-c", "print('of a child')"], check=True, close_fds=False)
    channel.send(Text("after"))


def close_outputs(request: Any, channel: Channel) -> None:
    channel.send(Text("before"))
    os.close(1)
    os.close(2)
    sys.stdout.close()
    channel.doing("without an output")
    channel.send(Text("after"))


def change_folder(request: Any, channel: Channel) -> None:
    channel.send(Text("before"))
    Path("other").mkdir()
    os.chdir("other")
    channel.doing("elsewhere")
    assert not list(Path.cwd().iterdir())
    channel.send(Text("after"))


def fork(request: Any, channel: Channel) -> None:
    channel.send(Text("before"))
    pid = os.fork()
    if pid == 0:
        channel.send(Text("of the fork"))
        os.abort()  # not reached
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 1
    channel.send(Text("after"))


def raise_exception(request: Text, channel: Channel) -> None:
    threading.Thread(target=time.sleep, args=(600,)).start()
    raise {"SystemExit": SystemExit, "KeyboardInterrupt": KeyboardInterrupt}[request.text](3)


def start_a_session(request: Any, channel: Channel) -> None:
    command = [sys.executable, "-c", "import time; time.sleep(600)"]
    channel.send(Process(subprocess.Popen(command, start_new_session=True).pid))
    time.sleep(600)


def leave_a_daemon(request: Any, channel: Channel) -> None:
    """Fork twice, each time into a session of its own."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.setsid()
        if os.fork() == 0:
            os.write(writer, struct.pack("q", os.getpid()))
            time.sleep(600)
        os._exit(0)
    os.waitpid(pid, 0)
    channel.send(Process(struct.unpack("q", os.read(reader, 8))[0]))


def step_with_processes(request: Any, channel: Channel) -> None:
    """Start the workers of the path `processes`, and wait for ever."""
    from mjbench import paths
    from mjbench.paths.processes import Processes
    from mjbench.simulation import models, workload

    small = workload.make(models.load(models.resolve("cartpole")), nbatch=2, nstep=1)
    resources = paths.Resources(small)
    Processes().prepare(small, {"processes": 2}, resources)
    for process in multiprocessing.active_children():
        assert process.pid is not None
        channel.send(Process(process.pid))
    channel.allow_silence(3600.0)
    time.sleep(600)


def hang_at_a_timestep(*arguments: Any) -> None:
    """Answer as `setting_launch.run_launch`, but never finish one of the settings."""
    from mjbench.commands.tune.result import Attempt  # late: other tasks start without MuJoCo

    *_, request, channel = arguments
    for number, settings in enumerate(request.settings):
        channel.doing(f"trying {settings[0].label}", number)
        if settings[0].label == "timestep=0.008":
            time.sleep(600)
        channel.send(Attempt(settings, Status.OK))
