"""Tasks that the tests of `isolate` run in children."""

import os
import signal
import subprocess
import sys
import time
from typing import Any

from mjbench.errors import InputError


def echo(request: Any, channel: Any) -> None:
    print("this goes to the log, not into the conversation")
    channel.send(got=request)


def refuse(request: Any, channel: Any) -> None:
    raise InputError("bad file: what to do")


def fail(request: Any, channel: Any) -> None:
    raise RuntimeError("two\nlines")


def crash(request: Any, channel: Any) -> None:
    channel.send(before="the crash")
    channel.where("doing the dangerous thing")
    os.kill(os.getpid(), signal.SIGSEGV)


def leave(request: Any, channel: Any) -> None:
    sys.stderr.write("last words\n")
    sys.stderr.flush()
    os._exit(7)


def hang(request: Any, channel: Any) -> None:
    grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    channel.send(grandchild=grandchild.pid)
    while True:
        time.sleep(600)


def hoard(request: Any, channel: Any) -> None:
    kept = bytearray(1 << 29)
    kept[:: 1 << 12] = b"x" * len(kept[:: 1 << 12])  # touched, so that it is there
    channel.expect(3600.0)
    while True:
        time.sleep(600)


def ask_for_time(request: Any, channel: Any) -> None:
    channel.expect(3600.0)
    channel.send(child=os.getpid())
    channel.expect(3600.0)
    while not os.path.exists(request["file"]):  # noqa: PTH110
        time.sleep(0.01)
    channel.send(done=True)
