"""Where a step's time goes: the engine's stages, Python around it, and the rendering of a frame.

Everything is measured in child processes: one for the steps, one for each rendering backend.
Stages are MuJoCo's own timers (`mjData.timer`), which the engine reads when it has a clock. From
3.3.1 on it has one by default; before, it is lent Python's, which costs more than it measures, so
only shares are taken from them, and times from runs without.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Channel
from mjbench.simulation.models import ModelSource

# A block, in seconds; the fewest and most rounds of blocks, and seconds for all of them.
BLOCK_S, LEAST_ROUNDS, MOST_ROUNDS, BUDGET_S = 0.004, 15, 200, 2.0
# Frames, after one that sets everything up; and the size of a frame, in pixels.
FRAMES, WIDTH, HEIGHT = 20, 640, 480
BACKENDS = ("egl", "osmesa")
# Frames for each second of simulated time, where physics, Python and rendering are compared.
FRAMES_PER_S = 60
# Stages by MuJoCo's timers (mjtTimer); what they leave of a step is `other`.
STAGES: Mapping[str, str] = {
    "kinematics": "POS_KINEMATICS",
    "inertia": "POS_INERTIA",
    "broad-phase collision": "COL_BROAD",
    "narrow-phase collision": "COL_NARROW",
    "collision": "POS_COLLISION",
    "constraint making": "POS_MAKE",
    "constraint projection": "POS_PROJECT",
    "velocity": "VELOCITY",
    "actuation": "ACTUATION",
    "constraint solver": "CONSTRAINT",
    "integration": "ADVANCE",
}


@dataclass(frozen=True)
class Frame:
    """The rendering of one frame.

    Attributes:
      backend: `egl` or `osmesa`.
      seconds: median of scene update and rendering; None where it does not work.
      detail: why not.
    """

    backend: str
    seconds: float | None
    detail: str = ""


@dataclass(frozen=True)
class StepProfile:
    """Where a step's time goes.

    Attributes:
      model: its name.
      timestep: of the model, in seconds.
      loop_ns: a step of the plain Python loop.
      engine_ns: a step in one call for many.
      clock_ns: what the engine's own clock adds to a step; None in releases that have none by
        default.
      work: contacts, constraints, solver iterations per step.
      stages: share of a step by stage; they sum up to 1.
      frames: what rendering costs, by backend.
    """

    model: str
    timestep: float
    loop_ns: float
    engine_ns: float
    clock_ns: float | None
    work: Mapping[str, float]
    stages: Mapping[str, float]
    frames: Sequence[Frame]

    @property
    def python_ns(self) -> float:
        """What the Python loop adds to a step, in ns."""
        return self.loop_ns - self.engine_ns

    def simulated_second(self) -> dict[str, float]:
        """Return seconds of physics, Python, and rendering for each second of simulated time."""
        steps = 1 / self.timestep
        found = {"physics": self.engine_ns * 1e-9 * steps, "Python": self.python_ns * 1e-9 * steps}
        known = {f.backend: f.seconds for f in self.frames if f.seconds is not None}
        found |= {f"rendering ({name})": s * FRAMES_PER_S for name, s in known.items()}
        return found


def measure(source: ModelSource, limit_s: float = 60.0) -> StepProfile:
    """StepProfile a model.

    Raises:
      InputError: it cannot be loaded, or diverges.
      MachineError: the process that steps it crashed or hung.
    """
    request = {"name": source.name, "path": str(source.path)}
    told: dict[str, Any] = {}
    ended = isolate.run("mjbench.loop.profile:step", request, told.update, limit_s)
    if ended.status != "ok":
        raise (InputError if ended.status == "input" else MachineError)(ended.detail)
    frames = [_frame(request, backend, limit_s) for backend in BACKENDS]
    return StepProfile(source.name, frames=frames, **told)


def _frame(request: Mapping[str, Any], backend: str, limit_s: float) -> Frame:
    told: dict[str, Any] = {}
    ended = isolate.run(
        "mjbench.loop.profile:render", {**request, "backend": backend}, told.update, limit_s
    )
    return Frame(backend, told.get("seconds"), "" if ended.status == "ok" else ended.detail)


def step(request: Mapping[str, Any], channel: Channel) -> None:
    """Time steps with and without the engine's clock, and the loop; runs in a child."""
    from mjbench.instrument import timing
    from mjbench.loop import habits
    from mjbench.simulation import compat, models, work, workload

    channel.where("loading the model")
    model = models.load(ModelSource(request["name"], Path(request["path"])))
    channel.where("stepping the model")
    nstep = max(2, int(BLOCK_S / work.step_s(model)))
    # the steps that are timed: from the start state, with its controls
    seen = work.observe(workload.make(model, 1, nstep, spread=0.0))
    if not seen.healthy.all():
        raise InputError(f"the model diverges ({seen.diagnosis()})")

    def timed(*names: str) -> list[float]:
        runs = [habits.loop(habits.find(name), model, nstep).run for name in names]
        for run in runs:
            run()
        contenders = [timing.Contender(_nothing, run, _nothing) for run in runs]
        rounds = timing.rounds(contenders, BUDGET_S, LEAST_ROUNDS, MOST_ROUNDS)
        return [1e9 * statistics.median(taken) / nstep for taken in zip(*rounds, strict=True)]

    stages = _stages(model, nstep)
    loop_ns, engine_ns = timed(habits.BARE.name, "one call for all steps")
    # last: some releases do not get their clock back
    silent_ns = timed("engine clock off") if compat.has_clock(model) else []
    channel.send(
        timestep=float(model.opt.timestep),
        loop_ns=loop_ns,
        engine_ns=engine_ns,
        clock_ns=loop_ns - silent_ns[0] if silent_ns else None,
        work=seen.work.as_dict(),
        stages=stages,
    )


def render(request: Mapping[str, Any], channel: Channel) -> None:
    """Time the rendering of a frame by one backend; runs in a child."""
    import os
    import time

    os.environ["MUJOCO_GL"] = request["backend"]
    try:
        import mujoco
        from mujoco import gl_context  # noqa: F401  fails here where the backend's library is missing
    except Exception as error:
        raise MachineError(_reason(request["backend"], error)) from error
    from mjbench.simulation import models, workload

    model = models.load(ModelSource(request["name"], Path(request["path"])))
    model.vis.global_.offwidth = max(WIDTH, model.vis.global_.offwidth)
    model.vis.global_.offheight = max(HEIGHT, model.vis.global_.offheight)
    data = workload.start_data(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except Exception as error:
        raise MachineError(_reason(request["backend"], error)) from error
    seconds = []
    for _ in range(1 + FRAMES):
        begin = time.perf_counter()
        renderer.update_scene(data)
        renderer.render()
        seconds.append(time.perf_counter() - begin)
    channel.send(seconds=statistics.median(seconds[1:]))


def _reason(backend: str, error: Exception) -> str:
    """Return why rendering does not work, in a line that says what to install."""
    library = {"egl": "libegl1", "osmesa": "libosmesa6"}[backend]
    return f"{type(error).__name__}: {one_line(error)}; it needs the system's {library}"


def _stages(model: Any, nstep: int) -> dict[str, float]:
    """Return the share of a step by stage, from the engine's timers: medians over blocks."""
    import time

    import mujoco
    import numpy as np

    from mjbench.simulation import compat, workload

    data = workload.start_data(model)
    known = [
        getattr(mujoco.mjtTimer, f"mjTIMER_{name}", None) for name in (*STAGES.values(), "STEP")
    ]
    lent = not compat.has_clock(model)
    if lent:
        mujoco.set_mjcb_time(time.perf_counter)
    try:
        blocks = []
        for _ in range(1 + LEAST_ROUNDS):
            workload.reset_to_start(model, data)
            before = np.array(data.timer.duration)
            mujoco.mj_step(model, data, nstep)
            blocks.append(np.array(data.timer.duration) - before)
    finally:
        if lent:
            mujoco.set_mjcb_time(None)
    middle = np.median(blocks[1:], axis=0)  # the first touches memory
    *spent, whole = (0.0 if timer is None else float(middle[timer]) for timer in known)
    found = dict(zip(STAGES, spent, strict=True))
    # of collision, what its two phases do not explain
    phases = found["broad-phase collision"] + found["narrow-phase collision"]
    found["collision"] = max(0.0, found["collision"] - phases)
    whole = max(whole, sum(found.values()), 1e-30)
    found["other"] = whole - sum(found.values())
    return {stage: seconds / whole for stage, seconds in found.items()}


def _nothing() -> None:
    pass
