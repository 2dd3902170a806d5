"""The rules of `mjbench lint`: what each one looks for in a stepping script.

A new rule is a function that yields matches, and a line of `RULES`.
"""

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mjbench.loop.script_names import last_name
from mjbench.loop.stepping_script import SteppingScript
from mjbench.loop.stored_views import StoredViews

# The codes of the rules on views that outlive their step, and on names looked up in every step.
STORED_VIEW, NAMED_ACCESS = "MJB001", "MJB002"
# Habits of the overhead table (mjbench/loop/habits.py) by which rules say what a match costs.
NAMED_ACCESS_HABIT = "named access by name"
# Functions of NumPy that allocate an array, with the habit that costs about as much.
_CREATE = (
    "zeros",
    "ones",
    "empty",
    "full",
    "zeros_like",
    "ones_like",
    "empty_like",
    "array",
    "eye",
)
ALLOCATION_HABITS = {
    **dict.fromkeys(_CREATE, "allocate zeros"),
    **dict.fromkeys(("concatenate", "append", "tile"), "concatenate"),
    **dict.fromkeys(("hstack", "vstack", "stack"), "hstack"),
}
# Calls that begin an episode.
_EPISODE_STARTS = {"mj_resetData", "mj_resetDataKeyframe", "mj_setState", "MjData"}


@dataclass(frozen=True)
class Match:
    """A node that breaks a rule.

    Attributes:
      node: where the finding points.
      habit: that costs about as much in each step; empty where the rule is not about time.
    """

    node: ast.expr | ast.stmt
    habit: str = ""


@dataclass(frozen=True)
class Rule:
    """What is looked for.

    Attributes:
      code: as in `# noqa: MJB001`.
      message: what is wrong, and what to write instead.
      matches: yields the nodes of a script that break the rule.
    """

    code: str
    message: str
    matches: Callable[[SteppingScript], Iterator[Match]]


def _stored_views(script: SteppingScript) -> Iterator[Match]:
    """Yield views that outlive the iteration in which they were taken."""
    yield from map(Match, StoredViews(script).all())


def _named_access(script: SteppingScript) -> Iterator[Match]:
    for loop in (*script.loops, *script.environment_loops):
        for node in loop.inner:
            if (
                isinstance(node, ast.Call)
                and (script.is_named_access(node) or last_name(node.func) == "mj_name2id")
                and script.runs_each_step(node, loop)
            ):
                yield Match(node, NAMED_ACCESS_HABIT)


def _allocations(script: SteppingScript) -> Iterator[Match]:
    """Yield calls that allocate an array; not those under an `if`, which may run only once."""
    for loop in script.loops:
        for node in loop.inner:
            if (
                isinstance(node, ast.Call)
                and last_name(node.func) in ALLOCATION_HABITS
                and script.is_numpy_call(node)
                and not any(keyword.arg == "out" for keyword in node.keywords)
                and script.runs_each_step(node, loop)
                and not script.is_conditional(node, loop)
            ):
                yield Match(node, ALLOCATION_HABITS[last_name(node.func)])


def _new_data_per_episode(script: SteppingScript) -> Iterator[Match]:
    """Yield each new MjData of an episode, but not one of a model that is new as well."""
    for loop in script.episode_loops:
        yield from (Match(node) for node in loop.inner if script.is_new_data(node, loop))


def _serial_simulations(script: SteppingScript) -> Iterator[Match]:
    """Yield loops that begin a simulation in each iteration, and step it in a loop inside."""
    for loop in script.episode_loops:
        begins = any(
            isinstance(node, ast.Call) and last_name(node.func) in _EPISODE_STARTS
            for node in loop.inner
        )
        if begins and any(script.is_for_over_steps(node) for node in loop.inner):
            yield Match(loop.node)


RULES = (
    Rule(
        STORED_VIEW,
        "a view is stored: every entry will show the last state; add .copy()",
        _stored_views,
    ),
    Rule(
        NAMED_ACCESS,
        "named access inside a stepping loop; hoist it: x = data.joint('x').qpos before the loop",
        _named_access,
    ),
    Rule(
        "MJB003",
        "a new array in every step; create one before the loop and write into its slices (x[:n] =)",
        _allocations,
    ),
    Rule(
        "MJB005",
        "a new MjData for every episode; create one and call mj_resetData",
        _new_data_per_episode,
    ),
    Rule(
        "MJB006",
        "a loop over simulations around a loop over steps; mujoco.rollout or mujoco.batch does both"
        " on threads (mjbench compare says which)",
        _serial_simulations,
    ),
)
