"""Where a script may write through what it stored: into arrays, not over the names that hold them.

Names are followed through assignments, loops, parameters and returned values, wherever they stand:
what may hold a part of something counts as written with it. Too much rather than too little counts.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence

from mjbench.commands.lint.name_bindings import bound_by
from mjbench.commands.lint.script_syntax import (
    FUNCTIONS,
    WHOLE,
    dotted_name,
    is_bound,
    is_input,
    last_name,
    peeled,
)

# Methods of an array that write to it, and functions that write to an argument.
WRITING_METHODS = {"fill", "itemset", "partition", "put", "resize", "setfield", "setflags", "sort"}
WRITING_FUNCTIONS = {
    *("at", "copyto", "fill_diagonal", "partial", "place", "put", "put_along_axis", "putmask"),
    *("setitem", "shuffle"),
}
# Functions that return new memory.
_COPYING = {
    *("array", "concatenate", "copy", "deepcopy", "float", "hstack", "len", "max", "mean", "min"),
    *("norm", "print", "range", "repr", "stack", "std", "str", "sum", "tolist", "vstack"),
}
# State that programs write, beside the inputs of a step.
_STATE = {"qpos", "qvel", "qacc_warmstart"}


class WritesThrough:
    """The names through which a script may write.

    `a[:] = x`, `a += x`, `out=a`, `np.copyto(a, x)` and `a.fill(x)` write into an array; so does
    `rows[0][0] = x`, into an entry of `rows`. `rows[i] = x` alone replaces an entry.
    """

    def __init__(self, nodes: Sequence[ast.AST]):
        indexes = [node for node in nodes if isinstance(node, ast.Subscript) and is_bound(node)]
        indexed = {dotted_name(peeled(node.value)) for node in indexes}  # as by `a[0] = x`
        self._names = {name for node in nodes for name in _written(node)} - {""}
        functions = {node.name: node for node in nodes if isinstance(node, FUNCTIONS)}
        aliases = [pair for node in nodes for pair in _aliases(node, functions)]
        written = indexed | self._names
        while more := {source for target, source in aliases if target in written} - self._names:
            self._names |= more
            written = indexed | self._names
        self._written = written
        self._attributes = {name.rpartition(".")[2] for name in written if "." in name}

    def into(self, name: str) -> bool:
        """Return whether the script may write into what a dotted name holds, or into an entry."""
        return name in self._written

    def through_entries(self, name: str) -> bool:
        return name in self._names

    def through_attribute(self, attribute: str) -> bool:
        """Return whether the script may write into an array that is an attribute so called."""
        return attribute in self._attributes


def _written(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.AugAssign):
        if not isinstance(node.value, ast.List | ast.ListComp):  # `log += [x]`
            yield dotted_name(peeled(node.target))
    elif isinstance(node, ast.Subscript) and is_bound(node):
        is_whole = isinstance(node.value, ast.Attribute) and node.value.attr in WHOLE
        if is_whole or isinstance(node.value, ast.Subscript | ast.Call):
            yield dotted_name(peeled(node.value))
    elif isinstance(node, ast.Call):
        yield from (dotted_name(peeled(k.value)) for k in node.keywords if k.arg == "out")
        function = last_name(node.func)
        if isinstance(node.func, ast.Attribute):
            function = node.func.attr
            if function in WRITING_METHODS:
                yield dotted_name(peeled(node.func.value))
        if function in WRITING_FUNCTIONS or function.startswith("mju_"):
            yield from (name for argument in node.args for name in _held(argument))
        elif dotted_name(node.func).startswith(("np.", "numpy.")) and "save" not in function:
            for argument in node.args[2:]:  # `out`, perhaps
                yield dotted_name(peeled(argument))


def _held(value: ast.AST) -> Iterator[str]:
    """Yield the dotted names of which an expression may be a part, with what they belong to."""
    waiting = [value]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Call) and last_name(node.func) in _COPYING:
            continue
        terms = (node.left, node.right) if isinstance(node, ast.BinOp) else ()
        joins_lists = any(isinstance(term, ast.List | ast.ListComp) for term in terms)
        if isinstance(node, ast.BinOp | ast.Compare | ast.Constant) and not joins_lists:
            continue  # a sum of arrays, say, which is new memory
        if isinstance(node, ast.Name | ast.Attribute):
            yield dotted_name(node)
        waiting += ast.iter_child_nodes(node)


def _aliases(node: ast.AST, functions: Mapping[str, FUNCTIONS]) -> Iterator[tuple[str, str]]:
    targets, values = _binding(node, functions)
    sources = {source for value in values for source in _held(value)} - {""}
    for name in {name for target in targets for name in _stored(target)}:
        yield from ((name, source) for source in sources if source != name)


def _binding(
    node: ast.AST, functions: Mapping[str, FUNCTIONS]
) -> tuple[Sequence[ast.AST], Sequence[ast.AST]]:
    match node:
        case ast.Assign():
            return [t for t in node.targets if not _copies_to_state(t)], [node.value]
        case ast.AnnAssign(value=ast.expr() as value) | ast.NamedExpr(value=value):
            return [node.target], [value]
        case ast.For() | ast.comprehension():
            return [node.target], [node.iter]
        case ast.withitem(optional_vars=ast.expr() as target):
            return [target], [node.context_expr]
        case ast.Match():
            return [case.pattern for case in node.cases], [node.subject]
        case ast.arguments():
            return [node], [value for value in (*node.defaults, *node.kw_defaults) if value]
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            ends = (n for n in ast.walk(node) if isinstance(n, ast.Return | ast.Yield))
            return [ast.Name(node.name, ast.Store())], [end.value for end in ends if end.value]
        case ast.Call():
            values = [*node.args, *(keyword.value for keyword in node.keywords)]
            function = functions.get(last_name(node.func))
            if function is not None:
                return [function.args], values
            # `map(lambda v: …, views)`, `views.update(q=q)` and `setattr(self, "views", views)`
            owners = [a.args for a in node.args if isinstance(a, ast.Lambda)]
            if isinstance(node.func, ast.Attribute):
                return [*owners, ast.Subscript(node.func.value, node, ast.Store())], values
            match values:
                case [owner, ast.Constant(value=str(name)), _] if last_name(node.func) == "setattr":
                    return [ast.Attribute(owner, name, ast.Store())], values
            return owners, values
    return [], []


def _copies_to_state(target: ast.AST) -> bool:
    """Return whether an assignment to a target writes values into an array of MjData."""
    match target:
        case ast.Subscript(value=ast.Attribute(attr=field) as array):
            return field in _STATE or is_input(array)
    return False


def _stored(target: ast.AST) -> Iterator[str]:
    if isinstance(target, ast.Attribute | ast.Subscript):
        yield dotted_name(peeled(target))
        return
    yield from bound_by(target)
    for child in ast.iter_child_nodes(target):
        yield from _stored(child)
