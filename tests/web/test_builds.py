"""Builds on a model, each misbehaving in its way; a program that steps C stands in for Node."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import pretending_node
import pytest

from mjbench.comparison.plan import Variant
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases import release_names
from mjbench.simulation import models
from mjbench.simulation.starts import KEYFRAME_STARTS
from mjbench.status import Status
from mjbench.web import measure, node_process, npm_package
from mjbench.web.measure import WebPlan
from mjbench.web.records import WebPathRecord, WebRecord
from mjbench.web.timed_build import Engine

Measure = Callable[..., WebRecord]


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool() as pool:
        yield pool


@pytest.fixture
def measured(pool: WorkerPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measure:
    """Return a function that measures a model with a build that misbehaves."""
    package = npm_package.find(folder=pretending_node.package(tmp_path / "app", mujoco.__version__))
    command = node_process.find_node(str(pretending_node.program(tmp_path)))
    release = release_names.parse_release(release_names.INSTALLED)

    def run(
        how: str = "",
        model: str = "cartpole",
        variant: Variant = Variant("wasm", {}),  # noqa: B008  frozen
        limit_s: float = 60.0,
        hold: int = 1,
    ) -> WebRecord:
        monkeypatch.setenv(pretending_node.MISBEHAVIOUR, how)
        monkeypatch.setattr(measure, "variants", lambda: [variant])
        sizes = Sizes(3, 20, hold, 0, KEYFRAME_STARTS)
        plan = WebPlan(release, Engine(package, command, limit_s, 2), sizes, 0.0)
        return measure.measure(pool, models.resolve(model), plan)

    return run


def wasm(record: WebRecord) -> WebPathRecord:
    """Return the row of the build; C's must be there, too, and timed."""
    assert record.status == Status.OK, record.detail
    loop, rollout, build = record.paths
    assert (loop.path, rollout.path) == ("python_loop", "rollout")
    assert len(loop.block_ns) == len(rollout.block_ns) >= 8
    return build


def test_a_build_that_does_what_c_does_is_timed(measured: Measure) -> None:
    build = wasm(measured())
    assert build.status == Status.OK, build.detail
    assert build.check is not None and build.check.first is None
    assert build.check.unconstrained.count == 60
    assert len(build.block_ns) >= 8


def test_c_is_timed_without_the_timer_of_the_python_package(
    measured: Measure, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No build has such a timer."""
    prepared, call = [], WorkerProcess.call

    def noting(process: WorkerProcess, task: Any, *arguments: Any, **named: Any) -> Any:
        if task == Worker.prepare:
            prepared.append(named["has_timer"])
        return call(process, task, *arguments, **named)

    monkeypatch.setattr(WorkerProcess, "call", noting)
    wasm(measured())
    assert prepared == [False, False]


def test_all_inputs_of_a_model_in_contact_count(measured: Measure) -> None:
    record = measured(model="cube_table", hold=5)
    check = wasm(record).check
    assert record.hold == 5
    assert check is not None
    assert check.constrained.count + check.unconstrained.count == 60
    assert check.constrained.count > 30
    assert (check.constrained.error, check.unconstrained.error) == (0.0, 0.0)
    assert check.excess is None


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("wrong:7", "from step 7 on, the run differs by more than 10 times the shadow"),
        ("wrong:0", "it does not start where C does (after step 0, in qpos[0]"),
        ("drift:", "an unconstrained step differs by 1.0e-03"),
        ("stale:", "timed blocks do not end where the run ended that was checked"),
    ],
)
def test_a_build_that_disagrees_gets_no_speed(measured: Measure, how: str, message: str) -> None:
    build = wasm(measured(how))
    assert build.status == Status.DISAGREES
    assert message in build.detail
    assert not build.block_ns


def test_rounding_is_named_and_not_called_disagreement(measured: Measure) -> None:
    build = wasm(measured("rounding:4"))
    assert build.status == Status.OK, build.detail
    assert build.check is not None and build.check.first is not None
    assert str(build.check.first).startswith("after step 4, in qpos[0] of simulation 0, by ")
    assert build.check.first_of_same_model == build.check.first
    assert build.block_ns


@pytest.mark.parametrize(
    ("how", "status", "message"),
    [
        ("crash:record", Status.CRASHED, "killed by signal 9 (SIGKILL) while stepping the model"),
        ("crash:block", Status.CRASHED, "killed by signal 9 (SIGKILL) while running a block"),
        ("nonsense:load", Status.CRASHED, "sent an invalid answer (b'nonsense'), killed"),
        ("error:load", Status.FAILED, "no such thing while loading the model"),
        ("hang:load", Status.TIMEOUT, "no answer within 1 s while loading the model"),
    ],
)
def test_a_build_that_fails_costs_its_row(
    measured: Measure, how: str, status: Status, message: str
) -> None:
    build = wasm(measured(how, limit_s=1.0 if status == Status.TIMEOUT else 60.0))
    assert build.status == status
    assert message in build.detail


def test_threads_of_an_engine_that_has_none_are_unavailable(measured: Measure) -> None:
    variant = Variant("wasm_mt", {"engine_threads": 2})
    assert wasm(measured(variant=variant)).status == Status.OK
    build = wasm(measured("old:", variant=variant))
    assert build.status == Status.UNAVAILABLE
    assert "has no mju_threadpool" in build.detail


def test_ctrl_c_leaves_what_was_known(measured: Measure, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(measure, "rounds", interrupted)
    record = measured()
    assert record.status == Status.INTERRUPTED
    assert [path.path for path in record.paths] == ["python_loop", "rollout", "wasm"]
    assert record.paths[2].check is not None
    assert not any(path.block_ns for path in record.paths)
