"""Halves of a step of a Runge-Kutta model, and one MjData that several threads step."""

import ast
import re
from collections.abc import Iterator

from mjbench.loop.lint_repeats import iterations
from mjbench.loop.lint_rule import Match, rule
from mjbench.loop.script_syntax import (
    bound_in,
    dotted_name,
    is_call,
    is_step,
    last_name,
    nodes_inside,
)
from mjbench.loop.stepping_script import SteppingScript

_RK4_TEXT = re.compile(r"""integrator\s*=\s*["']RK4["']""")


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
                yield Match(call, callee="mj_step2")


def _is_runge_kutta(script: SteppingScript, model: str) -> bool:
    """Return whether all that a script shows of a model's integrator is RK4."""
    integrators = script.assigned_anywhere(f"{model}.opt.integrator")
    if integrators:
        return all("mjINT_RK4" in dotted_name(_without_cast(v)) for v in integrators)
    texts = [_text_of(script, value) for value in script.assigned_anywhere(model)]
    return bool(texts) and all(_RK4_TEXT.search(text) for text in texts)


def _without_cast(node: ast.AST) -> ast.AST:
    """Return what an expression such as `int(x)` or `x.value` is of."""
    return node.args[0] if isinstance(node, ast.Call) and len(node.args) == 1 else node


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
    executors = _executor_names(script) if starts else set()
    for call in starts:
        work = _work(call, executors)
        function = script.functions.named(work[0]) if work else None
        if function is None or _is_locked(function):
            continue
        if not is_call(call, "map") and not _starts_several(script, call):
            continue
        if _steps_outer_data(script, function) or _steps_given_data(script, function, call, work):
            yield Match(call, callee=last_name(call.func))


def _executor_names(script: SteppingScript) -> set[str]:
    """Return the names of pools of several threads."""
    created = list(script.values.items())
    created += [
        (item.optional_vars, item.context_expr)
        for node in script.nodes
        if isinstance(node, ast.With)
        for item in node.items
        if item.optional_vars is not None
    ]
    return {dotted_name(target) for target, value in created if _is_thread_pool(value)} - {""}


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


def _is_locked(function: ast.FunctionDef) -> bool:
    names = {n.attr for n in ast.walk(function) if isinstance(n, ast.Attribute)}
    contexts = [item for n in ast.walk(function) if isinstance(n, ast.With) for item in n.items]
    return bool(contexts) or not names.isdisjoint(("acquire", "wait", "get"))


def _starts_several(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether a loop starts a thread while those that it started before may run."""
    each = next(iterations(script, call), None)
    return each is not None and not any(
        isinstance(n, ast.Attribute) and n.attr in ("join", "result") for n in ast.walk(each.loop)
    )


def _steps_outer_data(script: SteppingScript, function: ast.FunctionDef) -> bool:
    """Return whether a function steps an MjData of the scope around it."""
    return any(
        isinstance(data, ast.Name) and script.bindings.owner(data.id, data) not in (function, None)
        for data in _stepped(function)
    )


def _steps_given_data(
    script: SteppingScript, function: ast.FunctionDef, call: ast.Call, work: list[ast.expr]
) -> bool:
    """Return whether a function steps an argument that is the same in all iterations."""
    parameters = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    given = dict(zip(parameters, work[1:], strict=False))
    innermost = next(iterations(script, call), None)
    new = bound_in(innermost.loop) if innermost is not None else set()
    arguments = (given.get(dotted_name(data)) for data in _stepped(function))
    return any(
        isinstance(argument, ast.Name) and argument.id not in new and script.is_data(argument)
        for argument in arguments
    )


def _stepped(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Yield what a function itself passes to mj_step as MjData."""
    for node in nodes_inside(function):
        if isinstance(node, ast.Call) and is_step(node) and len(node.args) > 1:
            yield node.args[1]
