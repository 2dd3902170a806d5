"""The path `ray`: what it says where it cannot run, and how it fails.

That it steps to the last bit as all paths do, and returns what they return, is in `test_paths.py`.
"""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from mjbench import paths
from mjbench.errors import MachineError
from mjbench.paths import local_ray
from mjbench.paths.ray_actors import Ray
from mjbench.simulation import compat, reference_run
from mjbench.simulation.workload import Product, Workload


@pytest.fixture(scope="module")
def ray() -> Iterator[Any]:
    """Keep Ray running from test to test."""
    pytest.importorskip("ray")
    local_ray.acquire(0)
    import ray

    yield ray
    local_ray.release()


@pytest.fixture
def resources(small: Workload) -> Iterator[paths.Resources]:
    resources = paths.Resources(small)
    yield resources
    resources.close()


def test_without_the_package_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    reason = Ray().unavailable()
    assert reason is not None
    assert reason.startswith("needs ray: python -m pip install ")


@pytest.mark.parametrize("product", list(Product))
def test_without_rollout_actors_run_a_loop_that_returns_the_same(
    ray: Any, small: Workload, product: Product, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compat, "rollout_unavailable", lambda: "too old")
    own = small.returning(product)
    resources = paths.Resources(own)
    prepared = Ray().prepare(own, {"actors": 2}, resources)
    for order in (np.arange(5), np.array([3, 0, 4, 1, 2])):
        resources.reorder(order)
        prepared.clear()
        prepared.run()
        states = prepared.final_states()
        assert states.mask is not None
        assert states.mask.all()
        np.testing.assert_array_equal(states.values, reference_run.observe(own).final_state)
        returned = prepared.step_outputs().arrays if prepared.step_outputs else []
        for values, expected in zip(returned, reference_run.step_outputs(own).arrays, strict=True):
            np.testing.assert_array_equal(values, expected)
    resources.close()


def test_an_input_that_one_simulation_has_reaches_each_actor(ray: Any, small: Workload) -> None:
    own = small.returning(Product.FINAL)
    own.initial_state[0, compat.state_columns(own.model)["qfrc_applied"]] = 0.1
    resources = paths.Resources(own)
    prepared = Ray().prepare(own, {"actors": 2}, resources)
    for order in (np.arange(5), np.array([3, 1, 4, 2, 0])):
        resources.reorder(order)
        expected = reference_run.observe(own).final_state
        np.testing.assert_array_equal(prepared.verified_states().values, expected)
    resources.close()


def test_an_actor_that_ends_is_a_failure_of_one_line(
    ray: Any, small: Workload, resources: paths.Resources
) -> None:
    prepared = Ray().prepare(small, {"actors": 2}, resources)
    pool = resources.get_or_create(("actors", 2), lambda: None)
    ray.kill(pool._actors[0])
    with pytest.raises(ray.exceptions.RayActorError):
        while True:  # it ends some time after it was told to
            ray.get(pool._actors[0].__ray_ready__.remote())
    with pytest.raises(MachineError) as caught:
        prepared.run()
    assert str(caught.value) == "the process of an actor ended"


def test_an_exception_in_an_actor_is_a_failure_of_one_line(
    ray: Any, small: Workload, resources: paths.Resources
) -> None:
    prepared = Ray().prepare(small, {"actors": 2}, resources)
    pool = resources.get_or_create(("actors", 2), lambda: None)
    pool._inputs[0] = None
    with pytest.raises(MachineError, match=r"an actor failed: TypeError: .*NoneType") as caught:
        prepared.run()
    assert "\n" not in str(caught.value)


def test_an_actor_has_one_thread_and_the_modules_of_this_process(ray: Any) -> None:
    def surroundings() -> tuple[str, str, str]:
        import os

        import mujoco

        import mjbench

        return os.environ["OMP_NUM_THREADS"], mujoco.__file__, mjbench.__file__

    import mujoco

    import mjbench

    expected = ("1", mujoco.__file__, mjbench.__file__)
    assert ray.get(ray.remote(num_cpus=0)(surroundings).remote()) == expected


def test_actors_that_import_another_mujoco_are_refused(
    ray: Any, small: Workload, resources: paths.Resources, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mjbench.paths.ray_actors._engine", lambda: ("0.0", "elsewhere"))
    with pytest.raises(MachineError, match=r"an actor imports MuJoCo .* this process"):
        Ray().prepare(small, {"actors": 2}, resources)
