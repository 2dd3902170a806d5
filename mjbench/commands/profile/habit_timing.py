"""What each habit of a Python loop costs for one model: `mjbench profile --habits`.

Each launch is a process of its own, which times every habit (habits.py) against the bare loop in
quads. A launch gives one number per habit: the median over quads of the difference per step. The
interval is Student's t over launches, which differ by their memory layout.
"""

import gc
import random
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mjbench.bounds import AnyFloat, Nanoseconds, NonNegativeInt
from mjbench.commands.profile import habits
from mjbench.commands.profile.habits import BARE, ONE_CALL, ZERO_STEPS, compile_loop, script
from mjbench.commands.profile.loop_starts import LoopStarts
from mjbench.commands.profile.options import HabitOptions
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.measuring import launch_stats, stats, timing
from mjbench.simulation import models, reference_run
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan, Starts
from mjbench.status import Status

# A block of the bare loop, in seconds; the most quads of each habit in a launch.
BLOCK_S, MOST_QUADS = 0.001, 12
# The fewest and most launches, and seconds for all of them.
LEAST_LAUNCHES, LAUNCHES, BUDGET_S = 2, 6, HabitOptions.EACH_S
LEAST_NSTEP = 10
CONFIDENCE = 0.95
_BLOCKS_PER_QUAD = 4


@dataclass(frozen=True)
class HabitCost:
    """What a habit adds to a step.

    Attributes:
      source: name of the habit.
      ns: added to each step; mean over launches.
      low: lower end of its interval, in ns.
      high: upper end of its interval, in ns.
      share: `ns` as a share of this model's step in the bare loop.
      cheaper: name of the habit that does the same for less; empty if there is none.
      saved_ns: saved in each step by the cheaper habit; None if there is none.
      code: the loop with the habit in it, as a script.
    """

    source: str
    ns: AnyFloat
    low: AnyFloat
    high: AnyFloat
    share: AnyFloat
    cheaper: str
    saved_ns: AnyFloat | None
    code: str


@dataclass(frozen=True)
class OverheadRow:
    """What the habits cost for one model; figures are None where the measurement failed.

    Attributes:
      model: its name.
      status: `ok`, `input` or `failed`.
      detail: why it failed, in one line; empty when ok.
      bare_ns: a step of the bare loop; median over launches.
      engine_ns: a step in one call for many steps.
      binding_ns: a call that steps nothing, made after a step.
      nstep: steps of a run of the loop, which is an episode; median over launches.
      costs: of the habits, the most expensive first.
      starts: where start states came from.
    """

    record_type: ClassVar[str] = "overhead"
    model: str
    status: Status = Status.OK
    detail: str = ""
    bare_ns: Nanoseconds | None = None
    engine_ns: Nanoseconds | None = None
    binding_ns: AnyFloat | None = None
    nstep: NonNegativeInt | None = None
    costs: Sequence[HabitCost] | None = None
    starts: Starts | None = None

    @property
    def is_measured(self) -> bool:
        return None not in (self.bare_ns, self.engine_ns, self.binding_ns, self.nstep, self.costs)


@dataclass(frozen=True)
class Launch:
    """From a child: what one launch measured.

    Attributes:
      bare_ns: of a step of the bare loop, the median over quads.
      added_ns: to each step by a habit, by its name; medians over quads.
    """

    nstep: int
    bare_ns: float
    added_ns: Mapping[str, float]
    starts: Starts


def measure(
    source: ModelSource,
    limit_s: float = 60.0,
    launches: int = LAUNCHES,
    starts: StartPlan = DEFAULT_STARTS,
    budget_s: float = BUDGET_S,
    clock: Callable[[], float] = time.monotonic,
) -> OverheadRow:
    """Return what every habit costs on a model.

    Args:
      limit_s: a launch is killed after this long without a message.
      budget_s: seconds after which no launch ends, once there are a few.
    """
    measured: list[Launch] = []
    end_s, longest_s = clock() + budget_s, 0.0
    for seed in range(launches):
        begin_s = clock()
        if seed >= LEAST_LAUNCHES and begin_s + longest_s > end_s:
            break
        share_s = (end_s - begin_s) / (launches - seed)
        measured.append(isolate.call(launch, source, starts, seed, share_s, limit_s=limit_s))
        longest_s = max(longest_s, clock() - begin_s)
    bare_ns = statistics.median(launch.bare_ns for launch in measured)
    added_ns = {
        name: [launch.added_ns[name] for launch in measured] for name in measured[0].added_ns
    }
    intervals = {
        name: launch_stats.student_interval(values, CONFIDENCE) for name, values in added_ns.items()
    }
    mean_ns = {name: interval.estimate for name, interval in intervals.items()}
    costs = []
    for name, ns in mean_ns.items():
        habit, half_width = habits.BY_NAME[name], intervals[name].half_width
        if habit is not ZERO_STEPS:
            cost = HabitCost(
                source=name,
                ns=ns,
                low=ns - half_width,
                high=ns + half_width,
                share=ns / bare_ns,
                cheaper=habit.cheaper,
                saved_ns=ns - mean_ns[habit.cheaper] if habit.cheaper in mean_ns else None,
                code=script(habit),
            )
            costs.append(cost)
    return OverheadRow(
        model=source.name,
        bare_ns=bare_ns,
        engine_ns=bare_ns + mean_ns[ONE_CALL.name],
        binding_ns=mean_ns[ZERO_STEPS.name],
        nstep=int(statistics.median(launch.nstep for launch in measured)),
        costs=sorted(costs, key=lambda cost: -cost.ns),
        starts=measured[0].starts,
    )


def launch(
    source: ModelSource, plan: StartPlan, seed: int, budget_s: float, channel: Channel
) -> Launch:
    """Time all habits once; loading and warming up are part of the seconds that it has."""
    end_s = time.perf_counter() + budget_s
    model, file = models.load(source), str(source.path)
    nstep = max(LEAST_NSTEP, int(BLOCK_S / reference_run.step_s(model)))
    starts = LoopStarts(model, plan, nstep, seed)
    start = starts.in_turn(repeats=_BLOCKS_PER_QUAD)
    run_bare = compile_loop(BARE, model, nstep, start=start).run
    runs = {
        habit.name: compile_loop(habit, model, nstep, file, start).run
        for habit in habits.HABITS
        if habit is not BARE and habit.requires(model, file)
    }
    bare_ns: list[float] = []
    added_ns: dict[str, float] = {}
    gc.disable()
    for number, name in enumerate(random.sample(sorted(runs), len(runs))):
        channel.doing(f"timing {name}")
        warm_s = [timing.block_s(timing.Contender(run)) for run in (run_bare, runs[name])]
        start.count = len(bare_ns) * _BLOCKS_PER_QUAD  # all blocks of a quad start from one state
        habit_s = (end_s - time.perf_counter()) / (len(runs) - number)
        orders = timing.draw_orders(quads(habit_s, 2 * sum(warm_s)))
        seconds = np.array(timing.block_times(run_bare, runs[name], orders))
        bare_s, other_s = (s.mean(axis=1) for s in stats.blocks_by_target(orders, seconds))
        bare_ns += (1e9 * bare_s / nstep).tolist()
        added_ns[name] = float(np.median(1e9 * (other_s - bare_s) / nstep))
    return Launch(nstep, statistics.median(bare_ns), added_ns, starts.starts)


def quads(budget_s: float, quad_s: float) -> int:
    return max(1, min(MOST_QUADS, int(budget_s / quad_s)))
