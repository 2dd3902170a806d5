"""What to do about calls of MuJoCo and JAX in a loop: a row for each remedy.

A remedy belongs to a call in a context, such as an MjData that is created in a loop. The trial of a
row, and what it asks of the program, stand before the rows.
"""

import copy
import math
import re
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.program.call_times import CallTime
from mjbench.program.hook import call_clock
from mjbench.program.remedies import call_savings
from mjbench.program.remedies.call_savings import CallRemedy, CallsInLoop, count_of
from mjbench.program.remedies.trials import Question, Trial, Way
from mjbench.simulation import compat

# The arguments of a call on a line. Counts of calls that are estimated from bursts vary by this.
_ARGUMENTS, _ABOUT = re.compile(r"mj_inverse\(([^()]*)\)"), 0.1
# Of a loop: calls that span less of it are made at once.
_LEAST_SPREAD = 0.25
# Steps after a new MjData that tell what its memory costs them, at most.
_MOST_STEPS = 50
# Rays of a pair where nothing steps between them, and at most.
_USUAL_RAYS, _MOST_RAYS = 32, 1000


# -- functions of the engine -----------------------------------------------------------------------


def _calling(
    model: mujoco.MjModel, names: Sequence[str], steps: int
) -> Callable[[mujoco.MjData], None]:
    functions = [getattr(mujoco, name) for name in ("mj_step", *names)[steps == 0 :]]

    def run(data: mujoco.MjData) -> None:
        for function in functions:
            function(model, data)

    return run


def _functions(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return `mj_forward`, and the functions that are enough, each after a step if there is one."""
    assert question.functions is not None, "the question names them"
    present = _calling(model, ["mj_forward"], question.steps)
    return Way(present), Way(_calling(model, question.functions, question.steps))


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


def _one_call(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    def ten_steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data)

    return Way(ten_steps), Way(lambda data: mujoco.mj_step(model, data, 10))


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


# -- rollouts --------------------------------------------------------------------------------------


def _rollouts(model: mujoco.MjModel, question: Question) -> tuple[Way, Way, Way]:
    """Return simulations on threads of their own, on one thread, and on those of a pool."""
    if (problem := compat.rollout_threads_unavailable()) is not None:
        raise InputError(problem)
    from mujoco import rollout

    threads, nstep = machine.usable_cores(), question.steps
    datas = [mujoco.MjData(model) for _ in range(threads)]
    one, pool = datas[0], rollout.Rollout(nthread=threads)
    starts = np.empty((question.simulations, compat.state_size(model, compat.FULLPHYSICS)))

    def take_state(data: mujoco.MjData) -> None:
        compat.get_state(model, data, starts[0], compat.FULLPHYSICS)
        starts[1:] = starts[0]

    def way(call: Callable[[], object]) -> Way:
        return Way(lambda data: call(), prepare=take_state)

    return (
        way(lambda: rollout.rollout(model, datas, starts, nstep=nstep)),
        way(lambda: rollout.rollout(model, one, starts, nstep=nstep)),
        way(lambda: pool.rollout(model, datas, starts, nstep=nstep)),
    )


def _pool(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    on_threads, _, in_pool = _rollouts(model, question)
    return on_threads, in_pool


def _more_threads(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    _, on_one, in_pool = _rollouts(model, question)
    return on_one, in_pool


def _batch_or_rollout(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return a pool, and a batch, which has no states to copy."""
    _, _, in_pool = _rollouts(model, question)
    from mujoco.batch import Batch

    batch, nstep = Batch(model, question.simulations), question.steps
    return in_pool, Way(lambda data: batch.step(nstep=nstep))


def _no_rollout(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return one step of one simulation."""
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

    return Way(one_step, prepare=take_state), Way(step)


# -- objects that are created ----------------------------------------------------------------------


def _renewed_data(
    model: mujoco.MjModel,
    question: Question,
    copier: Callable[[mujoco.MjData], mujoco.MjData] | None = None,
    is_copy: bool = True,
) -> tuple[Way, Way]:
    """Return an MjData that is new each time, and one that stays; both are stepped.

    Steps are timed, too: memory that is new costs them.
    """
    scratch = mujoco.MjData(model)
    is_new_copy = is_copy and copier is None

    def create(data: mujoco.MjData) -> mujoco.MjData:
        return mujoco.MjData(model) if copier is None else copier(data)

    def use(fresh: mujoco.MjData, data: mujoco.MjData) -> None:
        if is_new_copy:
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

    return Way.creating(create, use), Way(again)


def _new_data_or_reset(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    return _renewed_data(model, question, is_copy=False)


def _copy_or_copy(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    return _renewed_data(model, question, copy.copy)


def _deep_copy_or_copy(model: mujoco.MjModel, question: Question) -> tuple[Way, Way]:
    """Return a deep copy, which copies the model, too, and `mj_copyData`."""
    return _renewed_data(model, question, copy.deepcopy)


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

    return Way.creating(create, draw), Way(lambda data: draw(permanent, data))


# The trials of the rows below.
FUNCTIONS, INVERSE = Trial(_functions), Trial(_inverse)
UNCENTERED, ONE_CALL, RAYS = Trial(_uncentered), Trial(_one_call), Trial(_rays)
POOL, MORE_THREADS = Trial(_pool, on_threads=True), Trial(_more_threads, on_threads=True)
BATCH_OR_ROLLOUT, NO_ROLLOUT = Trial(_batch_or_rollout, on_threads=True), Trial(_no_rollout)
NEW_DATA_OR_RESET, NEW_DATA_OR_COPY = Trial(_new_data_or_reset), Trial(_renewed_data)
COPY_OR_COPY = Trial(_copy_or_copy, of_copied=True)
DEEP_COPY_OR_COPY = Trial(_deep_copy_or_copy, of_copied=True)
RENDERER = Trial(_renderer, by_wall_time=True)


# -- what rows ask, and whether they apply ---------------------------------------------------------


def _functions_question(calls: CallsInLoop) -> Question:
    functions = () if calls.finding is None else tuple(calls.finding.instead)
    return Question(FUNCTIONS, functions, steps=int(calls.nstep > 0))


def _rays_question(calls: CallsInLoop) -> Question:
    of_step = calls.count / calls.nstep if calls.nstep else _USUAL_RAYS
    return Question(RAYS, simulations=min(_MOST_RAYS, max(1, round(of_step))))


def _renderer_question(calls: CallsInLoop) -> Question:
    frame = next((call.frame for call in calls.calls if call.frame), None)
    return Question(RENDERER, frame=frame or (240, 320), backend=calls.calls[0].backend)


def _data_question(calls: CallsInLoop) -> Question:
    longest = max(calls.calls, key=lambda call: call.seconds).callee
    trial = {
        call_clock.COPY_OF_DATA: COPY_OR_COPY,
        call_clock.DEEP_COPY_OF_DATA: DEEP_COPY_OR_COPY,
    }.get(longest, NEW_DATA_OR_COPY)
    if calls.finding is not None and calls.finding.code == "MJB005":
        trial = NEW_DATA_OR_RESET
    after_each = round(calls.nstep / max(1.0, calls.count))
    return Question(trial, steps=min(_MOST_STEPS, after_each))


def _rollout_question(trial: Trial) -> Callable[[CallsInLoop], Question]:
    def question(calls: CallsInLoop) -> Question:
        steps = max(1.0, sum(call.steps for call in calls.calls))
        simulations = sum(call.all_steps for call in calls.calls) / steps
        of_call = steps / max(1.0, calls.count)
        return Question(trial, simulations=max(1, round(simulations)), steps=max(1, round(of_call)))

    return question


def _is_of_stepped_data(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    arguments = _ARGUMENTS.search(calls[0].place.text)
    steps = [each for each in of_loop if each.callee == "mj_step"]
    of_same = [each for each in steps if arguments and f"({arguments[1]}" in each.place.text]
    return math.isclose(count_of(calls), count_of(of_same), rel_tol=_ABOUT)


def _are_several_a_step(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    steps = [each for each in of_loop if each.callee == "mj_step"]
    return count_of(calls) > (1 + _ABOUT) * count_of(steps)


def _are_spread(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    """Return whether calls are made again and again, and not all at once, such as a pool's."""
    begin_ns = min(call.first_ns for call in of_loop)
    loop_ns = max(call.last_ns for call in of_loop) - begin_ns
    calls_ns = max(call.last_ns for call in calls) - min(call.first_ns for call in calls)
    return calls_ns >= _LEAST_SPREAD * loop_ns


# What to do about a call in a loop. A call that stands in none of them is what the program is for.
CALL_REMEDIES = (
    CallRemedy(
        callees=("mj_step",),
        text="nothing happens between these steps: call mj_step(model, data, nstep) once",
        question=lambda calls: Question(ONE_CALL),
        saving=call_savings.of_call_alone,
        codes=("MJB017",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("mj_forward",),
        text="mj_forward computes what the next mj_step computes again",
        effect="nothing since MuJoCo 3.10.0; in 3.3.1 and before, later states within the solver's"
        " tolerance",
        question=_functions_question,
        saving=call_savings.of_functions,
        is_bound=True,
        codes=("MJB007",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("mj_inverse",),
        text="mj_inverse computes what depends on positions and velocities, and mj_step computes it"
        " again: call mj_step1, set data.qacc, call mj_inverseSkip(model, data,"
        " mujoco.mjtStage.mjSTAGE_VEL, 1), and then mj_step2",
        question=lambda calls: Question(INVERSE),
        saving=call_savings.of_functions,
        applies=_is_of_stepped_data,
    ),
    CallRemedy(
        callees=("mjd_transitionFD",),
        text="with flg_centered=False, half as many steps are taken; None in place of C and D"
        " leaves out sensors",
        effect="derivatives, which are less exact",
        question=lambda calls: Question(UNCENTERED),
        applies=lambda calls, of_loop: "True" in calls[0].place.text,
    ),
    CallRemedy(
        callees=("mj_ray",),
        text="mj_multiRay casts all rays from one point in one call",
        question=_rays_question,
        saving=call_savings.of_rays,
        applies=_are_several_a_step,
    ),
    CallRemedy(
        callees=("MjData", *call_clock.COPIES_OF_DATA),
        text="create one MjData before the loop, and use mj_copyData or mj_setState in it",
        question=_data_question,
        saving=call_savings.of_new_data,
        is_bound=True,
        codes=("MJB005", "MJB010"),
    ),
    CallRemedy(
        callees=(
            "from_xml_path",
            "from_xml_string",
            "from_binary_path",
            "from_file",
            "from_string",
            "compile",
            "copy of MjModel",
        ),
        text="compile the model once before the loop: change the compiled model, or keep a pool of"
        " bodies and move those that are not needed away",
        effect="nothing, if the model is the same",
        codes=("MJB011",),
        keeps_first=True,
        is_of_loop=True,
        is_of_line=True,
    ),
    CallRemedy(
        callees=("Renderer",),
        text="create one Renderer before the loop; each creates a graphics context",
        question=_renderer_question,
        saving=call_savings.of_renderers,
        is_bound=True,
        codes=("MJB012",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=(call_clock.COMPILE, call_clock.TRACE),
        text="JAX compiles {count} times here: call jax.jit once, before the loop, and give what"
        " varies as an argument",
        effect="nothing but rounding",
        codes=("MJB013",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=(call_clock.DISPATCH,),
        text="{count} calls of a compiled function: compile the loop itself, by jax.lax.scan over"
        " steps that follow each other, or jax.vmap over independent ones",
        effect="nothing but rounding",
        is_bound=True,
    ),
    CallRemedy(
        callees=(call_clock.DEVICE_WAIT,),
        text="{count} waits for JAX: keep arrays on the device, and wait for or convert results"
        " once after the loop (jax.block_until_ready, np.asarray, float)",
        is_bound=True,
        overlaps=True,
    ),
    CallRemedy(
        callees=(call_clock.TRANSFER,),
        text="{count} transfers to the device: create the arrays there, or transfer them once"
        " before the loop",
        is_bound=True,
    ),
    CallRemedy(
        callees=(call_clock.THREADED_ROLLOUT,),
        text="rollout starts threads for each call: keep a pool, rollout.Rollout(nthread=n), and"
        " give it initial_warmstart where one call continues another",
        question=_rollout_question(POOL),
        codes=("MJB014",),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout takes these simulations one after the other: give it a list with an MjData"
        " for each core, and keep a pool, rollout.Rollout(nthread=n)",
        question=_rollout_question(MORE_THREADS),
        applies=lambda calls, of_loop: any(c.all_steps > c.steps for c in calls),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout copies states for each step of one simulation: write data.ctrl, and call"
        " mj_step(model, data)",
        effect="later states within the solver's tolerance: rollout begins without a warm start",
        question=_rollout_question(NO_ROLLOUT),
        applies=lambda calls, of_loop: all(c.all_steps == c.calls for c in calls),
    ),
    CallRemedy(
        callees=("Rollout.rollout",),
        text="rollout copies all states for each step: mujoco.batch.Batch keeps them, and its step"
        " takes controls",
        effect="later states within the solver's tolerance: rollout begins without a warm start",
        question=_rollout_question(BATCH_OR_ROLLOUT),
        applies=lambda calls, of_loop: all(c.steps == c.calls for c in calls),
    ),
    CallRemedy(
        callees=(call_clock.PROCESS_START,),
        text="processes are started {count} times here: start them once, before the loop, and send"
        " them work; threads (mujoco.rollout) need no start",
        is_of_line=True,
        applies=_are_spread,
    ),
    CallRemedy(
        callees=tuple(f"{call_clock.CALLBACK} {name}" for name in call_clock.CALLBACKS),
        text="MuJoCo calls this Python function in each step, and simulations on threads wait for"
        " each other there: where it sets controls, write data.ctrl before mj_step",
        effect="nothing where it reads only the state before the step; with Runge-Kutta, MuJoCo"
        " calls it four times a step",
        is_bound=True,
    ),
    CallRemedy(
        callees=(call_clock.EAGER_MJX,),
        text="{count} steps of MJX outside a compiled function: jax.jit one function that steps by"
        " jax.lax.scan, with jax.vmap over simulations",
        effect="nothing but rounding",
    ),
)
