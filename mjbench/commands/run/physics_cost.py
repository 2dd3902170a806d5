"""What costs in the steps of a program: stages of the engine, pairs of geoms, and sensors.

The program's own model is stepped from states that the program was in, in a child process.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeFloat, Share
from mjbench.commands.profile import measure as profile
from mjbench.commands.profile import model_costs, step_parts
from mjbench.commands.profile.evaluations import Evaluations
from mjbench.commands.profile.loop_starts import LEAST_NSTEP, StartsInTurn
from mjbench.commands.profile.model_costs import LEAST_SHARE, MOST_COSTS, Cost
from mjbench.commands.run.recorded_models import RecordedModel, loadable
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.simulation import reference_run

# A child that is silent for longer is killed.
LIMIT_S = 30.0


@dataclass(frozen=True)
class PhysicsCost:
    """Where the time of a program's steps goes.

    Attributes:
      step_ns: a step from the states that the program was in.
      stages: share of a step by stage, as timed in the program; where that was not possible, from
        the states that it was in.
      costs: parts of the model with a notable share, the largest first.
      evaluations: of the dynamics.
    """

    step_ns: NonNegativeFloat
    stages: Mapping[str, Share]
    costs: Sequence[Cost]
    evaluations: Evaluations | None = None

    @property
    def main_stage(self) -> tuple[str, float]:
        return step_parts.longest(self.stages)

    @property
    def main_cost(self) -> Cost | None:
        return model_costs.main_cost(self.stages, self.costs)


def measure(models: Sequence[RecordedModel], timers: Mapping[str, float]) -> PhysicsCost | None:
    """Return what costs in steps; None where no model can be stepped here.

    Args:
      timers: shares of a step from the engine's timers in the program; empty where it has none.
    """
    model = loadable(models)
    if model is None:
        return None
    return isolate.call(measure_model, model, timers, limit_s=LIMIT_S, otherwise=lambda _: None)


def measure_model(
    recorded: RecordedModel, timers: Mapping[str, float], channel: Channel
) -> PhysicsCost:
    model, states = recorded.load(), recorded.states
    timers = timers or _timer_shares(model, states)
    step = step_parts.stages(model, timers, lambda: StartsInTurn(model, states))
    of_sensors = model_costs.sensor_costs(model, step)
    of_pairs = model_costs.collision_costs(model, states, step.shares, step.step_s)
    costs = [*of_pairs, *of_sensors, *model_costs.static_costs(model, step.shares)]
    largest = sorted(costs, key=lambda cost: -cost.share)
    notable = [cost for cost in largest if cost.share >= LEAST_SHARE]
    return PhysicsCost(1e9 * step.step_s, step.shares, notable[:MOST_COSTS], Evaluations.of(model))


def _timer_shares(model: mujoco.MjModel, states: np.ndarray) -> Mapping[str, float]:
    nstep = max(LEAST_NSTEP, int(profile.BLOCK_S / reference_run.step_s(model) / len(states)))
    block = profile.Block(len(states), nstep, lambda: StartsInTurn(model, states))
    return profile.timer_shares(model, block)
