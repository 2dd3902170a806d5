"""Halves of a step of a Runge-Kutta model, and one MjData that several threads step."""

import ast
import re
from collections.abc import Iterator

from mjbench.loop.lint_match import Match
from mjbench.loop.lint_repeats import iterations
from mjbench.loop.script_names import assignments, dotted_name, is_step, last_name, nodes_inside
from mjbench.loop.stepping_script import SteppingScript

_RK4_TEXT = re.compile(r"""integrator\s*=\s*["']RK4["']""")
_LOADS_TEXT = "from_xml_string"


def halves_of_runge_kutta(script: SteppingScript) -> Iterator[Match]:
    """Yield calls of mj_step2 with a model that the script itself gives the RK4 integrator."""
    for call in script.calls:
        if last_name(call.func) == "mj_step2" and call.args:
            model = dotted_name(call.args[0])
            if model and _is_runge_kutta(script, model):
                yield Match(call, callee="mj_step2")


def _is_runge_kutta(script: SteppingScript, model: str) -> bool:
    """Return whether all that a script shows of a model's integrator is RK4."""
    values = list(assignments(script.tree))
    integrators = [v for t, v in values if dotted_name(t) == f"{model}.opt.integrator"]
    if integrators:
        return all("mjINT_RK4" in dotted_name(_without_cast(v)) for v in integrators)
    models = [v for t, v in values if dotted_name(t) == model]
    texts = [_text_of(values, value) for value in models]
    return bool(texts) and all(_RK4_TEXT.search(text) for text in texts)


def _without_cast(node: ast.AST) -> ast.AST:
    """Return what an expression such as `int(x)` or `x.value` is of."""
    return node.args[0] if isinstance(node, ast.Call) and len(node.args) == 1 else node


def _text_of(values: list[tuple[ast.AST, ast.AST]], model: ast.AST) -> str:
    """Return the XML that a model is loaded from, where the script holds it; else nothing."""
    if not (isinstance(model, ast.Call) and last_name(model.func) == _LOADS_TEXT and model.args):
        return ""
    text = model.args[0]
    if isinstance(text, ast.Name):
        texts = [value for target, value in values if dotted_name(target) == text.id]
        text = texts[0] if len(texts) == 1 and isinstance(texts[0], ast.expr) else text
    parts = ast.walk(text)
    return "".join(
        part.value
        for part in parts
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    )


def shared_data(script: SteppingScript) -> Iterator[Match]:
    """Yield where a loop hands one MjData to several threads, each of which steps it."""
    starts = [c for c in script.calls if last_name(c.func) in ("Thread", "submit", "map")]
    executors = _executor_names(script) if starts else set()
    for call in starts:
        work = _work(call, executors)
        function = script.functions.named(work[0]) if work else None
        if function is None or _is_locked(function):
            continue
        is_map = last_name(call.func) == "map"
        if not is_map and not _starts_several(script, call):
            continue
        if _steps_outer_data(script, function) or _steps_given_data(script, function, call, work):
            yield Match(call, callee=last_name(call.func))


def _executor_names(script: SteppingScript) -> set[str]:
    """Return the names of pools of several threads."""
    made = [(t, v) for t, v in assignments(script.tree)]
    made += [
        (item.optional_vars, item.context_expr)
        for node in script.nodes
        if isinstance(node, ast.With)
        for item in node.items
        if item.optional_vars is not None
    ]
    return {dotted_name(target) for target, value in made if _is_thread_pool(value)} - {""}


def _is_thread_pool(node: ast.AST) -> bool:
    if not (
        isinstance(node, ast.Call) and last_name(node.func) in ("ThreadPoolExecutor", "ThreadPool")
    ):
        return False
    sizes = [
        *node.args[:1],
        *(k.value for k in node.keywords if k.arg in ("max_workers", "processes")),
    ]
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
    loops = [each.loop for each in iterations(script, call)]
    new = {
        n.id
        for loop in loops[:1]
        for n in ast.walk(loop)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
    for data in _stepped(function):
        argument = given.get(dotted_name(data))
        if isinstance(argument, ast.Name) and argument.id not in new and script.is_data(argument):
            return True
    return False


def _stepped(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Yield what a function itself passes to mj_step as MjData."""
    for node in nodes_inside(function):
        if isinstance(node, ast.Call) and is_step(node) and len(node.args) > 1:
            yield node.args[1]
