"""Halves of a Runge-Kutta step, one MjData that several threads step, and views that callers write.

    obs = env.state()               # returns self.data.qpos
    obs -= mean                     # moves the robot

A caller that means to set the state says so: it computes what follows from it, by `mj_forward` or
the like, in a method called `reset` or `set_…`, through a function named after the field, as `qpos`
is, or as a view. Such a caller is left out.
"""

import ast
import re
from collections.abc import Iterator

from mjbench.commands.lint.repeats import iterations
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    attributes_in,
    bound_in,
    dotted_name,
    is_call,
    is_step,
    last_name,
    names_in,
    nodes_inside,
    parameters_of,
)
from mjbench.commands.lint.stepping_script import FIELDS, SteppingScript
from mjbench.commands.lint.stored_views import stored_views
from mjbench.commands.lint.view_writes import WRITING_FUNCTIONS, WRITING_METHODS

_RK4_TEXT = re.compile(r"""integrator\s*=\s*["']RK4["']""")
# What does not write through a view: `resize` raises an error, and `setflags(write=False)` prevents
# writes. The first argument of `partial` is a function.
_METHODS_THAT_WRITE = WRITING_METHODS - {"resize", "setflags"}
_FUNCTIONS_THAT_WRITE = WRITING_FUNCTIONS - {"partial"}
# Functions that set a state, or compute what follows from one that was set.
_SETS = re.compile(r"(mj_(forward|kinematics|fwdPosition|setState)|(re)?set(_\w+)?|forward)$")
_PROMISES_VIEW = re.compile(r"(^|_)(view|ref|pointer|ptr|proxy|buffer)s?(_|$)")


@rule(
    "MJB008",
    "mj_step2 integrates by Euler, but the model has the RK4 integrator; call mj_step",
    is_wrong_result=True,
)
def halves_of_runge_kutta(script: SteppingScript) -> Iterator[Match]:
    """Yield calls of mj_step2 with a model that the script itself gives the RK4 integrator.

    `mj_step` with `integrator="RK4"` computes four stages. `mj_step1` and `mj_step2` cannot:
    `mj_step2` integrates by Euler, without a warning, so states differ from those of `mj_step`.

        mujoco.mj_step1(model, data)
        data.ctrl[:] = policy(data)
        mujoco.mj_step2(model, data)

        data.ctrl[:] = policy(data)     # instead: the policy sees positions of the step before
        mujoco.mj_step(model, data)

    Or choose `implicitfast`, which both ways of stepping compute.

    Results: the states become those of the integrator that the model asks for.
    """
    for call in script.calls:
        if is_call(call, "mj_step2") and call.args:
            model = dotted_name(call.args[0])
            if model and _is_runge_kutta(script, model):
                yield Match(call)


def _is_runge_kutta(script: SteppingScript, model: str) -> bool:
    """Return whether all that a script shows of a model's integrator is RK4."""
    integrators = script.assigned_anywhere(f"{model}.opt.integrator")
    if integrators:
        # without a cast such as `int(x)`
        plain = (
            v.args[0] if isinstance(v, ast.Call) and len(v.args) == 1 else v for v in integrators
        )
        return all("mjINT_RK4" in dotted_name(value) for value in plain)
    texts = [_text_of(script, value) for value in script.assigned_anywhere(model)]
    return bool(texts) and all(_RK4_TEXT.search(text) for text in texts)


def _text_of(script: SteppingScript, model: ast.AST) -> str:
    """Return the XML that a model is loaded from, where the script holds it; else nothing."""
    if not (is_call(model, "from_xml_string") and model.args):
        return ""
    text: ast.AST = model.args[0]
    texts = script.assigned_anywhere(text.id) if isinstance(text, ast.Name) else []
    if len(texts) == 1:
        (text,) = texts
    constants = (part.value for part in ast.walk(text) if isinstance(part, ast.Constant))
    return "".join(value for value in constants if isinstance(value, str))


@rule(
    "MJB009",
    "several threads step one MjData and overwrite its state; create an MjData for each thread"
    " (they may share the model)",
    is_wrong_result=True,
)
def shared_data(script: SteppingScript) -> Iterator[Match]:
    """Yield where a loop hands one MjData to several threads, each of which steps it.

    An MjData holds one state and all that is computed from it. `mj_step` releases Python's lock, so
    threads that step one MjData write to the same memory at the same time: states are wrong, differ
    from run to run, and the program may crash.

        for _ in range(4):
            threading.Thread(target=simulate, args=(model, data)).start()

        for _ in range(4):              # instead
            threading.Thread(target=simulate, args=(model, mujoco.MjData(model))).start()

    A model that no thread changes may be shared. `mujoco.rollout` has threads of its own.

    Results: each thread simulates its own state.
    """
    starts = [call for call in script.calls if is_call(call, "Thread", "submit", "map")]
    executors = {dotted_name(t) for t, v in script.values.items() if _is_thread_pool(v)} - {""}
    for call in starts:
        work = _work(call, executors)
        function = script.functions.named(work[0]) if work else None
        if function is None or any(isinstance(node, ast.With) for node in ast.walk(function)):
            continue
        if not attributes_in(function).isdisjoint(("acquire", "wait", "get")):
            continue
        each = next(iterations(script, call), None)
        loop = each.loop if each is not None else None
        # it may wait for a thread that it started before it starts the next
        in_turn = loop is None or not attributes_in(loop).isdisjoint(("join", "result"))
        if in_turn and not is_call(call, "map"):
            continue
        if _steps_shared_data(script, function, loop, work):
            yield Match(call)


def _is_thread_pool(node: ast.AST) -> bool:
    if not is_call(node, "ThreadPoolExecutor", "ThreadPool"):
        return False
    named = (k.value for k in node.keywords if k.arg in ("max_workers", "processes"))
    sizes = [*node.args[:1], *named]
    return not any(isinstance(size, ast.Constant) and size.value == 1 for size in sizes)


def _work(call: ast.Call, executors: set[str]) -> list[ast.expr]:
    """Return the function that a call hands to a thread, and its arguments; nothing for others."""
    owner, _, name = dotted_name(call.func).rpartition(".")
    if owner in executors and name in ("submit", "map"):
        return [*call.args] if name == "submit" else [*call.args[:1]]
    if name != "Thread" or owner not in ("", "threading"):
        return []
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    arguments = given.get("args")
    elements = arguments.elts if isinstance(arguments, ast.Tuple | ast.List) else []
    return [given["target"], *elements] if "target" in given else []


def _steps_shared_data(
    script: SteppingScript, function: ast.FunctionDef, loop: ast.AST | None, work: list[ast.expr]
) -> bool:
    """Return whether a function steps a variable from outside, or the same argument each time."""
    given = dict(zip(parameters_of(function), work[1:], strict=False))
    new = bound_in(loop) if loop is not None else set()
    for node in nodes_inside(function):
        if not is_step(node) or len(node.args) < 2:
            continue
        data = node.args[1]
        owner = script.bindings.owner(data.id, data) if isinstance(data, ast.Name) else None
        argument = given.get(dotted_name(data))
        if owner not in (function, None):
            return True
        if isinstance(argument, ast.Name) and argument.id not in new and script.is_data(argument):
            return True
    return False


@rule(
    "MJB016",
    "this writes into the simulation, through a view that a function returns; copy it",
    is_wrong_result=True,
)
def written_views(script: SteppingScript) -> Iterator[Match]:
    """Yield what writes into a view that a name got from a function of the script.

    A function that returns `data.qpos`, or a slice of it, returns a view: an array that shows the
    memory of the MjData. A caller that writes into it, to scale or clip an observation, writes into
    the simulation, and the next step goes on from there.

        def state(self):
            return self.data.qpos       # write: return self.data.qpos.copy()

        obs = env.state()
        obs -= mean                     # or here: obs = env.state() - mean

    There is no finding where the caller seems to set the state: where `mj_forward` or the like
    follows, in a method called `reset` or `set_...`, or where the function is named after the field
    or as a view.

    Results: the simulation keeps its own state, so all later states differ.
    """
    if not any(isinstance(n, ast.Attribute) and FIELDS.match(n.attr) for n in script.nodes):
        return
    stored = stored_views(script)
    for node in script.nodes:
        if not isinstance(node, ast.expr | ast.stmt):
            continue
        for name in _written(node):
            bindings = script.bindings.of(name.id, name)
            values = [b for b in bindings if not isinstance(script.parents[b], ast.AugAssign)]
            source = stored.source_of_binding(values[0]) if len(values) == 1 else None
            if source is None or _sets_state(script, node):
                continue
            for function, view in stored.returned(source):
                is_field = function.name in attributes_in(view)
                if is_field or _PROMISES_VIEW.search(function.name):
                    continue
                getter = function.name if function.decorator_list else f"{function.name}()"
                message = (
                    f"this writes into {ast.unparse(view)} of the simulation, which {getter}"
                    f" returns: write into a copy, {name.id} = {name.id}.copy()"
                )
                yield Match(node, message=message)


def _written(node: ast.expr | ast.stmt) -> Iterator[ast.Name]:
    written: list[ast.expr] = []
    match node:
        case ast.AugAssign(target=target):
            written = [target]
        case ast.Assign(targets=targets, value=value):
            parts = [target for target in targets if isinstance(target, ast.Subscript)]
            written = [part for part in parts if not _replaces_all(part, value)]
        case ast.Call(func=function, args=arguments, keywords=keywords):
            written = [keyword.value for keyword in keywords if keyword.arg == "out"]
            if isinstance(function, ast.Attribute):
                written += arguments[:1] if function.attr in _FUNCTIONS_THAT_WRITE else []
                written += [function.value] if function.attr in _METHODS_THAT_WRITE else []
    for each in written:
        array = each.value if isinstance(each, ast.Subscript) else each
        if isinstance(array, ast.Name):
            yield array


def _replaces_all(part: ast.Subscript, value: ast.expr) -> bool:
    """Return whether `x[:] = value` replaces all of an array by what does not follow from it."""
    is_whole = isinstance(part.slice, ast.Slice) and not (part.slice.lower or part.slice.upper)
    return is_whole and names_in(part.value).isdisjoint(names_in(value))


def _sets_state(script: SteppingScript, node: ast.expr | ast.stmt) -> bool:
    """Return whether the function around a write, or the rest of it, sets a state on purpose."""
    scope = script.bindings.scope_of(node)
    calls = (n for n in ast.walk(scope) if isinstance(n, ast.Call) and n.lineno > node.lineno)
    names = {last_name(call.func) for call in calls} | {getattr(scope, "name", "")}
    return any(map(_SETS.match, names))
