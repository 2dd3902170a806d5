"""What a script creates anew in every iteration of a loop, where one from before it would do."""

import ast
from collections.abc import Iterator

from mjbench.loop.lint_data_uses import DataUses, uses_of, uses_of_parameter
from mjbench.loop.lint_match import Match
from mjbench.loop.lint_repeats import CREATES_MODEL, Iteration, iterations, names_in
from mjbench.loop.script_names import COPIES, assignments, dotted_name, last_name, nodes_inside
from mjbench.loop.stepping_script import STORING_METHODS, SteppingScript

_LOADERS = ("from_xml_path", "from_xml_string", "from_binary_path")
_PHYSICS_LOADERS = ("from_mjcf_model", "from_xml_path", "from_xml_string")
_RENDERERS = {"mujoco.Renderer", "mujoco.renderer.Renderer"}
_RESETS = {"mj_resetData", "mj_resetDataKeyframe", "reset"}


def copied_data(script: SteppingScript) -> Iterator[Match]:
    """Yield each MjData that a loop which steps creates, uses and drops in every iteration."""
    per_episode = {
        node
        for loop in script.episode_loops
        for node in loop.inner
        if script.is_new_data(node, loop)
    }
    for call in script.calls:
        name = last_name(call.func)
        is_copy = name in COPIES and bool(call.args) and script.is_data(call.args[0])
        if not (is_copy or (name == "MjData" and call.args)) or call in per_episode:
            continue
        each = _innermost(script, call)
        if each is None or _has_new_model(script, each, call) or not _is_dropped(script, call):
            continue
        yield Match(call, callee=name)


def compiled_models(script: SteppingScript) -> Iterator[Match]:
    """Yield each model that a loop which steps or resets builds again, from the same parts."""
    specs = _spec_names(script)
    for call in script.calls:
        if _compiles(call, specs) and not _is_stored(script, call):
            each = _innermost(script, call, or_resets=True)
            if each is not None and not (_varies(script, each) or _takes_data(script, each)):
                yield Match(call, callee=last_name(call.func))


def new_renderers(script: SteppingScript) -> Iterator[Match]:
    """Yield each Renderer that a loop which steps creates in every iteration."""
    for call in script.calls:
        if last_name(call.func) != "Renderer" or not _is_engine_renderer(script, call):
            continue
        each = _innermost(script, call)
        if each is None or _has_new_model(script, each, call) or _varies(script, each):
            continue
        if not _is_stored(script, call):
            yield Match(call, callee="Renderer")


def new_jitted_functions(script: SteppingScript) -> Iterator[Match]:
    """Yield each jax.jit of a function that is new in the iteration which calls it."""
    for call in script.calls:
        if _is_jit(script, call.func) and call.args and _is_called(script, call):
            yield from _if_constant(script, call, call.args[0])
    for function in script.nodes:
        if isinstance(function, ast.FunctionDef) and any(
            _is_jit(script, d) or _is_partial_jit(script, d) for d in function.decorator_list
        ):
            around = next(script.loops_around(function), None)
            if around is not None and _calls_name(around, function.name):
                yield from _if_constant(script, function, function)


def new_rollout_pools(script: SteppingScript) -> Iterator[Match]:
    """Yield each call of rollout in a loop that starts threads for itself."""
    for call in script.calls:
        if last_name(call.func) != "rollout" or not _is_module_function(script, call):
            continue
        is_plain = all(k.arg not in (None, "persistent_pool") for k in call.keywords)
        if is_plain and _has_threads(script, call) and any(iterations(script, call)):
            yield Match(call, callee="rollout")


def _innermost(
    script: SteppingScript, node: ast.expr | ast.stmt, or_resets: bool = False
) -> Iteration | None:
    """Return the innermost loop that steps, of those in whose every iteration a node runs."""
    for each in iterations(script, node):
        steps = script.steps_inside(each.loop) or script.steps_environment_inside(each.loop)
        if steps or (or_resets and _resets_inside(each.loop)):
            return each
    return None


def _resets_inside(loop: ast.AST) -> bool:
    return any(isinstance(n, ast.Call) and last_name(n.func) in _RESETS for n in nodes_inside(loop))


def _varies(script: SteppingScript, each: Iteration) -> bool:
    """Return whether what runs depends on what its loop runs over."""
    return not names_in(each.inside).isdisjoint(each.varying_names(script))


def _takes_data(script: SteppingScript, each: Iteration) -> bool:
    """Return whether a function gets an MjData: what it compiles may follow from the state."""
    is_call = bool(each.functions) and isinstance(each.inside, ast.Call)
    return is_call and any(script.is_data(n) for n in ast.walk(each.inside))


def _has_new_model(script: SteppingScript, each: Iteration, call: ast.Call) -> bool:
    """Return whether a call gets a model that is new in each iteration, or that it chooses."""
    creates = any(
        isinstance(n, ast.Call) and last_name(n.func) in CREATES_MODEL for n in ast.walk(call)
    )
    if creates or each.makes_model():
        return True
    model: ast.AST = call.args[0] if call.args else call
    if each.functions and isinstance(each.inside, ast.Call):
        given = script.functions.arguments(each.inside, each.functions[0]) or {}
        is_direct = len(each.functions) == 1 or not isinstance(model, ast.Name)
        model = given.get(dotted_name(model), model) if is_direct else each.inside
    return not names_in(model).isdisjoint(each.varying_names(script))


def _is_dropped(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether nothing keeps a new MjData after its iteration."""
    parent = script.parents[call]
    if isinstance(parent, ast.Assign) and len(parent.targets) == 1:
        target = parent.targets[0]
        return isinstance(target, ast.Name) and _drops(uses_of(script, target, False))
    if isinstance(parent, ast.Call) and call in parent.args:
        given = list(_given(script, parent, call))
        return bool(given) and all(map(_drops, given))
    return False


def _drops(uses: DataUses) -> bool:
    return uses.is_known and not uses.is_kept


def _given(script: SteppingScript, call: ast.Call, argument: ast.expr) -> Iterator[DataUses]:
    """Yield what each function that a call may mean does with an argument."""
    for function in script.functions.called(call):
        given = script.functions.arguments(call, function) or {}
        for parameter, value in given.items():
            if value is argument:
                yield uses_of_parameter(script, function, parameter)


def _is_stored(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether a call's result goes into a list, a dict or the like."""
    parent = script.parents[call]
    if isinstance(parent, ast.Call) and isinstance(parent.func, ast.Attribute):
        return parent.func.attr in STORING_METHODS
    if isinstance(parent, ast.Assign):
        return any(isinstance(target, ast.Subscript) for target in parent.targets)
    return isinstance(parent, ast.Tuple | ast.List | ast.Dict | ast.ListComp | ast.DictComp)


def _is_engine_renderer(script: SteppingScript, call: ast.Call) -> bool:
    name = dotted_name(call.func)
    return not _RENDERERS.isdisjoint((name, script.bindings.origin(name)))


def _is_module_function(script: SteppingScript, call: ast.Call) -> bool:
    return script.bindings.origin(dotted_name(call.func)) == "mujoco.rollout.rollout"


def _spec_names(script: SteppingScript) -> set[str]:
    """Return the names that an MjSpec was assigned to."""
    return {
        dotted_name(target)
        for target, value in assignments(script.tree)
        if isinstance(value, ast.Call) and "MjSpec" in dotted_name(value.func).split(".")
    } - {""}


def _compiles(call: ast.Call, specs: set[str]) -> bool:
    owner, _, name = dotted_name(call.func).rpartition(".")
    kind = owner.rpartition(".")[2]
    return (
        (kind == "MjModel" and name in _LOADERS)
        or (kind == "Physics" and name in _PHYSICS_LOADERS)
        or (name in ("compile", "recompile") and owner in specs)
    )


def _is_jit(script: SteppingScript, function: ast.AST) -> bool:
    name = dotted_name(function)
    return last_name(function) == "jit" and "jax.jit" in (name, script.bindings.origin(name))


def _is_partial_jit(script: SteppingScript, decorator: ast.AST) -> bool:
    """Return whether a decorator is `jax.jit(…)` or `functools.partial(jax.jit, …)`."""
    if not isinstance(decorator, ast.Call):
        return False
    is_partial = last_name(decorator.func) == "partial" and bool(decorator.args)
    return _is_jit(script, decorator.args[0] if is_partial else decorator.func)


def _is_called(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether the function that `jax.jit(…)` returns is called in the same iteration."""
    parent = script.parents[call]
    if isinstance(parent, ast.Call) and parent.func is call:
        return True
    around = next(script.loops_around(call), None)
    if around is None or not isinstance(parent, ast.Assign) or len(parent.targets) > 1:
        return False
    target = parent.targets[0]
    return isinstance(target, ast.Name) and _calls_name(around, target.id)


def _calls_name(loop: ast.AST, name: str) -> bool:
    return any(isinstance(n, ast.Call) and dotted_name(n.func) == name for n in nodes_inside(loop))


def _if_constant(
    script: SteppingScript, node: ast.Call | ast.FunctionDef, function: ast.AST
) -> Iterator[Match]:
    """Yield a node if its function is new in each iteration, and one function would do for all."""
    for each in iterations(script, node):
        if each.functions:
            return
        body = _new_function(function, each)
        if body is None:
            return
        varying = _varying_inside(body, each.varying_names(script))
        if all(_is_number(script, n) for n in ast.walk(body) if _is_one_of(n, varying)):
            yield Match(node, callee="jit")
            return


def _new_function(function: ast.AST, each: Iteration) -> ast.AST | None:
    """Return the function that an expression creates in the iteration; None for one from before."""
    if isinstance(function, ast.Lambda | ast.FunctionDef):
        return function
    if isinstance(function, ast.Call) and last_name(function.func) == "partial":
        return function
    if isinstance(function, ast.Name):
        defined = (n for n in ast.walk(each.loop) if isinstance(n, ast.FunctionDef))
        return next((n for n in defined if n.name == function.id), None)
    return None


def _varying_inside(function: ast.AST, varying: set[str]) -> set[str]:
    """Return the names that vary inside a function: its parameters do if their defaults do."""
    for arguments in (n for n in ast.walk(function) if isinstance(n, ast.arguments)):
        plain = [*arguments.posonlyargs, *arguments.args]
        defaults = dict(zip(reversed(plain), reversed(arguments.defaults), strict=False))
        defaults |= {
            argument: default
            for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
            if default is not None
        }
        for argument in (*plain, *arguments.kwonlyargs):
            default = defaults.get(argument)
            changes = default is not None and not names_in(default).isdisjoint(varying)
            varying = varying | {argument.arg} if changes else varying - {argument.arg}
    return varying


def _is_one_of(node: ast.AST, names: set[str]) -> bool:
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in names


def _is_number(script: SteppingScript, name: ast.AST) -> bool:
    """Return whether a name is an operand of arithmetic, or a default for a parameter.

    Such a value can be an argument.
    """
    return isinstance(script.parents[name], ast.BinOp | ast.UnaryOp | ast.arguments)


def _has_threads(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether rollout gets a list of several MjData, one for each thread."""
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    data = call.args[1] if len(call.args) > 1 else given.get("data")
    if isinstance(data, ast.Name):
        values = [v for t, v in assignments(script.tree) if dotted_name(t) == data.id]
        return bool(values) and all(map(_is_list, values))
    return data is not None and _is_list(data)


def _is_list(node: ast.AST) -> bool:
    if isinstance(node, ast.List):
        return len(node.elts) > 1
    return isinstance(node, ast.ListComp)
