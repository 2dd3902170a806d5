"""Parts of the syntax of a script: names, calls, assignments, and what stands inside a node."""

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TypeGuard

FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
# Functions of Python's module `copy`.
COPIES = {"copy", "deepcopy"}
# Inputs of a step, which programs write.
_INPUTS = re.compile(r"(ctrl|qfrc_applied|xfrc_applied|mocap_\w+|userdata|act|eq_active)$")
_NUMPY = {"np", "numpy", "onp"}
# Attributes of an array that are the array itself.
WHOLE = {"T", "flat"}


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


def is_call(node: ast.AST | None, *names: str) -> TypeGuard[ast.Call]:
    """Return whether a node calls something whose dotted name ends in one of some names."""
    return isinstance(node, ast.Call) and last_name(node.func) in names


def is_step(node: ast.AST) -> TypeGuard[ast.Call]:
    return is_call(node, "mj_step", "mj_step1", "mj_step2")


def is_numpy_call(node: ast.Call) -> bool:
    """Return whether a function of NumPy itself is called, such as `np.zeros(…)`."""
    return isinstance(node.func, ast.Attribute) and dotted_name(node.func.value) in _NUMPY


def name_nodes(node: ast.AST) -> Iterator[ast.Name]:
    return (n for n in ast.walk(node) if isinstance(n, ast.Name))


def names_in(node: ast.AST) -> set[str]:
    return {name.id for name in name_nodes(node)}


def is_bound(node: ast.AST) -> bool:
    """Return whether a name, an attribute or an index is assigned to or deleted, not read."""
    return isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)


def bound_in(node: ast.AST) -> set[str]:
    """Return the names to which a node assigns, or that it deletes."""
    return {name.id for name in name_nodes(node) if is_bound(name)}


def is_periodic(condition: ast.AST) -> bool:
    """Return whether a condition is one on a remainder, such as `i % 10 == 0`."""
    return any(isinstance(node, ast.Mod) for node in ast.walk(condition))


def peeled(node: ast.AST) -> ast.AST:
    """Return what is indexed, or whose methods are called, in an expression: `a` of `a[0][:].T`."""
    while True:
        match node:
            case ast.Subscript(value=inner) | ast.Starred(value=inner):
                node = inner
            case ast.Call(func=ast.Attribute(value=inner)):
                node = inner
            case ast.Attribute(value=inner) if not dotted_name(node) or node.attr in WHOLE:
                node = inner
            case _:
                return node


def assignments(tree: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield the target and the value of every assignment and `with`, those of tuples one by one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.withitem) and node.optional_vars is not None:
            yield node.optional_vars, node.context_expr
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield node.target, node.value
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    yield from zip(target.elts, node.value.elts, strict=False)
                else:
                    yield target, node.value


def ancestors(parents: Mapping[ast.AST, ast.AST], node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes above a node, the innermost first."""
    while (above := parents.get(node)) is not None:
        yield above
        node = above


@lru_cache(maxsize=256)
def nodes_inside(node: ast.AST) -> Sequence[ast.expr | ast.stmt]:
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


def parameters_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names of the parameters that a call may fill by position."""
    return [argument.arg for argument in (*function.args.posonlyargs, *function.args.args)]


def attributes_in(node: ast.AST) -> set[str]:
    return {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def block_around(child: ast.AST, parent: ast.AST | None) -> list[ast.stmt]:
    """Return the statements of a node among which a child of it stands; none for other children."""
    blocks = (getattr(parent, name, None) for name in ("body", "orelse", "finalbody"))
    return next((block for block in blocks if isinstance(block, list) and child in block), [])


def elements(value: ast.expr) -> Iterator[ast.expr]:
    """Yield the values in a tuple, a list or a dict that an expression creates, or itself."""
    match value:
        case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Dict(values=parts):
            pass
        case ast.Call(keywords=keywords) if is_call(value, "dict"):
            parts = [keyword.value for keyword in keywords]
        case _:
            yield value
            return
    for part in parts:
        yield from elements(part)


def is_input(view: ast.expr) -> bool:
    """Return whether a view is one of an input of a step, which programs write."""
    return any(map(_INPUTS.match, attributes_in(view)))


def creates_container(node: ast.AST | None) -> bool:
    while isinstance(node, ast.BinOp):  # [None] * n
        node = node.left
    if isinstance(node, ast.Call):
        is_latest = any(ast.unparse(keyword) == "maxlen=1" for keyword in node.keywords)
        return is_call(node, "list", "dict", "defaultdict", "deque") and not is_latest
    return isinstance(node, ast.List | ast.Dict | ast.ListComp | ast.DictComp)
