"""Ways of doing what a program does: as it does it, and as mjbench suggests.

`replacements` times both in turns on the program's own model.
"""

import copy
import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.simulation import compat


class Trial(enum.StrEnum):
    """Two ways of doing something; the second is what mjbench suggests."""

    FUNCTIONS = "other functions of the engine"
    """`mj_forward`, and the functions that are enough; each after `mj_step`, if steps are given."""
    INVERSE = "inverse dynamics in a step"
    """`mj_inverse` and `mj_step`, and `mj_inverseSkip` between the halves of the step."""
    UNCENTERED = "one-sided differences"
    NEW_DATA_OR_RESET = "mj_resetData"
    """`MjData(model)` with steps, which new memory costs, too, and `mj_resetData` with steps."""
    NEW_DATA_OR_COPY = "mj_copyData"
    """Likewise, with the state of another MjData."""
    COPY_OR_COPY = "mj_copyData in place of copy"
    """`copy.copy(data)` with steps, and `mj_copyData` with steps."""
    DEEP_COPY_OR_COPY = "mj_copyData in place of deepcopy"
    """Likewise, with `copy.deepcopy(data)`, which copies the model, too."""
    ONE_CALL = "nstep"
    NO_TIMER = "no timer"
    NAMED_ACCESS = "hoisted accessor"
    NEW_ARRAY = "array that stays"
    CONCATENATION = "slices of an array that stays"
    CONTACTS = "arrays of contacts"
    RAYS = "mj_multiRay"
    POOL = "pool of threads"
    """`mujoco.rollout.rollout` with its own threads, and `Rollout`, which keeps them."""
    MORE_THREADS = "rollout on threads"
    """`mujoco.rollout.rollout` with one MjData, and `Rollout` with one for each core."""
    NO_ROLLOUT = "mj_step in place of rollout"
    """`mujoco.rollout.rollout` of one step of one simulation, and `mj_step`."""
    BATCH_OR_ROLLOUT = "Batch in place of rollout"
    """`Rollout` with its pool, and `mujoco.batch.Batch`, which has no states to copy."""
    BATCH = "Batch"
    RENDERER = "one Renderer"


@dataclass(frozen=True)
class Question:
    """What to measure.

    Attributes:
      simulations: in turn or at once; rays, for `Trial.RAYS`.
      steps: of each simulation, for trials of rollout; after each new MjData; of each call, for
        `Trial.NO_TIMER`; before the functions of `Trial.FUNCTIONS`.
      frame, backend: height and width in pixels, and `MUJOCO_GL`, for `Trial.RENDERER`.
    """

    trial: Trial
    functions: tuple[str, ...] = ()
    simulations: int = 1
    steps: int = 1
    frame: tuple[int, int] = (240, 320)
    backend: str = ""


@dataclass(frozen=True)
class Way:
    """One way of doing something.

    Attributes:
      create: creates an object for `use`, which together do what `run` does; None if it needs none.
      use: does the rest with the object, which the caller frees.
      has_timer: whether steps read the timer of MuJoCo's Python package.
      prepare: takes over a state, before it is timed.
    """

    run: Callable[[mujoco.MjData], object]
    create: Callable[[mujoco.MjData], Any] | None = None
    use: Callable[[Any, mujoco.MjData], None] = lambda *_: None
    has_timer: bool = True
    prepare: Callable[[mujoco.MjData], None] = lambda data: None


_Ways = Callable[[mujoco.MjModel, Question], tuple[Way, Way]]
_WAYS: dict[Trial, _Ways] = {}
COPIERS: Mapping[Trial, Callable[[mujoco.MjData], mujoco.MjData]] = {
    Trial.COPY_OR_COPY: copy.copy,
    Trial.DEEP_COPY_OR_COPY: copy.deepcopy,
}
# Trials of calls of `mujoco.rollout`.
ROLLOUTS = (Trial.POOL, Trial.MORE_THREADS, Trial.NO_ROLLOUT, Trial.BATCH_OR_ROLLOUT)
# Trials of which other threads compute a part; and those whose seconds are compared with wall time.
ON_THREADS = {*ROLLOUTS, Trial.BATCH} - {Trial.NO_ROLLOUT}
BY_WALL_TIME = {*ON_THREADS, Trial.RENDERER, Trial.NAMED_ACCESS}
# What is raised where a release, a model or a machine lacks something; OpenGL raises its own kinds.
LACKING = (AttributeError, ImportError, ValueError, RuntimeError)


def ways(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return what the program does, and what mjbench suggests; InputError without a use for it."""
    return _WAYS[question.trial](model, question)


def _of(*trials: Trial) -> Callable[[_Ways], _Ways]:
    def declare(function: _Ways) -> _Ways:
        _WAYS.update(dict.fromkeys(trials, function))
        return function

    return declare


def _calling(
    model: mujoco.MjModel, names: Sequence[str], steps: int
) -> Callable[[mujoco.MjData], None]:
    functions = [getattr(mujoco, name) for name in ("mj_step", *names)[steps == 0 :]]

    def run(data: mujoco.MjData) -> None:
        for function in functions:
            function(model, data)

    return run


@_of(Trial.FUNCTIONS)
def _functions(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    present = _calling(model, ["mj_forward"], question.steps)
    return Way(present), Way(_calling(model, question.functions, question.steps))


@_of(Trial.INVERSE)
def _inverse(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return inverse dynamics before a step, and within it; halves are no Runge-Kutta."""
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise InputError("mj_step1 and mj_step2 integrate by Euler")
    velocity = mujoco.mjtStage.mjSTAGE_VEL

    def before(data: mujoco.MjData) -> None:
        mujoco.mj_inverse(model, data)
        mujoco.mj_step(model, data)

    def within(data: mujoco.MjData) -> None:
        mujoco.mj_step1(model, data)
        mujoco.mj_inverseSkip(model, data, velocity, 1)
        mujoco.mj_step2(model, data)

    return Way(before), Way(within)


@_of(Trial.UNCENTERED)
def _uncentered(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    size = 2 * model.nv + model.na
    by_state, by_control = np.empty((size, size)), np.empty((size, model.nu))

    def way(centered: bool) -> Way:
        return Way(
            lambda data: mujoco.mjd_transitionFD(
                model, data, 1e-6, centered, by_state, by_control, None, None
            )
        )

    return way(True), way(False)


@_of(Trial.ONE_CALL)
def _one_call(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    def ten_steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data)

    return Way(ten_steps), Way(lambda data: mujoco.mj_step(model, data, 10))


@_of(Trial.NO_TIMER)
def _no_timer(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    def steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data, question.steps)

    return Way(steps), Way(steps, has_timer=False)


@_of(Trial.NAMED_ACCESS)
def _named_access(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    names = [model.body(body).name for body in range(model.nbody)]
    body = next(name for name in reversed(names) if name)  # the world has one
    hoisted: list[Any] = []

    def before_the_loop(data: mujoco.MjData) -> Any:
        if not hoisted:  # all calls are of the same data
            hoisted.append(data.body(body))
        return hoisted[0].xpos[0]

    return Way(lambda data: data.body(body).xpos[0]), Way(before_the_loop)


@_of(Trial.NEW_ARRAY)
def _new_array(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    permanent = np.zeros(model.nv)

    def write(data: mujoco.MjData) -> None:
        permanent[:] = 0.0

    return Way(lambda data: np.zeros(model.nv)), Way(write)


@_of(Trial.CONCATENATION)
def _concatenation(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    nq = model.nq
    permanent = np.empty(nq + 2 * model.nv)
    after_velocities = nq + model.nv

    def write(data: mujoco.MjData) -> None:
        permanent[:nq] = data.qpos
        permanent[nq:after_velocities] = data.qvel
        permanent[after_velocities:] = data.qacc

    return Way(lambda data: np.concatenate([data.qpos, data.qvel, data.qacc])), Way(write)


@_of(Trial.CONTACTS)
def _contacts(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    return (
        Way(lambda data: [contact.dist for contact in data.contact]),
        Way(lambda data: data.contact.dist),
    )


@_of(Trial.RAYS)
def _rays(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    origin = np.array(model.stat.center)
    nray = question.simulations
    vectors = np.random.default_rng(0).normal(size=(nray, 3))
    geoms, distances = np.empty(nray, np.int32), np.empty(nray)
    geom = np.empty(1, np.int32)

    def one_by_one(data: mujoco.MjData) -> list[float]:
        return [mujoco.mj_ray(model, data, origin, each, None, 1, -1, geom) for each in vectors]

    def at_once(data: mujoco.MjData) -> None:
        compat.cast_rays(model, data, origin, vectors, geoms, distances)

    return Way(one_by_one), Way(at_once)


@_of(*ROLLOUTS)
def _rollouts(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    from mujoco import rollout

    threads, nstep = machine.usable_cores(), question.steps
    datas = [mujoco.MjData(model) for _ in range(threads)]
    spec = compat.FULLPHYSICS
    starts = np.empty((question.simulations, compat.state_size(model, spec)))
    control = np.zeros((1, 1, model.nu))

    def take_state(data: mujoco.MjData) -> None:
        compat.get_state(model, data, starts[0], spec)
        starts[1:] = starts[0]

    def way(call: Callable[[], object]) -> Way:
        return Way(lambda data: call(), prepare=take_state)

    def one_step(data: mujoco.MjData) -> None:
        ends, _ = rollout.rollout(model, data, starts[:1], control)
        starts[:1] = ends[:, -1]

    def step(data: mujoco.MjData) -> None:
        data.ctrl[:] = control[0, 0]
        mujoco.mj_step(model, data)

    if question.trial == Trial.NO_ROLLOUT:
        return Way(one_step, prepare=take_state), Way(step)
    if (problem := compat.rollout_threads_unavailable()) is not None:
        raise InputError(problem)
    pool = rollout.Rollout(nthread=threads)
    in_pool = way(lambda: pool.rollout(model, datas, starts, nstep=nstep))
    if question.trial == Trial.BATCH_OR_ROLLOUT:
        from mujoco.batch import Batch

        batch = Batch(model, question.simulations)
        return in_pool, Way(lambda data: batch.step(nstep=nstep))
    own = datas[0] if question.trial == Trial.MORE_THREADS else datas
    return way(lambda: rollout.rollout(model, own, starts, nstep=nstep)), in_pool


@_of(Trial.BATCH)
def _batch(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return simulations in turn, and as a batch, from the model's own start."""
    from mujoco.batch import Batch

    datas = [mujoco.MjData(model) for _ in range(question.simulations)]
    batch = Batch(model, question.simulations)

    def in_turn(data: mujoco.MjData) -> None:
        for each in datas:
            mujoco.mj_step(model, each)

    return Way(in_turn), Way(lambda data: batch.step())


def _creating(
    create: Callable[[mujoco.MjData], Any], use: Callable[[Any, mujoco.MjData], None]
) -> Way:
    return Way(lambda data: use(create(data), data), create, use)


@_of(Trial.NEW_DATA_OR_RESET, Trial.NEW_DATA_OR_COPY, Trial.COPY_OR_COPY, Trial.DEEP_COPY_OR_COPY)
def _new_data(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    scratch = mujoco.MjData(model)
    is_copy = question.trial != Trial.NEW_DATA_OR_RESET

    def create(data: mujoco.MjData) -> mujoco.MjData:
        copier = COPIERS.get(question.trial)
        return mujoco.MjData(model) if copier is None else copier(data)

    def use(fresh: mujoco.MjData, data: mujoco.MjData) -> None:
        if question.trial == Trial.NEW_DATA_OR_COPY:
            compat.copied_data(model, fresh, data)
        step(fresh)

    def step(stepped: mujoco.MjData) -> None:
        for _ in range(question.steps):
            mujoco.mj_step(model, stepped)

    def again(data: mujoco.MjData) -> None:
        if is_copy:
            compat.copied_data(model, scratch, data)
        else:
            mujoco.mj_resetData(model, scratch)
        step(scratch)

    return _creating(create, use), Way(again)


@_of(Trial.RENDERER)
def _renderer(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    height, width = question.frame
    model.vis.global_.offheight = max(height, model.vis.global_.offheight)
    model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
    permanent = mujoco.Renderer(model, height, width)

    def draw(renderer: mujoco.Renderer, data: mujoco.MjData) -> None:
        renderer.update_scene(data)
        renderer.render()

    def create(data: mujoco.MjData) -> mujoco.Renderer:
        return mujoco.Renderer(model, height, width)

    return _creating(create, draw), Way(lambda data: draw(permanent, data))
