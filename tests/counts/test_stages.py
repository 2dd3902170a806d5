"""Stages of the pipeline: each function in one, and their sum the engine's."""

from callgrind_dump import DUMP

from mjbench.counts import callgrind
from mjbench.counts.stages import instructions_by_stage


def test_stages_sum_up_to_the_engine() -> None:
    costs = instructions_by_stage(callgrind.parse(DUMP))
    assert costs["collision"] == 500
    assert costs["solver"] == 300
    assert sum(costs.values()) == 1000
    assert costs["other"] == 200  # mj_step itself, and mj_forward
