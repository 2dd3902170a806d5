"""Where a step's time goes: the engine's stages, Python around it, and the rendering of a frame.

Everything is measured in child processes: one for the steps, one for each rendering backend.
Stages come from MuJoCo's own timers (`mjData.timer`), which the engine reads when it has a clock.
From 3.3.1 on it has one by default. Before, it is given Python's, which costs more than what it
measures: so only shares of a step come from the timers, and times come from runs without them.
"""

import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

import mujoco
import numpy as np

from mjbench.errors import Failure, InputError
from mjbench.instrument import isolate, timing
from mjbench.instrument.isolate import Channel
from mjbench.loop import engine_stages, habits, rendering
from mjbench.loop.compiled_loop import compile_loop
from mjbench.loop.rendering import FrameTime
from mjbench.simulation import compat, models, work, workload
from mjbench.simulation.models import ModelSource
from mjbench.simulation.work import Work
from mjbench.status import Status

# A block, in seconds; the fewest and most rounds of blocks, and seconds for all of them.
BLOCK_S, LEAST_ROUNDS, MOST_ROUNDS, BUDGET_S = 0.004, 15, 200, 2.0
# Frames for each second of simulated time, where physics, Python and rendering are compared.
FRAMES_PER_S = 60


@dataclass(frozen=True)
class StepTimes:
    """Where a step's time goes, without rendering; from the child that steps.

    Attributes:
      timestep: of the model, in seconds.
      loop_ns: a step of the plain Python loop.
      engine_ns: a step in one call for many steps.
      clock_ns: what the engine's own clock adds to a step; None in releases that have none by
        default.
      work: contacts, constraints and solver iterations per step.
      stages: share of a step by stage; they sum up to 1.
      warnings: of MuJoCo that these steps raised, by name; the simulation did not diverge.
    """

    timestep: float
    loop_ns: float
    engine_ns: float
    clock_ns: float | None
    work: Work
    stages: Mapping[str, float]
    warnings: Mapping[str, int]


@dataclass(frozen=True)
class StepProfile:
    """Where a step's time goes, and what a frame costs.

    Attributes:
      model: its name.
      steps: times of a step.
      frames: what rendering costs, by backend.
    """

    model: str
    steps: StepTimes
    frames: Sequence[FrameTime]

    @property
    def python_ns(self) -> float:
        """What the Python loop adds to a step, in ns."""
        return self.steps.loop_ns - self.steps.engine_ns

    def simulated_second(self) -> dict[str, float]:
        """Return seconds of physics, Python and rendering for each second of simulated time."""
        nstep = 1 / self.steps.timestep
        parts = {
            "physics": self.steps.engine_ns * 1e-9 * nstep,
            "Python": self.python_ns * 1e-9 * nstep,
        }
        for frame in self.frames:
            if frame.seconds is not None:
                parts[f"rendering ({frame.backend})"] = frame.seconds * FRAMES_PER_S
        return parts


@dataclass(frozen=True)
class ProfileRow:
    """What the run file and `mjbench profile --json` hold for one model.

    The attributes from `timestep` on are those of `StepTimes` and `StepProfile`, and None where
    the measurement failed.

    Attributes:
      model: its name.
      status: `ok`, `input` or `failed`.
      detail: why it failed, in one line; empty when ok.
    """

    record_type: ClassVar[str] = "profile"
    model: str
    status: Status = Status.OK
    detail: str = ""
    timestep: float | None = None
    loop_ns: float | None = None
    engine_ns: float | None = None
    python_ns: float | None = None
    clock_ns: float | None = None
    work: Work | None = None
    stages: Mapping[str, float] | None = None
    warnings: Mapping[str, int] | None = None
    frames: Sequence[FrameTime] | None = None
    simulated_second: Mapping[str, float] | None = None

    @classmethod
    def measured(cls, profile: StepProfile) -> "ProfileRow":
        """Return the row of a model that was profiled."""
        return cls(
            profile.model,
            python_ns=profile.python_ns,
            frames=profile.frames,
            simulated_second=profile.simulated_second(),
            **vars(profile.steps),
        )

    def profile(self) -> StepProfile | None:
        """Return the profile; None where it could not be measured."""
        if self.status != Status.OK or self.frames is None:
            return None
        steps = StepTimes(**{field.name: getattr(self, field.name) for field in fields(StepTimes)})
        return StepProfile(self.model, steps, self.frames)

    @classmethod
    def failed(cls, model: str, failure: Failure) -> "ProfileRow":
        """Return the row of a model whose measurement failed."""
        return cls(model, failure.status, failure.detail)


def measure(source: ModelSource, limit_s: float = 60.0) -> StepProfile:
    """Return the profile of a model.

    Raises:
      InputError: it cannot be loaded, or diverges.
      MachineError: the process that steps it crashed or hung.
    """
    messages: list[StepTimes] = []
    isolate.run("mjbench.loop.profile:step", source, messages.append, limit_s).check()
    frames = [rendering.measure(source, backend, limit_s) for backend in rendering.BACKENDS]
    return StepProfile(source.name, messages[0], frames)


def step(source: ModelSource, channel: Channel) -> None:
    """Time steps with and without the engine's clock, and the loop; runs in a child."""
    channel.doing("loading the model")
    model = models.load(source)
    channel.doing("stepping the model")
    nstep = max(2, int(BLOCK_S / work.step_s(model)))
    # the steps that are timed: from the start state, with its controls
    observation = work.observe(workload.make(model, 1, nstep, spread=0.0))
    if not observation.healthy.all():
        raise InputError(f"the model diverges ({observation.diagnosis()})")
    stages = _stages(model, nstep)
    loop_ns, engine_ns = _step_ns(model, nstep, habits.BARE.name, habits.ONE_CALL.name)
    clock_ns = None
    if compat.has_clock(model):
        # last: some releases do not get their clock back
        (clockless_ns,) = _step_ns(model, nstep, habits.CLOCK_OFF.name)
        clock_ns = loop_ns - clockless_ns
    channel.send(
        StepTimes(
            timestep=float(model.opt.timestep),
            loop_ns=loop_ns,
            engine_ns=engine_ns,
            clock_ns=clock_ns,
            work=observation.work,
            stages=stages,
            warnings=observation.other_warnings(),
        )
    )


def _step_ns(model: mujoco.MjModel, nstep: int, *habit_names: str) -> list[float]:
    """Return the ns of a step in the loop of each habit, timed in turns: medians over rounds."""
    contenders = []
    for name in habit_names:
        run = compile_loop(habits.find(name), model, nstep).run
        run()  # touches all memory
        contenders.append(timing.Contender(run))
    rounds = timing.rounds(contenders, BUDGET_S, LEAST_ROUNDS, MOST_ROUNDS)
    return [1e9 * statistics.median(seconds) / nstep for seconds in zip(*rounds, strict=True)]


def _stages(model: mujoco.MjModel, nstep: int) -> dict[str, float]:
    """Return the share of a step by stage, from the engine's timers: medians over blocks."""
    timer_s = _timer_s(model, nstep)
    timers = {name: compat.timer(name) for name in engine_stages.TIMERS}
    return engine_stages.shares(
        {name: float(timer_s[timer]) for name, timer in timers.items() if timer is not None}
    )


def _timer_s(model: mujoco.MjModel, nstep: int) -> np.ndarray:
    """Return (ntimer,) seconds by mjtTimer that nstep steps take: the median over blocks."""
    data = workload.start_data(model)
    needs_clock = not compat.has_clock(model)
    if needs_clock:
        mujoco.set_mjcb_time(time.perf_counter)
    try:
        blocks = []
        for _ in range(1 + LEAST_ROUNDS):
            workload.reset_to_start(model, data)
            before = np.array(data.timer.duration)
            mujoco.mj_step(model, data, nstep)
            blocks.append(np.array(data.timer.duration) - before)
    finally:
        if needs_clock:
            mujoco.set_mjcb_time(None)
    return np.asarray(np.median(blocks[1:], axis=0))  # the first touches all memory
