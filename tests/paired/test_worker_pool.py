"""Workers that crash, hang or lie: one line names the target, and no process is left."""

from pathlib import Path

import broken_worker
import process_tree
import pytest
from paired_examples import BRIEF, CARTPOLE

from mjbench.paired import verdict
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status


@pytest.mark.parametrize(
    ("method", "code", "message"),
    [
        (
            "_load_model",
            "os.kill(os.getpid(), signal.SIGSEGV)",
            "SIGSEGV) while loading the model",
        ),
        ("_observe", "os._exit(3)", "exit code 3 while stepping the model"),
        ("_prepare", "time.sleep(60)", "no answer within 5 s while preparing a run"),
        ("_block", "os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL) while"),
        ("_block", "return -5", "reports that a block took -5 ns"),
        (
            "_start_release",
            "raise RuntimeError('half a release')",
            "RuntimeError: half a release",
        ),
        ("_make_workload", "raise MemoryError", "out of memory"),
    ],
)
def test_a_target_that_misbehaves_is_named_in_one_line_and_leaves_no_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, method: str, code: str, message: str
) -> None:
    before = process_tree.descendants()
    monkeypatch.setenv("PYTHONPATH", broken_worker.python_path(tmp_path, method, code))
    with WorkerPool(limit_s=5.0 if "sleep" in code else 30.0) as pool:
        result = verdict.decide(pool, CARTPOLE, CARTPOLE, BRIEF)
    assert result.status == Status.FAILED
    assert message in result.detail
    assert "\n" not in result.detail
    assert "MuJoCo" in result.detail
    assert process_tree.descendants() <= before


def test_a_block_that_fails_ends_the_comparison(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # the first block of each layout is the warm one, which belongs to `Prepare`
    code = (
        "self.count = getattr(self, 'count', 0) + 1; "
        "exec(\"raise RuntimeError('out of luck')\") if self.count > 1 else None; return 1000"
    )
    monkeypatch.setenv("PYTHONPATH", broken_worker.python_path(tmp_path, "_block", code))
    with WorkerPool(limit_s=30.0) as pool:
        result = verdict.decide(pool, CARTPOLE, CARTPOLE, BRIEF)
    assert result.status == Status.FAILED
    assert "RuntimeError: out of luck" in result.detail
