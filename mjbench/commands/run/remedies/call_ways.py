"""The two ways of each remedy for calls of MuJoCo: what programs do, and what mjbench suggests."""

import copy
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np

from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.remedies.remedy_pairs import RemedyPair, TimedWay
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.simulation import compat

# What copies an MjData, by the names of the call clock.
COPIERS: Mapping[str, Callable[[mujoco.MjData], mujoco.MjData]] = {
    call_clock.COPY_OF_DATA: copy.copy,
    call_clock.DEEP_COPY_OF_DATA: copy.deepcopy,
}
# Pixels of a side of a shadow map: that of MuJoCo has 4096, which takes the processor most of an
# image.
SHADOW_SIZE = 1024


# -- functions of the engine -----------------------------------------------------------------------


def _calling(
    model: mujoco.MjModel, names: Sequence[str], steps: int
) -> Callable[[mujoco.MjData], None]:
    functions = [getattr(mujoco, name) for name in ("mj_step", *names)[steps == 0 :]]

    def run(data: mujoco.MjData) -> None:
        for function in functions:
            function(model, data)

    return run


def functions(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return `mj_forward`, and the functions that are enough, each after a step if there is one."""
    assert pair.functions is not None, "the pair names them"
    present = _calling(model, ["mj_forward"], pair.steps)
    return TimedWay(present), TimedWay(_calling(model, pair.functions, pair.steps))


def inverse(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
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

    return TimedWay(before), TimedWay(within)


def one_call(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    def ten_steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data)

    return TimedWay(ten_steps), TimedWay(lambda data: mujoco.mj_step(model, data, 10))


def rays(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    origin = np.array(model.stat.center)
    nray = pair.simulations
    vectors = np.random.default_rng(0).normal(size=(nray, 3))
    geoms, distances = np.empty(nray, np.int32), np.empty(nray)
    geom = np.empty(1, np.int32)

    def one_by_one(data: mujoco.MjData) -> list[float]:
        return [mujoco.mj_ray(model, data, origin, each, None, 1, -1, geom) for each in vectors]

    def at_once(data: mujoco.MjData) -> None:
        compat.cast_rays(model, data, origin, vectors, geoms, distances)

    return TimedWay(one_by_one), TimedWay(at_once)


# -- rollouts --------------------------------------------------------------------------------------


def rollouts(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return two ways of stepping simulations, by the names that the call clock gives them."""
    if (problem := compat.rollout_threads_unavailable()) is not None:
        raise InputError(problem)
    from mujoco import rollout

    threads, nstep = machine.usable_cores(), pair.steps
    datas = [mujoco.MjData(model) for _ in range(threads)]
    one, pool = datas[0], rollout.Rollout(nthread=threads)
    starts = np.empty((pair.simulations, compat.state_size(model, compat.FULLPHYSICS)))

    def take_state(data: mujoco.MjData) -> None:
        compat.get_state(model, data, starts[0], compat.FULLPHYSICS)
        starts[1:] = starts[0]

    def way(name: str) -> TimedWay:
        if name == "Batch.step":
            from mujoco.batch import Batch

            batch = Batch(model, pair.simulations)
            return TimedWay(lambda data: batch.step(nstep=nstep))
        if name == "mj_step":
            singles = [mujoco.MjData(model) for _ in range(pair.simulations)]

            def set_states(data: mujoco.MjData) -> None:
                compat.get_state(model, data, starts[0], compat.FULLPHYSICS)
                for each in singles:
                    compat.set_state(model, each, starts[0], compat.FULLPHYSICS)

            def step_each(data: mujoco.MjData) -> None:
                for each in singles:
                    for _ in range(nstep):
                        mujoco.mj_step(model, each)

            return TimedWay(step_each, prepare=set_states)
        calls: Mapping[str, Callable[[], object]] = {
            "rollout": lambda: rollout.rollout(model, one, starts, nstep=nstep),
            call_clock.THREADED_ROLLOUT: lambda: rollout.rollout(model, datas, starts, nstep=nstep),
            "Rollout.rollout": lambda: pool.rollout(model, datas, starts, nstep=nstep),
        }
        call = calls[name]
        return TimedWay(lambda data: call(), prepare=take_state)

    assert pair.functions is not None, "there are two"
    present, suggested = pair.functions
    return way(present), way(suggested)


def no_rollout(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return one step of one simulation by rollout, and by mj_step."""
    from mujoco import rollout

    starts = np.empty((1, compat.state_size(model, compat.FULLPHYSICS)))
    control = np.zeros((1, 1, model.nu))

    def take_state(data: mujoco.MjData) -> None:
        compat.get_state(model, data, starts[0], compat.FULLPHYSICS)

    def one_step(data: mujoco.MjData) -> None:
        ends, _ = rollout.rollout(model, data, starts[:1], control)
        starts[:1] = ends[:, -1]

    def step(data: mujoco.MjData) -> None:
        data.ctrl[:] = control[0, 0]
        mujoco.mj_step(model, data)

    return TimedWay(one_step, prepare=take_state), TimedWay(step)


# -- objects that are created ----------------------------------------------------------------------


def new_data(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return an MjData that is new each time, and one that stays; both are stepped.

    Steps are timed, too: the first ones after a new MjData pay for its memory.
    """
    assert pair.functions is not None, "there are two"
    present, suggested = pair.functions
    scratch = mujoco.MjData(model)
    copier, is_copy = COPIERS.get(present), suggested == "mj_copyData"
    is_new_copy = is_copy and copier is None

    def create(data: mujoco.MjData) -> mujoco.MjData:
        return mujoco.MjData(model) if copier is None else copier(data)

    def use(fresh: mujoco.MjData, data: mujoco.MjData) -> None:
        if is_new_copy:
            compat.copied_data(model, fresh, data)
        step(fresh)

    def step(stepped: mujoco.MjData) -> None:
        for _ in range(pair.steps):
            mujoco.mj_step(model, stepped)

    def again(data: mujoco.MjData) -> None:
        if is_copy:
            compat.copied_data(model, scratch, data)
        else:
            mujoco.mj_resetData(model, scratch)
        step(scratch)

    return TimedWay.creating(create, use), TimedWay(again)


def renderer(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    height, width = pair.frame
    model.vis.global_.offheight = max(height, model.vis.global_.offheight)
    model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
    permanent = mujoco.Renderer(model, height, width)

    def draw(renderer: mujoco.Renderer, data: mujoco.MjData) -> None:
        renderer.update_scene(data)
        renderer.render()

    def create(data: mujoco.MjData) -> mujoco.Renderer:
        return mujoco.Renderer(model, height, width)

    return TimedWay.creating(create, draw), TimedWay(lambda data: draw(permanent, data))


def coarser_images(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    coarse = copy.copy(model)
    quality = coarse.vis.quality
    quality.shadowsize, quality.offsamples = min(quality.shadowsize, SHADOW_SIZE), 0
    return renderer(model, pair)[1], renderer(coarse, pair)[1]
