"""What to do about calls of MuJoCo and JAX in a loop: a row for each remedy.

A remedy belongs to a call in a context, such as an MjData that is created in a loop. What a row
asks of the program stands before the rows; the ways of its pair are in `call_ways`.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco

from mjbench.commands.run.activities import Activity
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.remedies import call_savings, call_ways
from mjbench.commands.run.remedies.call_savings import CallRemedy, CallsInLoop, count_of, steps_of
from mjbench.commands.run.remedies.remedy_pairs import RemedyPair, TimedWay

# What is given to mj_inverse on a line.
_INVERSE_ARGUMENTS = re.compile(r"mj_inverse\(([^()]*)\)")
# Counts of calls that are estimated from bursts vary by about this share.
_COUNT_ERROR = 0.1
# Calls that span less than this share of their loop are one burst, such as the starts of a pool.
_LEAST_SPREAD = 0.25
# At most so many steps follow a new MjData in a pair: the first ones pay for its memory.
_MOST_STEPS = 50
# Simulations that one thread may step faster than several, which are woken for each step.
_MOST_IN_TURN = 64
_WITHOUT_WARM_START = (
    "later states within the solver's tolerance: rollout begins without a warm start"
)
# Rays of a pair where nothing steps between them, and at most.
_USUAL_RAYS, _MOST_RAYS = 32, 1000


def _functions_pair(calls: CallsInLoop) -> RemedyPair:
    enough = () if calls.finding is None else tuple(calls.finding.instead)
    return RemedyPair(call_ways.functions, enough, steps=int(calls.nstep > 0))


def _rays_pair(calls: CallsInLoop) -> RemedyPair:
    steps = count_of(steps_of(calls.loop.calls))
    of_step = calls.count / steps if steps else _USUAL_RAYS
    return RemedyPair(call_ways.rays, simulations=min(_MOST_RAYS, max(1, round(of_step))))


def _renderer_pair(calls: CallsInLoop) -> RemedyPair:
    frame = next((call.frame for call in calls.calls if call.frame), None) or (240, 320)
    return RemedyPair(
        call_ways.renderer, frame=frame, backend=calls.calls[0].backend, by_wall_time=True
    )


def _data_pair(calls: CallsInLoop) -> RemedyPair:
    steps = min(_MOST_STEPS, round(calls.nstep / max(1.0, calls.count)))
    if calls.finding is not None and calls.finding.code == "MJB005":
        return RemedyPair(call_ways.new_data, ("MjData", "mj_resetData"), steps=steps)
    longest = max(calls.calls, key=lambda call: call.seconds).callee
    present = longest if longest in call_ways.COPIERS else "MjData"
    is_copied = present in call_ways.COPIERS
    return RemedyPair(
        call_ways.new_data, (present, "mj_copyData"), steps=steps, of_copied=is_copied
    )


def _rollout_pair(
    ways: Callable[[mujoco.MjModel, RemedyPair], tuple[TimedWay, TimedWay]], *names: str
) -> Callable[[CallsInLoop], RemedyPair]:
    def pair(calls: CallsInLoop) -> RemedyPair:
        steps = max(1.0, sum(call.steps for call in calls.calls))
        return RemedyPair(
            ways,
            names,
            simulations=max(1, round(sum(call.all_steps for call in calls.calls) / steps)),
            steps=max(1, round(steps / max(1.0, calls.count))),
            on_threads=ways is call_ways.rollouts,
        )

    return pair


def _is_of_stepped_data(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    arguments = _INVERSE_ARGUMENTS.search(calls[0].place.text)
    steps = steps_of(of_loop)
    of_same = [each for each in steps if arguments and f"({arguments[1]}" in each.place.text]
    return math.isclose(count_of(calls), count_of(of_same), rel_tol=_COUNT_ERROR)


def _are_several_a_step(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    return count_of(calls) > (1 + _COUNT_ERROR) * count_of(steps_of(of_loop))


def _are_of_one_step(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    return all(call.steps == call.calls for call in calls)


def _are_of_few(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    is_few = all(call.all_steps <= _MOST_IN_TURN * call.steps for call in calls)
    return is_few and _are_of_one_step(calls, of_loop)


def _are_spread(calls: Sequence[CallTime], of_loop: Sequence[CallTime]) -> bool:
    """Return whether calls are made again and again, and not all at once, such as a pool's."""
    begin_ns = min(call.first_ns for call in of_loop)
    loop_ns = max(call.last_ns for call in of_loop) - begin_ns
    calls_ns = max(call.last_ns for call in calls) - min(call.first_ns for call in calls)
    # on a busy machine, starts of a pool take long, and nothing happens between them
    own_ns = 1e9 * call_savings.seconds_of(calls)
    return calls_ns >= max(_LEAST_SPREAD * loop_ns, 2 * own_ns)


# What to do about a call in a loop. A call that stands in none of them is what the program is for.
CALL_REMEDIES = (
    CallRemedy(
        callees=("mj_step",),
        text="nothing happens between these steps: call mj_step(model, data, nstep) once",
        pair=lambda calls: RemedyPair(call_ways.one_call),
        saving=call_savings.of_call_alone,
        codes=("MJB017",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("mj_forward",),
        text="mj_forward computes what the next mj_step computes again",
        effect="nothing since MuJoCo 3.3.6; before, later states within the solver's tolerance",
        pair=_functions_pair,
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
        pair=lambda calls: RemedyPair(call_ways.inverse),
        saving=call_savings.of_functions,
        applies=_is_of_stepped_data,
    ),
    CallRemedy(
        callees=("mj_ray",),
        text="mj_multiRay casts all rays from one point in one call",
        pair=_rays_pair,
        saving=call_savings.of_rays,
        applies=_are_several_a_step,
    ),
    CallRemedy(
        callees=("MjData", *call_clock.COPIES_OF_DATA),
        text="create one MjData before the loop, and use mj_copyData or mj_setState in it",
        pair=_data_pair,
        saving=call_savings.of_new_data,
        is_bound=True,
        codes=("MJB005", "MJB010"),
    ),
    CallRemedy(
        callees=call_clock.LOADERS,
        text="compile the model once before the loop (in a pool of processes, by its initializer):"
        " change the compiled model, or keep a pool of bodies and move those that are not needed"
        " away",
        effect="nothing, if the model is the same",
        codes=("MJB011",),
        keeps_first=True,
        is_of_loop=True,
        is_of_line=True,
    ),
    CallRemedy(
        callees=("copy of MjModel",),
        text="this copies the model, too: several MjData can share one MjModel; create one MjData"
        " before the loop, and use mj_copyData in it",
        effect="nothing, if the program does not change the copy of the model",
        is_of_line=True,
    ),
    CallRemedy(
        callees=("Renderer",),
        text="create one Renderer before the loop; each creates a graphics context",
        pair=_renderer_pair,
        saving=call_savings.of_renderers,
        is_bound=True,
        codes=("MJB012",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=("render",),
        text=f'draw coarser images, by <quality shadowsize="{call_ways.SHADOW_SIZE}"'
        ' offsamples="0"/> in <visual> of the model',
        effect="shadows, and edges, which are not smoothed",
        pair=lambda calls: replace(_renderer_pair(calls), ways=call_ways.coarser_images),
        saving=call_savings.of_images,
        is_of_loop=True,
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
        text="",  # lint says it
        is_bound=True,
        codes=("MJB022",),
        needs_finding=True,
        is_of_loop=True,
        is_of_line=True,
        also=Activity.COMPARING,
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
        pair=_rollout_pair(call_ways.rollouts, call_clock.THREADED_ROLLOUT, "Rollout.rollout"),
        codes=("MJB014",),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout takes these simulations one after the other: give it a list with an MjData"
        " for each core, and keep a pool, rollout.Rollout(nthread=n)",
        pair=_rollout_pair(call_ways.rollouts, "rollout", "Rollout.rollout"),
        applies=lambda calls, of_loop: any(c.all_steps > c.steps for c in calls),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout copies states for each step of one simulation: write data.ctrl, and call"
        " mj_step(model, data)",
        effect=_WITHOUT_WARM_START,
        pair=_rollout_pair(call_ways.no_rollout),
        applies=lambda calls, of_loop: all(c.all_steps == c.calls for c in calls),
    ),
    CallRemedy(
        callees=("Rollout.rollout",),
        text="rollout copies all states for each step: mujoco.batch.Batch keeps them; write"
        " batch.ctrl, and call batch.step()",
        effect=_WITHOUT_WARM_START,
        pair=_rollout_pair(call_ways.rollouts, "Rollout.rollout", "Batch.step"),
        applies=_are_of_one_step,
    ),
    CallRemedy(
        callees=("Rollout.rollout",),
        text="each step is handed over to threads: take many in one call where their controls are"
        " known, or keep an MjData for each simulation, and call mj_step",
        effect=_WITHOUT_WARM_START,
        pair=_rollout_pair(call_ways.rollouts, "Rollout.rollout", "mj_step"),
        applies=_are_of_few,
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
