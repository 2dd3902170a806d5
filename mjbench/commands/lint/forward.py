"""mj_forward right after mj_step: what of it a script reads, and which functions compute just that.

`mj_step` computes from the state before it, and then integrates. What is computed belongs to the
old state until something computes it again. For positions, `mj_kinematics` does; `mj_forward` also
finds contacts and solves constraints, which the next `mj_step` does once more.
tests/commands/lint/test_forward.py checks that the functions named here give what `mj_forward`
gives.
"""

import ast
from collections.abc import Iterator, Mapping, Set

from mjbench.commands.lint.data_uses import DataUses, uses_of
from mjbench.commands.lint.repeats import iterations
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import block_around, is_call, last_name, names_in
from mjbench.commands.lint.stepping_script import SteppingScript

_RECOMPUTES = ("mj_forward", "mj_step1", "mj_fwdPosition")
_STEPS = {"mj_step", "mj_step1", "mj_step2"}
_ENDS_OR_CALLS = ast.Call | ast.Yield | ast.YieldFrom | ast.Return | ast.Break | ast.Continue
# Fields of the state and the inputs, which no such function changes.
STATE = {
    *("qpos", "qvel", "act", "time", "ctrl", "qfrc_applied", "xfrc_applied", "mocap_pos"),
    *("mocap_quat", "userdata", "eq_active"),
}
# Fields that other functions compute; `mj_camlight` and `mj_tendon` need both of the others.
COMPUTED: Mapping[str, Set[str]] = {
    "mj_kinematics": {
        *("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis"),
        *("geom_xpos", "geom_xmat", "site_xpos", "site_xmat"),
    },
    "mj_comPos": {"subtree_com", "cinert", "cdof"},
    "mj_camlight": {"cam_xpos", "cam_xmat", "light_xpos", "light_xdir"},
    "mj_tendon": {"ten_length", "ten_J"},
}
# Functions of the engine that read only the state, or compute what they read.
_INDEPENDENT = {
    *("mj_step", "mj_forward", "mj_resetData", "mj_resetDataKeyframe", "mj_kinematics"),
    *("mj_setState", "mj_getState"),
}
# Functions that read what `mj_comPos` computes.
_JACOBIANS = {
    *("mj_jacSite", "mj_jacGeom", "mj_jacBody", "mj_jacBodyCom", "mj_jacSubtreeCom", "mj_jac")
}


@rule("MJB007", "mj_forward after mj_step computes another step's worth, of which little is read")
def forward_after_step(script: SteppingScript) -> Iterator[Match]:
    """Yield calls of mj_forward after mj_step of which a script reads nothing, or positions.

    `mj_step` computes positions, contacts and forces from the state before it, and then integrates.
    `mj_forward` after it computes all of that for the new state, and the next `mj_step` does so
    again. Stepping does not need it. `qpos`, `qvel`, `act` and `time` are those of the new state
    without it. Where positions of the new state are read, `mj_kinematics` computes them; with
    `mj_comPos`, centres of mass and what Jacobians need; with `mj_camlight`, cameras and lights;
    with `mj_tendon`, lengths of tendons.

        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)  # write: mujoco.mj_kinematics(model, data)
        height = data.body("torso").xpos[2]

    A loop that sets positions and does not step, as one of inverse kinematics, does not need all of
    `mj_forward` either.

    There is no finding where the script reads anything else, such as contacts or sensors, or gives
    the MjData to code that is not in the file.

    Results in MuJoCo 4.0.0: none change, bit for bit, as in all releases that were tried from
    3.3.6 on. Up to 3.3.5, `mj_forward` also leaves its solution as the start of the next step's
    solver, so without it later states differ, by the solver's tolerance at first. In 2.3.7, it
    normalizes the quaternions in `qpos`, too, whose last bits differ if no call takes its place.
    """
    for call in script.calls:
        name, statement = last_name(call.func), script.parents[call]
        if name not in _RECOMPUTES or not isinstance(statement, ast.Expr) or len(call.args) != 2:
            continue
        if any("set_mjcb" in each for each in script.bindings.identifiers):
            return  # mj_forward calls what the script installs
        data = call.args[1]
        uses = uses_of(script, data) if isinstance(data, ast.Name) else None
        instead = _enough(uses)
        if uses is None or instead is None:
            continue
        loops = [each.loop for each in iterations(script, call)]
        follows_step = _follows_step(script, call, statement)
        if follows_step:
            is_useless = any(map(script.steps_inside, loops))
        else:
            has_steps = not uses.functions.isdisjoint(_STEPS)
            is_useless = bool(loops and instead) and name == "mj_forward" and not has_steps
        if is_useless:
            message = _message(name, call, instead, follows_step)
            yield Match(call, None, message, instead)


def _follows_step(script: SteppingScript, call: ast.Call, statement: ast.Expr) -> bool:
    block = block_around(statement, script.parents.get(statement))
    arguments = [*map(ast.dump, call.args)]
    for before in reversed(block[: block.index(statement)] if block else []):
        if isinstance(before, ast.For | ast.While) and not before.orelse:
            before = before.body[-1]  # the last of several steps
        step = before.value if isinstance(before, ast.Expr) else None
        if is_call(step, "mj_step") and [*map(ast.dump, step.args[:2])] == arguments:
            return True
        if names_in(before) & names_in(call.args[1]):
            return False
        if any(isinstance(n, _ENDS_OR_CALLS) for n in ast.walk(before)):
            return False
    return False


def _enough(uses: DataUses | None) -> tuple[str, ...] | None:
    """Return the functions that compute all that is read; None where that is not known."""
    if uses is None or uses.functions - _INDEPENDENT - _JACOBIANS - set(_RECOMPUTES):
        return None
    return enough_for(uses.fields - STATE, bool(uses.functions & _JACOBIANS))


def enough_for(computed: Set[str], with_jacobians: bool = False) -> tuple[str, ...] | None:
    """Return the functions that compute fields, none of them of the state; None for others."""
    if computed - set().union(*COMPUTED.values()):
        return None
    needed = {name for name, fields in COMPUTED.items() if computed & fields}
    if with_jacobians or needed - {"mj_kinematics"}:
        needed.add("mj_comPos")
    if needed:
        needed.add("mj_kinematics")
    return tuple(name for name in COMPUTED if name in needed)


def _message(name: str, call: ast.Call, instead: tuple[str, ...], follows_step: bool) -> str:
    when, worth = (" after mj_step", "another") if follows_step else ("", "a")
    if not instead:
        return f"{name}{when} computes what nothing reads; delete it"
    arguments = ", ".join(ast.unparse(argument) for argument in call.args)
    calls = ", ".join(f"{function}({arguments})" for function in instead)
    kind = "positions are" if instead == ("mj_kinematics",) else "what follows from positions is"
    verb = "is" if len(instead) == 1 else "are"
    return f"{name}{when} computes {worth} step's worth; only {kind} read: {calls} {verb} enough"
