"""The builds of the release that mjbench pins, under Node; skipped where one of them is missing."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import pytest

from mjbench.errors import MjbenchError
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs, release_names
from mjbench.simulation import models
from mjbench.status import Status
from mjbench.web import measure, node_process, npm_package, timed_build
from mjbench.web.measure import WebPlan
from mjbench.web.npm_package import Build
from mjbench.web.timed_build import Engine


@pytest.fixture(autouse=True)
def without_warming_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have builds warm up by one block: what they compute is compared, and not their speed."""
    monkeypatch.setattr(timed_build, "_MAX_S", 0.0)


@pytest.fixture(scope="module")
def engine() -> Engine:
    try:
        return Engine(npm_package.find(), node_process.find_node(), 120.0, 2)
    except MjbenchError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def plan(engine: Engine) -> WebPlan:
    release = release_names.parse_release(engine.package.version)
    try:
        installs.install(release)
    except MjbenchError as error:
        pytest.skip(str(error))
    return WebPlan(release, engine, Sizes(nbatch=2), 0.0)


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(120.0) as pool:
        yield pool


def test_they_agree_with_c_without_contact(pool: WorkerPool, plan: WebPlan) -> None:
    record = measure.measure(pool, models.resolve("muscle_arm"), plan)
    assert record.status == Status.OK, record.detail
    builds = [path for path in record.paths if path.path in [*Build]]
    assert {path.path for path in builds} == {*Build}
    for path in builds:
        assert path.status == Status.OK, path.detail
        assert path.check is not None
        assert (path.check.nstep, path.check.final.step) == (100, 100)
        assert path.check.final.difference <= 1e-10
        assert path.block_ns and path.start_up and path.heap_bytes
    for one, other in itertools.pairwise(path.check for path in builds):
        assert one == other


def test_they_agree_with_c_in_contact(pool: WorkerPool, plan: WebPlan) -> None:
    single = replace(plan, sizes=Sizes(nbatch=1))
    record = measure.measure(pool, models.resolve("cube_table"), single)
    for path in record.paths[2:]:
        assert path.status == Status.OK, path.detail
        assert path.check is not None and path.check.constrained.count > 0
