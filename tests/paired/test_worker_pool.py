"""Workers that crash, hang or lie: one line names the target, and no process is left."""

import pickle
import socket
import struct
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import broken_worker
import process_tree
import pytest
from paired_examples import BRIEF, CARTPOLE

from mjbench.host import child_connection
from mjbench.host.child_connection import ChildError
from mjbench.paired import verdict
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.status import Status


@pytest.mark.parametrize(
    ("method", "code", "message"),
    [
        ("load_model", "os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV) while loading the model"),
        ("prepare_run", "time.sleep(60)", "no answer within 5 s while preparing a run"),
        ("_block", "args[0].warm_up(); args[0].run(); return -5", "a block took -5 ns"),
        ("start_release", "raise RuntimeError('half')", "RuntimeError: half"),
        ("make_workload", "raise MemoryError", "out of memory"),
    ],
)
def test_a_target_that_misbehaves_is_named_in_one_line_and_leaves_no_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, method: str, code: str, message: str
) -> None:
    before = process_tree.descendants()
    monkeypatch.setenv("PYTHONPATH", broken_worker.python_path(tmp_path, method, code))
    with WorkerPool(limit_s=5.0 if "sleep" in code else 30.0) as pool:
        result = verdict.decide_pair(pool, CARTPOLE, CARTPOLE, BRIEF)
    assert result.status == Status.FAILED
    assert message in result.detail
    assert "\n" not in result.detail
    assert "MuJoCo" in result.detail
    assert process_tree.descendants() <= before


def test_a_block_that_fails_ends_the_comparison(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # the first block of each section is the warm one, which belongs to `Prepare`
    code = (
        "self.count = getattr(self, 'count', 0) + 1; args[0].warm_up(); args[0].run(); "
        "exec(\"raise RuntimeError('out of luck')\") if self.count > len(self.sections) else None; "
        "return 1000"
    )
    monkeypatch.setenv("PYTHONPATH", broken_worker.python_path(tmp_path, "_block", code))
    with WorkerPool(limit_s=30.0) as pool:
        result = verdict.decide_pair(pool, CARTPOLE, CARTPOLE, BRIEF)
    assert result.status == Status.FAILED
    assert "RuntimeError: out of luck" in result.detail


class Endless:
    """Stands for a worker that goes on until it is ended."""

    def __init__(self) -> None:
        self.pid, self.has_ended = 1, False

    def wait(self, timeout_s: float | None = None) -> None:
        return None

    def end(self) -> None:
        self.has_ended = True


@pytest.mark.parametrize(
    ("sent", "cause"),
    [
        (b"\x00\x00\x00\x04oops", "sent an invalid answer (b'oops'), killed"),
        (b"\x00\x00\x00\x04" + pickle.dumps(None), "sent an invalid answer (b'"),
        (struct.pack("!i", len(pickle.dumps(7))) + pickle.dumps(7), "sent an invalid answer (b'"),
        (b"printed by a path", "sent an invalid answer, killed"),  # an absurd length
        (b"\x00\x00\x10\x00only the beginning", "sent part of an answer, then nothing"),
        (b"\xff\xff\xff\xff" + struct.pack("!Q", 1 << 60), "sent an invalid answer, killed"),
    ],
)
@pytest.mark.parametrize("is_block", [False, True])
def test_a_worker_that_sends_no_answer_is_ended_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: bytes, cause: str, is_block: bool
) -> None:
    monkeypatch.setattr("mjbench.host.machine.available_memory_bytes", lambda: 1 << 20)
    ours, theirs = socket.socketpair()
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, child_connection.timeval(0.01))
    process: Any = Endless()
    worker = WorkerProcess(Connection(ours.detach()), "baseline", 60.0, process, tmp_path / "log")
    with theirs, worker._child.connection:
        theirs.sendall(sent)
        worker._activities.append("running a block")
        with pytest.raises(ChildError) as caught:
            worker.time_block() if is_block else worker.wait()
    assert str(caught.value).startswith(f"baseline: {cause}")
    assert "while running a block" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert process.has_ended
