"""What systems other than Linux can do; `test_other_platforms.py` runs the commands on them."""

import os
import select
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import other_platforms
import pytest

from mjbench.errors import MachineError
from mjbench.host import platforms


@pytest.mark.parametrize("system", ["linux", "darwin"])
def test_every_command_runs_but_on_windows(monkeypatch: pytest.MonkeyPatch, system: str) -> None:
    monkeypatch.setattr(sys, "platform", system)
    platforms.check_command("compare")
    monkeypatch.setattr(sys, "platform", "win32")
    platforms.check_command("lint")
    with pytest.raises(MachineError, match="`mjbench compare` does not run on Windows; use WSL2"):
        platforms.check_command("compare")


@pytest.mark.parametrize(("system", "forbids"), [("linux", True), ("darwin", False)])
def test_a_folder_mounted_noexec_forbids_programs(
    monkeypatch: pytest.MonkeyPatch, system: str, forbids: bool
) -> None:
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(os, "ST_NOEXEC", 8, raising=False)
    monkeypatch.setattr(os, "statvfs", lambda folder: SimpleNamespace(f_flag=8))
    assert platforms.forbids_programs(Path("folder")) == forbids


def test_a_system_without_affinity_leaves_processes_where_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    assert platforms.affinity() == set()
    platforms.set_affinity(0, [0])
    assert "one core" in str(platforms.pinning_notes())


@pytest.mark.skipif(sys.platform != "linux", reason="a pidfd tells that a process has ended")
def test_where_the_kernel_does_not_end_a_child_it_ends_soon_after_its_parent() -> None:
    """The grandchild waits for a pipe that this test holds open, so only the thread ends it."""
    grandchild = (
        "import os, sys\n"
        "from mjbench.host import child\n"
        "child.die_with_parent()\n"
        "print(os.getpid(), flush=True)\n"
        "sys.stdin.read()\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", f"import subprocess, sys\n"
         f"subprocess.run([sys.executable, '-c', {grandchild!r}])"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=other_platforms.environment("darwin"),
    )  # fmt: skip
    process = os.pidfd_open(int(parent.stdout.readline()))
    assert select.select([process], [], [], 0)[0] == []
    parent.kill()
    parent.wait()
    ready, _, _ = select.select([process], [], [], 60.0)  # the wait is only for a test that fails
    os.close(process)
    parent.stdout.close()
    parent.stdin.close()
    assert ready


NO_RANDOM_ADDRESSES = 0x0040000


def personality_of_a_new_program() -> int:
    command = [sys.executable, "-c", "print(open('/proc/self/personality').read())"]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout, 16)


@pytest.mark.skipif(not platforms.can_fix_addresses(), reason="the kernel draws addresses here")
def test_only_programs_that_start_in_the_block_have_fixed_addresses() -> None:
    before = personality_of_a_new_program()
    with platforms.fixed_addresses():
        assert personality_of_a_new_program() & NO_RANDOM_ADDRESSES
    assert personality_of_a_new_program() == before


@pytest.mark.parametrize("personality", [None, lambda flags: -1])
def test_where_addresses_cannot_be_fixed_programs_start_all_the_same(
    monkeypatch: pytest.MonkeyPatch, personality: object
) -> None:
    monkeypatch.setattr(platforms, "_personality", lambda: personality)
    assert not platforms.can_fix_addresses()
    with platforms.fixed_addresses():
        assert subprocess.run([sys.executable, "-c", ""], check=False).returncode == 0
