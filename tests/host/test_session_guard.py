"""A guard ends what a killed process leaves of its session, and nothing else."""

import os
import select
import signal
import subprocess
import sys

import pytest
from commands import PYTHONPATH
from process_tree import ends

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a guard")

# Starts a process in a group of its own, says which, and waits.
PROGRAM = """\
import subprocess, sys
from mjbench.host import session_guard
dismiss = session_guard.start()
command = [sys.executable, "-c", "import signal; signal.pause()"]
process = subprocess.Popen(command, process_group=0)
{}
print(process.pid, flush=True)
input()
"""


def what_is_left(code: str = "", has_session: bool = True) -> int:
    """Kill a program with a guard; return a descriptor of the process that it had started."""
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(code)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        start_new_session=has_session,
    )
    with program:
        assert program.stdout is not None
        started = os.pidfd_open(int(program.stdout.readline()))
        program.kill()
    return started


def test_what_a_killed_process_started_ends() -> None:
    assert ends(what_is_left())


@pytest.mark.parametrize(("code", "has_session"), [("dismiss()", True), ("", False)])
def test_without_a_guard_or_a_session_of_its_own_it_lives_on(code: str, has_session: bool) -> None:
    started = what_is_left(code, has_session)
    ended, _, _ = select.select([started], [], [], 0.0)
    assert not ended
    signal.pidfd_send_signal(started, signal.SIGKILL)
    assert ends(started)
