from typing import Any

import mujoco
import pytest

from mjbench.errors import InputError
from mjbench.simulation import models
from mjbench.verification.plan import BlockSizes, check_memory, choose_sizes

MODEL = models.load(models.resolve("cartpole"))


def choose(step_s: float = 1e-5, **asked: Any) -> BlockSizes:
    return choose_sizes(step_s, **asked)


def test_cheap_steps_keep_the_usual_sizes() -> None:
    assert choose(1e-6) == BlockSizes(64, 100, reduced=False)
    assert choose(1e-6, hold=7) == BlockSizes(64, 98, reduced=False)


def test_a_long_block_is_reduced_to_about_15_ms() -> None:
    sizes = choose()
    assert sizes.reduced
    assert sizes.nbatch * sizes.nstep == pytest.approx(1500, rel=0.1)
    assert choose(1e-2) == BlockSizes(8, 1, reduced=True)
    assert choose(1e-2, nthread=4).nbatch == 16


def test_sizes_that_were_asked_for_stay() -> None:
    assert choose(nbatch=1000, nstep=500) == BlockSizes(1000, 500, reduced=False)


@pytest.mark.parametrize(("has_accelerated", "nstep"), [(False, 1), (True, 10)])
def test_a_large_batch_has_one_step_but_ten_where_paths_compile(
    has_accelerated: bool, nstep: int
) -> None:
    sizes = choose(nbatch=65536, nthread=2, has_accelerated=has_accelerated)
    assert sizes == BlockSizes(65536, nstep, reduced=True)


@pytest.mark.parametrize("step_s", [2.0**-27, 2.0**-17, 2.0**-8, 1.0, 1e6])
def test_every_cost_gives_whole_holds(step_s: float) -> None:
    sizes = choose(step_s, hold=5)
    assert sizes.nbatch >= 1
    assert sizes.nstep % 5 == 0


def test_sizes_beyond_the_memory_are_refused_with_the_way_out() -> None:
    model: mujoco.MjModel = MODEL
    with pytest.raises(InputError, match="reduce --nbatch"):
        check_memory(model, 10**9, 200)
    with pytest.raises(InputError, match="or the threads"):
        check_memory(model, 1, 1, nthread=10**9)
    check_memory(model, 1, 1, nthread=1)
