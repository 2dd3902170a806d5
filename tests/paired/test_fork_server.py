"""Workers that are forked from programs: what they share, and what becomes of them."""

import importlib.metadata
import os
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import process_tree
import pytest
from commands import python
from paired_examples import INSTALLED

from mjbench.errors import MachineError
from mjbench.host import child, platforms
from mjbench.host.child_connection import ChildError
from mjbench.paired import fork_server, release_python
from mjbench.paired.fork_server_process import ForkedWorker, ForkServerProcess
from mjbench.paired.memory_layout import LaunchSeeds
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess

pytestmark = pytest.mark.skipif(not platforms.can_adopt(), reason="only Linux adopts orphans")


def address(process: WorkerProcess, library: str) -> str:
    """Return where a library lies in a process."""
    lines = Path(f"/proc/{process.pid}/maps").read_text().splitlines()
    return next(line.partition("-")[0] for line in lines if library in line)


def test_a_server_imports_numpy_but_not_mujoco() -> None:
    code = (
        "import importlib, sys; from mjbench.paired import fork_server;"
        "[importlib.import_module(name) for name in fork_server._MODULES];"
        "print(sorted({'mujoco', 'numpy', 'psutil'} & {*sys.modules}))"
    )
    assert python("-c", code).stdout.strip() == "['numpy']"


def stack_begin(process: WorkerProcess) -> int:
    """Return where the stack of a process begins; see proc_pid_stat(5)."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[28 - 3])


def environment(process: WorkerProcess) -> bytes:
    """Return the environment of the program that a process was forked from."""
    return Path(f"/proc/{process.pid}/environ").read_bytes()


def test_a_server_looks_for_plugins_of_mujoco_once(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[str] = []

    def search(group: str) -> tuple[str, ...]:
        searched.append(group)
        return ("plugin",)

    monkeypatch.setattr(importlib.metadata, "entry_points", search)
    fork_server._remember_entry_points()
    assert importlib.metadata.entry_points(group="mujoco.plugins") == ("plugin",)
    assert searched == ["mujoco.plugins"]


@pytest.mark.skipif(not platforms.can_fix_addresses(), reason="the kernel draws addresses here")
def test_both_sides_of_a_launch_have_the_same_addresses_and_hashes() -> None:
    launches = [LaunchSeeds(1, 5), LaunchSeeds(2, 5), LaunchSeeds(3, 6)]
    with WorkerPool() as pool:
        workers = [
            [pool.start(INSTALLED, side=side, seeds=seeds) for side in (0, 1)] for seeds in launches
        ]
        for worker in (worker for pair in workers for worker in pair):
            pool.wait_for(worker, INSTALLED)
            assert os.getsid(worker.pid) == worker.pid
        stacks = [[stack_begin(worker) for worker in pair] for pair in workers]
        libraries = [[address(worker, "libmujoco") for worker in pair] for pair in workers]
        environments = [[environment(worker) for worker in pair] for pair in workers]
    assert all(baseline == candidate for baseline, candidate in [*libraries, *stacks])
    assert len({baseline for baseline, _ in libraries}) == len(launches)
    assert len({baseline for baseline, _ in stacks}) == 2  # one for each program
    for seeds, pair in zip(launches, environments, strict=True):
        assert all(b"PYTHONHASHSEED=%d\0" % seeds.program in variables for variables in pair)


def test_one_program_forks_the_workers_of_a_side_until_their_seed_changes() -> None:
    before = process_tree.descendants()
    with WorkerPool() as pool:
        for program in (5, 5, 6):
            worker = pool.start(INSTALLED, seeds=LaunchSeeds(1, program))
            pool.wait_for(worker, INSTALLED)
            (server,) = process_tree.descendants() - before - {worker.pid}
            assert b"PYTHONHASHSEED=%d\0" % program in Path(f"/proc/{server}/environ").read_bytes()
            pool.end([worker])


def test_a_program_that_was_started_early_forks_the_workers_of_its_seed() -> None:
    before, later = process_tree.descendants(), LaunchSeeds(1, 6)
    with WorkerPool() as pool:
        worker = pool.start(INSTALLED, seeds=LaunchSeeds(1, 5))
        pool.wait_for(worker, INSTALLED)
        (server,) = process_tree.descendants() - before - {worker.pid}
        pool.start_program_early(INSTALLED, 0, (), later)
        (early,) = process_tree.descendants() - before - {worker.pid, server}
        pool.end([worker])
        worker = pool.start(INSTALLED, seeds=later)
        pool.wait_for(worker, INSTALLED)
        assert process_tree.descendants() - before == {worker.pid, early}
    assert process_tree.descendants() <= before


def test_of_programs_that_are_never_used_two_remain() -> None:
    before = process_tree.descendants()
    with WorkerPool() as pool:
        for program in range(4):
            pool.start_program_early(INSTALLED, program % 2, (), LaunchSeeds(1, program))
        pool.start_program_early(INSTALLED, 1, (), LaunchSeeds(1, 3))
        assert len(process_tree.descendants() - before) == 2
    assert process_tree.descendants() <= before


def test_another_program_takes_the_place_of_an_early_one_that_was_killed() -> None:
    before, later = process_tree.descendants(), LaunchSeeds(1, 6)
    with WorkerPool() as pool:
        pool.start_program_early(INSTALLED, 0, (), later)
        (early,) = process_tree.descendants() - before
        os.kill(early, signal.SIGKILL)
        os.waitid(os.P_PID, early, os.WEXITED | os.WNOWAIT)  # it has ended
        worker = pool.start(INSTALLED, seeds=later)
        pool.wait_for(worker, INSTALLED)
    assert process_tree.descendants() <= before


def test_workers_are_kept_on_the_cores_that_they_start_on() -> None:
    core = min(platforms.affinity())
    with WorkerPool() as pool:
        worker = pool.start(INSTALLED, cores=[core])
        pool.wait_for(worker, INSTALLED)
        assert os.sched_getaffinity(worker.pid) == {core}
        another = pool.start(INSTALLED)
        pool.wait_for(another, INSTALLED)
        assert os.sched_getaffinity(another.pid) == platforms.affinity()


def test_a_server_that_is_killed_is_named_and_another_one_takes_its_place() -> None:
    before = process_tree.descendants()
    with WorkerPool() as pool:
        first = pool.start(INSTALLED)
        pool.wait_for(first, INSTALLED)
        (server,) = process_tree.descendants() - before - {first.pid}
        os.kill(server, signal.SIGSTOP)  # so that it cannot fork before it is killed
        second = pool.start(INSTALLED, name="second")
        os.kill(server, signal.SIGKILL)
        with pytest.raises(ChildError, match=r"second: killed by signal 9 .* importing MuJoCo"):
            second.wait()
        pool.end([second])
        third = pool.start(INSTALLED)
        pool.wait_for(third, INSTALLED)
    assert process_tree.descendants() <= before


def test_what_a_server_printed_before_it_ended_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*arguments: object) -> list[str]:
        return [sys.executable, "-c", "print('NumPy is broken'); raise SystemExit(3)"]

    monkeypatch.setattr(release_python, "command", failing)
    with WorkerPool() as pool:
        workers = [pool.start(INSTALLED, name=name) for name in ("first", "second")]
        for worker in workers:
            with pytest.raises(ChildError, match=rf"{worker.name}: .*code 3 .*NumPy is broken"):
                worker.wait()


def test_workers_outlive_a_server_that_is_killed() -> None:
    before = process_tree.descendants()
    with WorkerPool() as pool:
        worker = pool.start(INSTALLED)
        pool.wait_for(worker, INSTALLED)
        (server,) = process_tree.descendants() - before - {worker.pid}
        os.kill(server, signal.SIGKILL)
        os.waitid(os.P_PID, server, os.WEXITED | os.WNOWAIT)  # it has ended
        other = pool.start(INSTALLED)
        pool.wait_for(other, INSTALLED)
        assert worker.call(Worker.count_cores, 1) > 0


def test_a_server_that_hangs_is_killed_once_the_limit_has_passed(tmp_path: Path) -> None:
    """The clock shows that it has, so nothing is waited for."""
    output_file, worker_output = tmp_path / "server.output", tmp_path / "worker.output"
    output_file.write_text("last words")
    ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
    process = child.Child([sys.executable, "-c", "import time; time.sleep(600)"])
    now_s = iter([0.0, 61.0])
    server = ForkServerProcess(process, ours, 60.0, output_file, clock=lambda: next(now_s))
    with theirs:
        worker = server.fork(theirs.fileno(), worker_output)
        assert worker.wait() == -signal.SIGKILL
    assert worker_output.read_text() == "last words"
    worker.end()
    server.end()


# A server, and the socket on which it is asked.
Silent = tuple[ForkServerProcess, socket.socket]


@pytest.fixture
def silent(tmp_path: Path) -> Iterator[Silent]:
    """Yield a server that answers nothing by itself, and the socket on which it is asked."""
    ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
    process = child.Child([sys.executable, "-c", "import time; time.sleep(600)"])
    server = ForkServerProcess(process, ours, 60.0, tmp_path / "server.output")
    with theirs:
        yield server, theirs
    server.end()


def test_the_answers_of_a_server_belong_to_the_workers_that_they_name(
    tmp_path: Path, silent: Silent
) -> None:
    """Whichever is waited for first."""
    server, theirs = silent
    workers = [server.fork(theirs.fileno(), tmp_path / f"{i}.output") for i in range(2)]
    pids = [os.getpid(), os.getppid()]
    for worker, pid in zip(workers, pids, strict=True):
        theirs.send(fork_server.PID.pack(pid) + worker.mark.encode())
    assert [workers[1].pid, workers[0].pid] == pids[::-1]


def test_an_interrupt_that_loses_a_worker_leaves_its_server_to_the_others(
    tmp_path: Path, silent: Silent, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, theirs = silent
    send_fds = socket.send_fds

    def interrupt(*arguments: Any) -> None:
        send_fds(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(socket, "send_fds", interrupt)
        server.fork(theirs.fileno(), tmp_path / "lost.output")
    worker = server.fork(theirs.fileno(), tmp_path / "worker.output")
    lost_mark, descriptors, _, _ = socket.recv_fds(theirs, 100, 2)
    for mark in (lost_mark, worker.mark.encode()):
        theirs.send(fork_server.PID.pack(os.getpid()) + mark)
    assert worker.pid == os.getpid()
    assert not server.has_ended
    for descriptor in descriptors:
        os.close(descriptor)


@pytest.mark.parametrize("is_adopted", [False, True])
def test_an_answer_that_ctrl_c_interrupts_is_not_lost(
    tmp_path: Path, silent: Silent, monkeypatch: pytest.MonkeyPatch, is_adopted: bool
) -> None:
    server, theirs = silent
    adopt = ForkedWorker.adopt

    def interrupted(worker: ForkedWorker, pid: int) -> None:
        if is_adopted:
            adopt(worker, pid)
        raise KeyboardInterrupt

    workers = [server.fork(theirs.fileno(), tmp_path / f"{i}.output") for i in range(2)]
    for worker in workers:
        theirs.send(fork_server.PID.pack(os.getpid()) + worker.mark.encode())
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(ForkedWorker, "adopt", interrupted)
        workers[0].pid  # noqa: B018
    if is_adopted:
        server.forget(workers[0])  # it has ended; its answer is still there
    assert [worker.pid for worker in workers] == [os.getpid()] * 2
    assert not server.has_ended


def test_a_server_that_cannot_be_asked_has_no_worker_to_wait_for(
    tmp_path: Path, silent: Silent
) -> None:
    server, theirs = silent
    theirs.close()
    with pytest.raises(MachineError, match="cannot start a process"):
        server.fork(0, tmp_path / "worker.output")
    server.retire()
    assert server.has_ended


def test_a_worker_that_raises_ends_and_does_not_go_on_as_its_server() -> None:
    """In a program of its own, where pytest's other threads and files are not forked."""
    code = r"""
import os, socket, sys
from mjbench.paired import fork_server
def fail(*arguments):
    os.write(1, b"a worker\n")
    raise SystemExit(7)
fork_server._work = fail
ours, theirs = socket.socketpair()
try:
    fork_server._fork("mark", [0, 1], theirs, os.getpid())
    os.write(1, b"the server\n")
except BaseException:
    os.write(1, b"a worker that goes on\n")
"""
    done = python("-c", code)
    assert sorted(done.stdout.splitlines()) == ["a worker", "the server"]
    assert "SystemExit: 7" in done.stderr
