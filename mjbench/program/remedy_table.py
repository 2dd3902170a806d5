"""What to do about calls of MuJoCo and JAX in a loop, and about lines: the declared remedies.

A remedy belongs to a call in a context, such as an MjData that is created in a loop.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mjbench.loop.lint_rules import NAMED_ACCESS, NEW_ARRAY
from mjbench.program.calls import CallTime
from mjbench.program.hook import call_clock
from mjbench.program.trials import Trial

# The arguments of a call on a line. Counts of calls that are estimated from bursts vary by this.
_ARGUMENTS, _ABOUT = re.compile(r"mj_inverse\(([^()]*)\)"), 0.1
# Of a loop: calls that span less of it are made at once.
_LEAST_SPREAD = 0.25


@dataclass(frozen=True)
class CallRemedy:
    """What to do about calls of some functions in a loop.

    Attributes:
      text: `{count}` stands for the number of calls.
      trial: that measures what replaces the call; None where nothing does.
      codes: of lint's rules for the same; a finding's own message is shown instead of `text`.
      needs_finding: whether only lint's finding shows the context, such as what is read afterwards.
      is_bound: whether the same has to be computed elsewhere, so that less is saved.
      overlaps: whether the rest of the loop could run meanwhile: no more than that rest is saved.
      is_of_loop: whether it is about all these calls in a loop together.
      is_of_line: whether the rest of the line goes with the call, such as the end of a pool.
      applies: whether calls from one line need it, beside the other calls of their loop.
    """

    callees: tuple[str, ...]
    text: str
    effect: str = "nothing"
    trial: Trial | None = None
    codes: tuple[str, ...] = ()
    needs_finding: bool = False
    keeps_first: bool = False
    is_bound: bool = False
    overlaps: bool = False
    is_of_loop: bool = False
    is_of_line: bool = False
    applies: Callable[[Sequence[CallTime], Sequence[CallTime]], bool] = lambda calls, of_loop: True


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


def count_of(calls: Sequence[CallTime]) -> float:
    return sum(call.calls for call in calls)


# What to do about a call in a loop. A call that stands in none of them is what the program is for.
CALL_REMEDIES = (
    CallRemedy(
        callees=("mj_step",),
        text="nothing happens between these steps: call mj_step(model, data, nstep) once",
        trial=Trial.ONE_CALL,
        codes=("MJB017",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("mj_forward",),
        text="mj_forward computes what the next mj_step computes again",
        effect="nothing since MuJoCo 3.10.0; in 3.3.1 and before, later states within the solver's"
        " tolerance",
        trial=Trial.FUNCTIONS,
        codes=("MJB007",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("mj_inverse",),
        text="mj_inverse computes what depends on positions and velocities, and mj_step computes it"
        " again: call mj_step1, set data.qacc, call mj_inverseSkip(model, data,"
        " mujoco.mjtStage.mjSTAGE_VEL, 1), and then mj_step2",
        trial=Trial.INVERSE,
        applies=_is_of_stepped_data,
    ),
    CallRemedy(
        callees=("mjd_transitionFD",),
        text="with flg_centered=False, half as many steps are taken; None in place of C and D"
        " leaves out sensors",
        effect="derivatives, which are less exact",
        trial=Trial.UNCENTERED,
        applies=lambda calls, of_loop: "True" in calls[0].place.text,
    ),
    CallRemedy(
        callees=("mj_ray",),
        text="mj_multiRay casts all rays from one point in one call",
        trial=Trial.RAYS,
        applies=_are_several_a_step,
    ),
    CallRemedy(
        callees=("MjData", *call_clock.COPIES_OF_DATA),
        text="create one MjData before the loop, and use mj_copyData or mj_setState in it",
        trial=Trial.NEW_DATA_OR_COPY,
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
        trial=Trial.RENDERER,
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
        trial=Trial.POOL,
        codes=("MJB014",),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout takes these simulations one after the other: give it a list with an MjData"
        " for each core, and keep a pool, rollout.Rollout(nthread=n)",
        trial=Trial.MORE_THREADS,
        applies=lambda calls, of_loop: any(c.all_steps > c.steps for c in calls),
    ),
    CallRemedy(
        callees=("rollout",),
        text="rollout copies states for each step of one simulation: write data.ctrl, and call"
        " mj_step(model, data)",
        effect="later states within the solver's tolerance: rollout begins without a warm start",
        trial=Trial.NO_ROLLOUT,
        applies=lambda calls, of_loop: all(c.all_steps == c.calls for c in calls),
    ),
    CallRemedy(
        callees=("Rollout.rollout",),
        text="rollout copies all states for each step: mujoco.batch.Batch keeps them, and its step"
        " takes controls",
        effect="later states within the solver's tolerance: rollout begins without a warm start",
        trial=Trial.BATCH_OR_ROLLOUT,
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


@dataclass(frozen=True)
class LineRemedy:
    """What to do about a line that samples show, by lint's rule `code` or by its text alone."""

    line: re.Pattern[str]
    text: str
    trial: Trial | None = None
    code: str = ""
    effect: str = "nothing"


# The first that fits counts. A finding's own message is shown instead of `text`.
LINE_REMEDIES = (
    LineRemedy(re.compile(""), "", Trial.NAMED_ACCESS, NAMED_ACCESS),
    LineRemedy(
        re.compile(r"\b(np|numpy)\.(concatenate|append|tile|[hv]?stack)\("),
        "",
        Trial.CONCATENATION,
        NEW_ARRAY,
    ),
    LineRemedy(re.compile(""), "", Trial.NEW_ARRAY, NEW_ARRAY),
    LineRemedy(
        re.compile(r"\.contact\[|\bin\b.*\.contact\b(?!\.)"),
        "each contact becomes an object of Python: data.contact.geom, .dist, .pos and the like are"
        " arrays of all contacts, to be read once for each step",
        Trial.CONTACTS,
    ),
    LineRemedy(
        re.compile(r"\blinalg\.p?inv\("),
        "np.linalg.solve(a, b) takes less time than an inverse times b. For the mass matrix,"
        " mj_solveM uses the factor that the step has computed. For a Jacobian, damped least"
        " squares (j.T @ np.linalg.solve(j @ j.T + damping * np.eye(3), x)) take less than"
        " pinv",
        effect="rounding; damping changes the result near singular Jacobians",
    ),
    LineRemedy(
        re.compile(r"\bmj_contactForce\("),
        "choose contacts by data.contact.geom first, and call this for those alone",
    ),
    LineRemedy(
        re.compile(r"\.tolist\(|\bfloat\(\w+\) for "),
        "numbers become objects of Python one by one: write into a row of an array that was created"
        " before the loop (log[i] = data.qpos)",
    ),
)
