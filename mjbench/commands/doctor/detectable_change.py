"""Which change this machine can detect in a minute, from what it measures in a few seconds.

The cart-pole is compared with itself, as `mjbench versions` compares releases. What its launches
differ by is noise; from it follows how small a change a verdict of a minute can decide.
"""

import math
import statistics
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import mujoco

from mjbench.errors import MachineError
from mjbench.measuring import launch_stats, timing
from mjbench.paired import outcomes, verdict
from mjbench.paired.targets import Target
from mjbench.paired.verdict import MIN_LAUNCHES, VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_names
from mjbench.results.json_form import in_json
from mjbench.simulation import models
from mjbench.simulation.engine_clock import engine_clock, has_clock
from mjbench.status import Status

MODEL = "cartpole"
# The change of which a gate should be certain.
TRUSTED = 0.01
# Verdicts that are larger are not asked for.
_MAX_LAUNCHES = 200
# Rounds with and without MuJoCo's timer, and steps of each of their blocks.
_CLOCK_ROUNDS, _CLOCK_STEPS = 80, 500


@in_json("launches", "deviation", "ratio", "decidable", "trusted", "detail")
@dataclass(frozen=True)
class Noise:
    """What a comparison of the cart-pole with itself showed.

    Attributes:
      launches: of both sides.
      deviation: standard deviation of their log ratios.
      launch_s: seconds of a launch.
      ratio: of the one side over the other; 1 but for noise.
      detail: why it was not measured, in one line; empty where it was.
    """

    launches: int = 0
    deviation: float | None = None
    launch_s: float | None = None
    ratio: float | None = None
    detail: str = ""

    @cached_property
    def decidable(self) -> float | None:
        """The smallest change that a verdict of a minute decides, as a share.

        It is twice the half-width of the interval that as many launches as fit would have, if their
        log ratios had this deviation and a normal distribution. Simulated, 99 % of such changes are
        decided where `--min-effect` is not larger (see the tests of this module).
        """
        if self.deviation is None or self.launch_s is None:
            return None
        count = int(VerdictPlan.time_limit_s / self.launch_s)
        count = min(_MAX_LAUNCHES, max(MIN_LAUNCHES, count))
        normal = NormalDist(0.0, max(self.deviation, 1e-6))
        launches = [normal.inv_cdf((i + 0.5) / count) for i in range(count)]
        interval = launch_stats.evidence(launches, outcomes.CONFIDENCE).interval
        return math.exp(2 * interval.half_width) - 1

    @property
    def trusted(self) -> bool:
        """Whether that is 1 % or less."""
        return self.decidable is not None and self.decidable <= TRUSTED


def noise(pool: WorkerPool, seconds: float) -> Noise:
    """Compare the cart-pole with itself for some seconds."""
    target = Target(release_names.parse_release(release_names.INSTALLED), models.resolve(MODEL))
    # so small an effect that no verdict ends it early
    plan = VerdictPlan(min_effect=1e-6, precision=1e-6, time_limit_s=seconds, as_shipped=True)
    result = verdict.decide_pair(pool, target, target, plan).uninterrupted()
    ratios = [launch.log_ratio for launch in result.samples]
    if result.status != Status.OK:
        raise MachineError(result.detail)
    if len(ratios) < MIN_LAUNCHES:
        raise MachineError(
            f"{len(ratios)} of at least {MIN_LAUNCHES} launches: give a longer --budget"
        )
    return Noise(
        launches=len(ratios),
        deviation=statistics.stdev(ratios),
        launch_s=result.seconds / len(ratios),
        ratio=math.exp(statistics.fmean(ratios)),
    )


def clock_share() -> float | None:
    """Return the share of MuJoCo's timer in a cart-pole's step; None in releases without one."""
    model = models.load(models.resolve(MODEL))
    if not has_clock(model):
        return None
    data = mujoco.MjData(model)

    def step() -> None:
        mujoco.mj_step(model, data, _CLOCK_STEPS)

    def switch(on: bool) -> None:
        engine_clock(on)

    contenders = (
        timing.Contender(step),
        timing.Contender(step, lambda: switch(False), lambda: switch(True)),
    )
    rounds = timing.rounds(contenders, 0.0, _CLOCK_ROUNDS, _CLOCK_ROUNDS)
    return 1 - statistics.median(without_s / with_s for with_s, without_s in rounds)
