"""What a script creates anew in every iteration of a loop, where one from before it would do."""

import ast
from collections.abc import Iterator

from mjbench.commands.lint.data_uses import DataUses, uses_of, uses_of_parameter
from mjbench.commands.lint.repeats import Iteration, creates_model, following, iterations
from mjbench.commands.lint.rule import Match, rule
from mjbench.commands.lint.script_syntax import (
    COPIES,
    dotted_name,
    is_bound,
    is_call,
    last_name,
    name_nodes,
    names_in,
    nodes_inside,
    parameters_of,
    peeled,
)
from mjbench.commands.lint.stepping_script import STORING_METHODS, SteppingScript

_LOADERS = {
    "MjModel": ("from_xml_path", "from_xml_string", "from_binary_path"),
    "Physics": ("from_mjcf_model", "from_xml_path", "from_xml_string"),
}
_RESETS = ("mj_resetData", "mj_resetDataKeyframe", "reset")
_DEVICES = {"mujoco.mjx", "mujoco_warp"}
_DEVICE_STEPS = {f"{module}.step" for module in _DEVICES}
_RENDERERS = {"mujoco.Renderer", "mujoco.renderer.Renderer"}


@rule("MJB005", "a new MjData for every episode; create one and call mj_resetData")
def new_data_per_episode(script: SteppingScript) -> Iterator[Match]:
    """Yield each new MjData of an episode, but not one of a model that is new as well.

    `MjData(model)` allocates all memory of a simulation. `mj_resetData` sets the same values in the
    memory that is there.

        for episode in range(100):
            data = mujoco.MjData(model)

        data = mujoco.MjData(model)                       # instead
        for episode in range(100):
            mujoco.mj_resetData(model, data)

    Results: none change, unless the program keeps the MjData of earlier episodes, or their views.
    """
    yield from map(Match, _new_data_per_episode(script))


def _new_data_per_episode(script: SteppingScript) -> Iterator[ast.expr | ast.stmt]:
    for loop in script.episode_loops:
        assignments = (n for n in nodes_inside(loop) if isinstance(n, ast.Assign))
        assigned = {dotted_name(target) for n in assignments for target in n.targets}
        for node in nodes_inside(loop):
            if is_call(node, "MjData") and node.args and dotted_name(node.args[0]) not in assigned:
                yield node


@rule(
    "MJB010",
    "a new MjData in every iteration; create one before the loop, and set it by mj_copyData,"
    " mj_setState or mj_resetData",
)
def copied_data(script: SteppingScript) -> Iterator[Match]:
    """Yield each MjData that a loop which steps creates, uses and drops in every iteration.

    `copy.copy(data)`, `copy.deepcopy(data)` and `MjData(model)` allocate all memory of a
    simulation. One MjData from before the loop takes the state instead: `mj_copyData`, in Python
    from MuJoCo 3.5 on, copies everything; `mj_setState` with `mjSTATE_INTEGRATION` the state, the
    inputs and the warm start, from which a step computes the rest.

        for plan in plans:
            cost = follow(copy.deepcopy(data), plan)

        scratch = mujoco.MjData(model)                    # instead
        for plan in plans:
            mujoco.mj_copyData(scratch, model, data)
            cost = follow(scratch, plan)

    There is no finding where the program keeps the copies.

    Results: none change.
    """
    per_episode = set(_new_data_per_episode(script))
    for call in script.calls:
        if not call.args or call in per_episode:
            continue
        is_copy = is_call(call, *COPIES) and script.is_data(call.args[0])
        each = _innermost(script, call) if is_copy or is_call(call, "MjData") else None
        if each and not _has_new_model(script, each, call) and _is_dropped(script, call):
            yield Match(call)


@rule(
    "MJB011",
    "a model is compiled in every iteration; compile it once, and change the values of the"
    " compiled model",
)
def compiled_models(script: SteppingScript) -> Iterator[Match]:
    """Yield each model that a loop which steps or resets builds again, from the same parts.

    Loading XML, `MjSpec.compile` and PyMJCF's `Physics.from_mjcf_model` parse and compile the whole
    model, which takes as long as many steps.

        for episode in range(100):
            model = mujoco.MjModel.from_xml_string(scene())

        model = mujoco.MjModel.from_xml_string(scene())   # instead
        for episode in range(100):
            model.geom_friction[:, 0] = rng.uniform(0.5, 1)

    Masses, sizes, friction, colours and positions can be changed in the compiled model;
    `mj_setConst` recomputes what follows from masses and `qpos0`. If the number of bodies varies,
    compile all of them, and move those that are not used away.

    Results: depend on what is changed; bodies that are moved away still cost time in each step.
    """
    specs = {
        dotted_name(target)
        for target, value in script.values.items()
        if isinstance(value, ast.Call) and "MjSpec" in dotted_name(value.func).split(".")
    } - {""}
    for call in script.calls:
        if _compiles(call, specs) and not _is_stored(script, call):
            each = _innermost(script, call, or_resets=True)
            if each is None or _varies(script, each, each.inside):
                continue
            # what a function compiles that gets an MjData may follow from the state
            if not each.functions or not any(map(script.is_data, ast.walk(each.inside))):
                yield Match(call)


@rule("MJB012", "a new Renderer in every iteration; create one before the loop, and close it after")
def new_renderers(script: SteppingScript) -> Iterator[Match]:
    """Yield each Renderer that a loop which steps creates in every iteration.

    Each Renderer creates an OpenGL context and uploads all meshes and textures of the model. One
    that is never closed keeps them.

        for step in range(1000):
            mujoco.mj_step(model, data)
            renderer = mujoco.Renderer(model)

        with mujoco.Renderer(model) as renderer:          # instead
            for step in range(1000):
                mujoco.mj_step(model, data)
                renderer.update_scene(data)

    Results: none change; `update_scene` sets the whole scene.
    """
    for call in script.calls:
        name = dotted_name(call.func)
        if _RENDERERS.isdisjoint((name, script.bindings.origin(name))) or _is_stored(script, call):
            continue
        each = _innermost(script, call)
        if (
            each
            and not _has_new_model(script, each, call)
            and not _varies(script, each, each.inside)
        ):
            yield Match(call)


@rule(
    "MJB013",
    "jax.jit of a function that is new in every iteration traces and compiles each time; jit"
    " one function before the loop, and pass it what varies",
)
def new_jitted_functions(script: SteppingScript) -> Iterator[Match]:
    """Yield each jax.jit of a function that is new in the iteration which calls it.

    `jax.jit` keeps what it compiled for each function object. A lambda, a local function or a
    `functools.partial` that an iteration creates is a new object, so JAX traces and compiles it
    again. With `mjx.step`, that takes seconds to minutes.

        for gain in gains:
            move = jax.jit(lambda d: mjx.step(mx, d.replace(ctrl=-gain * d.qpos)))
            data = move(data)

        @jax.jit                                          # instead
        def move(d, gain):
            return mjx.step(mx, d.replace(ctrl=-gain * d.qpos))

        for gain in gains:
            data = move(data, gain)

    The same holds in a function that the loop calls, such as one that resets.

    Results: up to rounding the same; as an argument, `gain` is no constant of the compiled program.
    """
    for call in script.calls:
        if _is_jit(script, call.func) and call.args and _is_called(script, call):
            yield from _if_constant(script, call, call.args[0])
    for function in (node for node in script.nodes if isinstance(node, ast.FunctionDef)):
        decorators = function.decorator_list
        is_jitted = any(_is_jit(script, d) or _is_partial_jit(script, d) for d in decorators)
        if is_jitted and _calls_name(_repeated_around(script, function), function.name):
            yield from _if_constant(script, function, function)


@rule(
    "MJB022",
    "a model or an MjData goes to the device anew in every iteration; put it there once, before the"
    " loop, and replace in it what differs",
)
def new_device_copies(script: SteppingScript) -> Iterator[Match]:
    """Yield put_model and put_data of MJX or MuJoCo Warp in a loop that steps on the device.

    `mjx.put_model` and `mjx.put_data` convert every field, which takes as long as many steps. The
    next step needs only the state.

        for episode in range(100):
            mujoco.mj_resetData(model, data)
            data.qpos[0] = starts[episode]
            mx, dx = mjx.put_model(model), mjx.put_data(model, data)

        mx, first = mjx.put_model(model), mjx.put_data(model, data)           # instead
        for episode in range(100):
            dx = first.replace(qpos=first.qpos.at[0].set(starts[episode]))

    In MuJoCo Warp, `mujoco_warp.reset_data` resets in place, and arrays such as `d.qpos` are
    assigned.

    There is no finding where the model is another one or is changed in the loop.

    Results: none change, but what follows from the state, such as `xpos`, is that of before until a
    step or `mjx.forward` computes it.
    """
    steps = _device_step_names(script)
    for call in script.calls:
        module, _, function = script.bindings.origin(dotted_name(call.func)).rpartition(".")
        if module not in _DEVICES or function not in ("put_model", "put_data") or not call.args:
            continue
        for each in iterations(script, call):
            is_same = not (
                _has_new_model(script, each, call)
                or _varies(script, each, *call.keywords)
                or (function == "put_model" and _changes_model(script, each, call.args[0]))
            )
            if is_same and any(_calls_name(each.loop, name) for name in steps):
                yield Match(call, loop=each.calling_loop)
                break


def _device_step_names(script: SteppingScript) -> set[str]:
    """Return the names of functions that step on a device, such as `jax.jit(mjx.step)`."""

    def steps(node: ast.AST) -> bool:
        origins = (script.bindings.origin(dotted_name(n)) for n in ast.walk(node))
        return any(each in _DEVICE_STEPS for each in origins)

    functions = (n for n in script.nodes if isinstance(n, ast.FunctionDef))
    named = {dotted_name(target) for target, value in script.values.items() if steps(value)}
    direct = {dotted_name(call.func) for call in script.calls if steps(call.func)}
    return (named | direct | {each.name for each in functions if steps(each)}) - {""}


def _varies(script: SteppingScript, each: Iteration, *nodes: ast.AST) -> bool:
    varying = each.varying_names(script)
    return any(not names_in(node).isdisjoint(varying) for node in nodes)


def _changes_model(script: SteppingScript, each: Iteration, model: ast.AST) -> bool:
    """Return whether an iteration may assign to a model, or hand it to code that may."""
    names = {dotted_name(model), *script.model_names}
    beginnings = tuple(f"{name}." for name in names - {""})
    for node in (node for body in (each.loop, *each.functions) for node in nodes_inside(body)):
        if is_bound(node) and f"{dotted_name(peeled(node))}.".startswith(beginnings):
            return True
        if isinstance(node, ast.Call) and any(dotted_name(a) in names for a in node.args):
            origin = script.bindings.origin(dotted_name(node.func))
            if not (origin.startswith(("mujoco", "jax")) or script.functions.called(node)):
                return True
    return False


@rule(
    "MJB014",
    "rollout starts its threads anew in every iteration; keep a rollout.Rollout(nthread=…)"
    " open, or pass persistent_pool=True",
)
def new_rollout_pools(script: SteppingScript) -> Iterator[Match]:
    """Yield each call of rollout in a loop that starts threads for itself.

    `rollout.rollout` with several MjData starts threads, and stops them when it is done. An object
    keeps them between calls.

        for _ in range(100):
            states, sensors = rollout.rollout(model, datas, starts, plans)

        with rollout.Rollout(nthread=len(datas)) as pool: # instead
            for _ in range(100):
                states, sensors = pool.rollout(model, datas, starts, plans)

    `persistent_pool=True` does the same with one pool for the program.

    Results: none change.
    """
    for call in script.calls:
        if script.bindings.origin(dotted_name(call.func)) != "mujoco.rollout.rollout":
            continue
        is_plain = all(k.arg not in (None, "persistent_pool") for k in call.keywords)
        if is_plain and _has_threads(script, call) and any(iterations(script, call)):
            yield Match(call)


def _innermost(
    script: SteppingScript, node: ast.expr | ast.stmt, or_resets: bool = False
) -> Iteration | None:
    """Return the innermost loop that steps, of those in whose every iteration a node runs."""
    for each in iterations(script, node):
        resets = or_resets and any(is_call(n, *_RESETS) for n in nodes_inside(each.loop))
        if resets or script.steps_either_inside(each.loop):
            return each
    return None


def _has_new_model(script: SteppingScript, each: Iteration, call: ast.Call) -> bool:
    if creates_model(call) or each.makes_model():
        return True
    model: ast.AST = call.args[0] if call.args else call
    if each.functions and isinstance(each.inside, ast.Call):
        given = script.functions.arguments(each.inside, each.functions[0]) or {}
        is_direct = len(each.functions) == 1 or not isinstance(model, ast.Name)
        model = given.get(dotted_name(model), model) if is_direct else each.inside
    return _varies(script, each, model)


def _is_dropped(script: SteppingScript, call: ast.Call) -> bool:
    match script.parents[call]:
        case ast.Assign(targets=[ast.Name() as target]):
            return _drops(uses_of(script, target, with_callers=False))
        case ast.Call() as parent if call in parent.args:
            given = [
                uses_of_parameter(script, function, parameter)
                for function, parameters in script.functions.receiving(parent, call)
                for parameter in parameters
            ]
            return bool(given) and all(map(_drops, given))
    return False


def _drops(uses: DataUses | None) -> bool:
    return uses is not None and not uses.outlives


def _is_stored(script: SteppingScript, call: ast.Call) -> bool:
    match script.parents[call]:
        case ast.Call(func=ast.Attribute(attr=method)):
            return method in STORING_METHODS
        case ast.Assign(targets=targets):
            return any(isinstance(target, ast.Subscript) for target in targets)
        case ast.Tuple() | ast.List() | ast.Dict() | ast.ListComp() | ast.DictComp():
            return True
    return False


def _compiles(call: ast.Call, specs: set[str]) -> bool:
    owner, _, name = dotted_name(call.func).rpartition(".")
    kind = owner.rpartition(".")[2]
    return name in _LOADERS.get(kind, ()) or (name in ("compile", "recompile") and owner in specs)


def _is_jit(script: SteppingScript, function: ast.AST) -> bool:
    name = dotted_name(function)
    return last_name(function) == "jit" and "jax.jit" in (name, script.bindings.origin(name))


def _is_partial_jit(script: SteppingScript, decorator: ast.AST) -> bool:
    if is_call(decorator, "partial") and decorator.args:
        return _is_jit(script, decorator.args[0])
    return isinstance(decorator, ast.Call) and _is_jit(script, decorator.func)


def _is_called(script: SteppingScript, call: ast.Call) -> bool:
    """Return whether the function that `jax.jit(…)` returns is called in the same iteration."""
    match script.parents[call]:
        case ast.Call(func=function):
            return function is call
        case ast.Assign(targets=[ast.Name(id=name)]):
            return _calls_name(_repeated_around(script, call), name)
    return False


def _repeated_around(script: SteppingScript, node: ast.AST) -> ast.AST:
    """Return the loop around a node, or the function, which a loop may call."""
    return next(script.loops_around(node), None) or script.bindings.scope_of(node)


def _calls_name(body: ast.AST, name: str) -> bool:
    return any(isinstance(n, ast.Call) and dotted_name(n.func) == name for n in nodes_inside(body))


def _if_constant(
    script: SteppingScript, node: ast.Call | ast.FunctionDef, function: ast.AST
) -> Iterator[Match]:
    """Yield a node if its function is new in each iteration, and one function would do for all."""
    for each in iterations(script, node):
        caller = each.functions[-1] if each.functions else None
        body = _new_function(function, caller or each.loop)
        if body is None:
            return
        given = set(parameters_of(caller)) if caller else set()
        varies = following(script, caller, given) if caller else each.varying_names(script)
        varying = _varying_inside(body, varies)
        read = (n for n in name_nodes(body) if isinstance(n.ctx, ast.Load) and n.id in varying)
        # an operand of arithmetic, or a default, can be an argument
        operands = ast.BinOp | ast.UnaryOp | ast.arguments
        if all(isinstance(script.parents[name], operands) for name in read):
            yield Match(node, loop=each.calling_loop)
            return


def _new_function(function: ast.AST, scope: ast.AST) -> ast.AST | None:
    """Return the function that an expression creates in the iteration; None for one from before."""
    if isinstance(function, ast.Lambda | ast.FunctionDef) or is_call(function, "partial"):
        return function
    if isinstance(function, ast.Name):
        defined = (n for n in ast.walk(scope) if isinstance(n, ast.FunctionDef))
        return next((n for n in defined if n.name == function.id), None)
    return None


def _varying_inside(function: ast.AST, varying: set[str]) -> set[str]:
    """Return the names that vary inside a function: its parameters do if their defaults do."""
    for arguments in (n for n in ast.walk(function) if isinstance(n, ast.arguments)):
        plain = [*arguments.posonlyargs, *arguments.args]
        missing = [None] * (len(plain) - len(arguments.defaults))
        defaults = [*missing, *arguments.defaults, *arguments.kw_defaults]
        for argument, default in zip([*plain, *arguments.kwonlyargs], defaults, strict=True):
            changes = default is not None and not names_in(default).isdisjoint(varying)
            varying = varying | {argument.arg} if changes else varying - {argument.arg}
    return varying


def _has_threads(script: SteppingScript, call: ast.Call) -> bool:
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    data = call.args[1] if len(call.args) > 1 else given.get("data")
    if isinstance(data, ast.Name):
        values = script.assigned_anywhere(data.id)
        return bool(values) and all(map(_is_list, values))
    return data is not None and _is_list(data)


def _is_list(node: ast.AST) -> bool:
    if isinstance(node, ast.List):
        return len(node.elts) > 1
    return isinstance(node, ast.ListComp)
