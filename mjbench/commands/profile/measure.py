"""Where a step's time goes: the engine's stages, Python around it, and the rendering of a frame.

Everything is measured in child processes: one for the steps, one for each rendering backend.
Stages come from `mjData.timer`, which the engine fills when a timer (`mjcb_time`) is installed, and
from `step_parts`, which times what no timer is about.
MuJoCo's Python package installs one from 3.3.1 on. Before, Python's own clock is installed, which
costs more than what it measures: so only shares of a step come from the timers, and times come from
runs without them.
"""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from mjbench.bounds import Nanoseconds, NonNegativeInt, Share, Timestep, check_measured
from mjbench.commands.profile import habits, model_costs, rendering, step_parts
from mjbench.commands.profile.habits import Habit, compile_loop
from mjbench.commands.profile.loop_starts import LoopStarts
from mjbench.commands.profile.model_costs import MOST_COSTS, Cost
from mjbench.commands.profile.options import ProfileOptions
from mjbench.commands.profile.rendering import FrameTime
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.interval import Interval
from mjbench.limits import TIME_LIMIT_S
from mjbench.measuring import stats, timing
from mjbench.results.json_form import in_json
from mjbench.simulation import compat, models, reference_run
from mjbench.simulation.engine_clock import has_clock
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan, Starts
from mjbench.status import Status

# A block, in seconds; the fewest and most rounds of blocks.
BLOCK_S, LEAST_ROUNDS, MOST_ROUNDS = 0.004, 15, 200
# Seconds for a model; the share that its steps have of it, and, of that, the loop and each kind of
# parts. Frames have what is left, except for the seconds in which a process starts.
BUDGET_S = ProfileOptions.EACH_S
STEP_SHARE, LOOP_SHARE, PART_SHARE, START_S = 0.4, 0.5, 0.125, 1.0
# Frames for each second of simulated time, where physics, Python and rendering are compared.
FRAMES_PER_S = 60


@in_json(also=["python_ns"])
@dataclass(frozen=True)
class ProfiledSteps:
    """Where a step's time goes, without rendering; from the child that steps.

    Attributes:
      loop_ns: a step of the plain Python loop.
      engine_ns: a step in one call for many steps.
      speedup_without_timer: of a step of the loop, without the timer of MuJoCo's Python package;
        None in releases that install none.
      stages: share of a step by stage; they sum up to 1.
      is_python_resolved: whether the loop certainly takes longer than one call, round by round.
      costs: what collisions of geoms, static geoms and sensors cost of a step, the largest first.
      warnings: of MuJoCo that these steps raised, by name; the simulation did not diverge.
      starts: where start states came from.
      run_nstep: steps from each start, which hold its controls.
    """

    timestep: Timestep
    loop_ns: Nanoseconds
    engine_ns: Nanoseconds
    speedup_without_timer: Interval | None
    work: Work
    stages: Mapping[str, Share]
    warnings: Mapping[str, NonNegativeInt]
    starts: Starts | None = None
    run_nstep: NonNegativeInt | None = None
    is_python_resolved: bool = True
    costs: Sequence[Cost] = ()

    @property
    def python_ns(self) -> float:
        """What the Python loop adds to a step; negative where that is within the noise."""
        return self.loop_ns - self.engine_ns

    @property
    def is_all_engine(self) -> bool:
        """Whether what Python adds to a step is below what was resolved."""
        return not self.is_python_resolved or self.python_ns <= 0


@in_json(also=["simulated_second"])
@dataclass(frozen=True)
class ProfileRow:
    """What the run file and `mjbench profile --json` hold for one model.

    Attributes:
      model: its name.
      status: `ok`, `input` or `failed`.
      detail: why it failed, in one line; empty when ok.
      steps: where a step's time goes; None where the measurement failed.
      frames: what rendering a frame costs, by backend; None where the measurement failed.
    """

    record_type: ClassVar[str] = "profile"
    model: str
    status: Status = Status.OK
    detail: str = ""
    steps: ProfiledSteps | None = None
    frames: Sequence[FrameTime] | None = None

    def __post_init__(self) -> None:
        check_measured(self, "steps", "frames")

    @property
    def simulated_second(self) -> dict[str, float]:
        """Seconds for each second of simulated time, by what takes them; empty where it failed.

        Python takes 0 where its time is within the noise.
        """
        if self.steps is None:
            return {}
        nstep = 1 / self.steps.timestep
        python_ns = 0.0 if self.steps.is_all_engine else self.steps.python_ns
        taken_s = {
            "physics": self.steps.engine_ns * 1e-9 * nstep,
            "Python": python_ns * 1e-9 * nstep,
        }
        for frame in self.frames or ():
            if frame.seconds is not None:
                taken_s[f"rendering ({frame.backend})"] = frame.seconds * FRAMES_PER_S
        return taken_s


def measure(
    source: ModelSource,
    limit_s: float = TIME_LIMIT_S,
    starts: StartPlan = DEFAULT_STARTS,
    budget_s: float = BUDGET_S,
    clock: timing.Clock = time.monotonic,
) -> ProfileRow:
    """Return the profile of a model; a child that is silent for `limit_s` seconds is killed.

    Args:
      budget_s: for steps and frames, loading included.
    """
    end_s, backends = clock() + budget_s, rendering.BACKENDS
    steps = isolate.call(step, source, starts, STEP_SHARE * budget_s, limit_s=limit_s)
    frames = []
    for number, backend in enumerate(backends):
        frame_s = (end_s - clock()) / (len(backends) - number) - START_S
        frames.append(
            rendering.measure(source, backend, limit_s, frame_s)
            if frame_s > 0
            else FrameTime(backend, None, "no time was left: give a longer --budget")
        )
    return ProfileRow(source.name, steps=steps, frames=frames)


@dataclass(frozen=True)
class Block:
    """Runs of `nstep` steps each, from another start, whose controls they hold.

    `new_start` returns what restores the starts, from the first on.
    """

    nrun: int
    nstep: int
    new_start: Callable[[], Callable[[mujoco.MjModel, mujoco.MjData], None]]

    def of_loop(self, habit: Habit, model: mujoco.MjModel) -> Callable[[], None]:
        run, nrun = compile_loop(habit, model, self.nstep, start=self.new_start()).run, self.nrun

        def runs() -> None:
            for _ in range(nrun):
                run()

        return runs


def step(source: ModelSource, plan: StartPlan, budget_s: float, channel: Channel) -> ProfiledSteps:
    """Time steps with and without MuJoCo's timer, and the loop; runs in a child."""
    channel.doing("loading the model")
    model = models.load(source)
    channel.doing("stepping the model")
    starts = LoopStarts(model, plan)
    observation = starts.observation
    nrun = max(1, int(BLOCK_S / (starts.nstep * reference_run.step_s(model))))
    block = Block(nrun, starts.nstep, starts.in_turn)
    timers = timer_shares(model, block)
    stages = step_parts.stages(model, timers, block.new_start, PART_SHARE * budget_s)
    clock_off = [habits.CLOCK_OFF] if has_clock(model) else []
    of_loop, of_one_call, *of_others = _step_ns(
        model, block, LOOP_SHARE * budget_s, [habits.BARE, habits.ONE_CALL, *clock_off]
    )
    loop_ns, engine_ns = statistics.median(of_loop), statistics.median(of_one_call)
    least_ratio = stats.speedup(of_loop, of_one_call).low
    of_collision = model_costs.collision_costs(
        model, starts.states, stages.shares, stages.step_s, PART_SHARE * budget_s
    )
    costs = [
        *of_collision,
        *model_costs.static_costs(model, stages.shares),
        *model_costs.sensor_costs(model, stages),
    ]
    return ProfiledSteps(
        timestep=float(model.opt.timestep),
        loop_ns=loop_ns,
        engine_ns=engine_ns,
        speedup_without_timer=stats.speedup(of_loop, of_others[0]) if of_others else None,
        work=observation.work,
        stages=stages.shares,
        warnings=observation.other_warnings(),
        starts=starts.starts,
        run_nstep=block.nstep,
        costs=sorted(costs, key=lambda cost: -cost.share)[:MOST_COSTS],
        is_python_resolved=least_ratio is not None and least_ratio > 1,
    )


def _step_ns(
    model: mujoco.MjModel, block: Block, budget_s: float, of_habits: Sequence[Habit]
) -> list[list[float]]:
    contenders = []
    for habit in of_habits:
        run = block.of_loop(habit, model)
        run()  # touches all memory
        contenders.append(timing.Contender(run))
    rounds = timing.rounds(contenders, budget_s, LEAST_ROUNDS, MOST_ROUNDS)
    nstep = block.nrun * block.nstep
    return [[1e9 * each / nstep for each in seconds] for seconds in zip(*rounds, strict=True)]


def timer_shares(model: mujoco.MjModel, block: Block) -> dict[str, float]:
    """Return the share of a step by stage from the timers, in the fastest third of the blocks."""
    data, start = mujoco.MjData(model), block.new_start()
    needs_clock = not has_clock(model)
    if needs_clock:
        mujoco.set_mjcb_time(time.perf_counter)
    try:
        blocks = []
        for _ in range(1 + LEAST_ROUNDS):
            seconds = 0.0 * np.array(data.timer.duration)
            for _ in range(block.nrun):
                start(model, data)
                before = np.array(data.timer.duration)
                mujoco.mj_step(model, data, block.nstep)
                taken = np.array(data.timer.duration) - before
                seconds += taken if taken.min() >= 0 else 0  # a divergence resets them
            blocks.append(seconds)
    finally:
        if needs_clock:
            mujoco.set_mjcb_time(None)
    step = int(mujoco.mjtTimer.mjTIMER_STEP)
    fastest = sorted(blocks[1:], key=lambda block: float(block[step]))  # the first touches memory
    timer_s = np.sum(fastest[: -(-len(fastest) // 3)], axis=0)  # by mjtTimer
    names = (*step_parts.TIMERS.values(), step_parts.WHOLE_STEP)
    timers = {name: compat.timer(name) for name in names}
    return step_parts.stage_shares(
        {name: float(timer_s[timer]) for name, timer in timers.items() if timer is not None}
    )
