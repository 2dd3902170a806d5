"""Workers that are forked from programs: what they share, and what becomes of them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import process_tree
import pytest
from commands import ROOT
from paired_examples import INSTALLED

from mjbench.instrument import platforms
from mjbench.paired import requests
from mjbench.paired.fork_server_process import MAX_FORKS
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import TargetError, WorkerProcess

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
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['numpy']"


def test_few_workers_share_the_addresses_of_numpy_and_not_those_of_mujoco() -> None:
    with WorkerPool() as pool:
        workers = [pool.start(INSTALLED) for _ in range(MAX_FORKS + 1)]
        workers.append(pool.start(INSTALLED, series=1))
        for worker in workers:
            pool.wait_for(worker, INSTALLED)
        numpy = [address(worker, "_multiarray_umath") for worker in workers]
        mujoco = [address(worker, "libmujoco") for worker in workers]
        assert all(os.getsid(worker.pid) == worker.pid for worker in workers)
    assert len(set(numpy[:MAX_FORKS])) == 1
    assert len(set(numpy[MAX_FORKS - 1 :])) == 3
    assert len(set(mujoco[:MAX_FORKS])) > 1


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
        with pytest.raises(TargetError, match=r"second: killed by signal 9 .* importing MuJoCo"):
            second.wait()
        pool.end([second])
        third = pool.start(INSTALLED)
        pool.wait_for(third, INSTALLED)
    assert process_tree.descendants() <= before


def test_a_worker_that_dies_is_named_with_the_signal() -> None:
    with WorkerPool() as pool:
        worker = pool.start(INSTALLED, name="worker")
        pool.wait_for(worker, INSTALLED)
        os.kill(worker.pid, signal.SIGSEGV)
        with pytest.raises(TargetError, match=r"worker: killed by signal 11 \(SIGSEGV\)"):
            worker.call(requests.CountCores(1))
