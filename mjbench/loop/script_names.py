"""Which names of a script stand for an MjData, an MjModel, an environment, a list or a dict."""

import ast
import re
from collections.abc import Iterator

_STEPS = {"mj_step", "mj_step1", "mj_step2"}
# What creates an environment.
_CREATES_ENVIRONMENT = re.compile(r"(make|make_vec|make_env|load|\w*(Env|VectorEnv|Environment))$")
_ENVIRONMENT_PACKAGES = {"gym", "gymnasium", "suite", "metaworld", "robosuite"}
_LOADS_MODEL = re.compile(r"from_(binary_path|xml_path|xml_string)$")
# Functions of Python's module `copy`.
COPIES = {"copy", "deepcopy"}
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
# Inputs of a step, which programs write.
_INPUTS = re.compile(r"(ctrl|qfrc_applied|xfrc_applied|mocap_\w+|userdata|act|eq_active)$")


def last_name(function: ast.AST) -> str:
    """Return the last part of a dotted name: `zeros` of `np.zeros`; empty for anything else."""
    return dotted_name(function).rpartition(".")[2]


def dotted_name(node: ast.AST) -> str:
    """Return a dotted name, such as `self.env.data`; empty for any other expression."""
    attributes: list[str] = []
    while isinstance(node, ast.Attribute):
        attributes.insert(0, node.attr)
        node = node.value
    return ".".join([node.id, *attributes]) if isinstance(node, ast.Name) else ""


def is_step(node: ast.AST) -> bool:
    """Return whether a node calls `mj_step`, or a part of it."""
    return isinstance(node, ast.Call) and last_name(node.func) in _STEPS


def data_names(tree: ast.Module) -> set[str]:
    """Return the dotted names that are an MjData, by assignment or as argument of `mj_step`."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            if last_name(node.value.func) == "MjData":
                names |= {dotted_name(target) for target in node.targets}
        elif isinstance(node, ast.Call) and is_step(node) and len(node.args) > 1:
            names.add(dotted_name(node.args[1]))
    return names - {""}


def model_names(tree: ast.Module) -> set[str]:
    """Return the dotted names that are an MjModel, by assignment or as argument of `mj_step`."""
    names = {
        dotted_name(target)
        for target, value in assignments(tree)
        if isinstance(value, ast.Call) and _LOADS_MODEL.match(last_name(value.func))
    }
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and is_step(node))
    names |= {dotted_name(call.args[0]) for call in calls if call.args}
    return names - {""}


def environment_names(tree: ast.Module) -> set[str]:
    """Return the dotted names that an environment was assigned to."""
    names = set()
    for target, value in assignments(tree):
        if not isinstance(value, ast.Call):
            continue
        package, _, function = dotted_name(value.func).rpartition(".")
        is_of_package = bool(_ENVIRONMENT_PACKAGES.intersection(package.split(".")))
        is_class = function[:1].isupper()
        if _CREATES_ENVIRONMENT.match(function) and (is_class or is_of_package):
            names.add(dotted_name(target))
    return names - {""}


def assignments(tree: ast.Module) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield the target and the value of every assignment, those of tuples one by one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            yield node.target, node.value
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    yield from zip(target.elts, node.value.elts, strict=False)
                else:
                    yield target, node.value


def nodes_inside(node: ast.AST) -> list[ast.expr | ast.stmt]:
    """Return the expressions and statements below a node, without those of functions in it."""
    inside: list[ast.expr | ast.stmt] = []
    waiting = list(ast.iter_child_nodes(node))
    while waiting:
        child = waiting.pop()
        if isinstance(child, FUNCTIONS | ast.Lambda | ast.ClassDef):
            continue
        if isinstance(child, ast.expr | ast.stmt):
            inside.append(child)
        waiting += ast.iter_child_nodes(child)
    return inside


def is_input(view: ast.expr) -> bool:
    """Return whether a view is one of an input of a step, which programs write."""
    attributes = (n.attr for n in ast.walk(view) if isinstance(n, ast.Attribute))
    return any(map(_INPUTS.match, attributes))


def creates_container(node: ast.AST | None) -> bool:
    """Return whether an expression creates a list, a deque or a dict."""
    while isinstance(node, ast.BinOp):  # [None] * n
        node = node.left
    if isinstance(node, ast.Call):
        is_latest = any(ast.unparse(keyword) == "maxlen=1" for keyword in node.keywords)
        return last_name(node.func) in ("list", "dict", "defaultdict", "deque") and not is_latest
    return isinstance(node, ast.List | ast.Dict | ast.ListComp | ast.DictComp)
