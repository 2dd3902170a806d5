"""Where a script writes through what it stored: into arrays, not over the names that hold them."""

import ast
from collections.abc import Iterator

from mjbench.loop.script_names import assignments, dotted_name

# Methods of an array that write to it, and functions of NumPy that write to their first argument.
WRITING_METHODS = {"fill", "itemset", "partition", "put", "resize", "setfield", "setflags", "sort"}
WRITING_FUNCTIONS = {"copyto", "fill_diagonal", "place", "put", "put_along_axis", "putmask"}


def peeled(node: ast.AST) -> ast.AST:
    """Return what is indexed, or whose methods are called, in an expression: `a` of `a[0][:].T`."""
    while True:
        if isinstance(node, ast.Subscript | ast.Starred):
            node = node.value
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            node = node.func.value
        elif isinstance(node, ast.Attribute) and not dotted_name(node):
            node = node.value
        else:
            return node


class WritesThrough:
    """The names through which a script writes, aliases included.

    A name counts if the script writes into an entry of what it holds, or of an entry of that:
    `a[:] = x`, `rows[0][0] = x`, `a += x`, `out=a`, `np.copyto(a, x)`, `a.fill(x)`. `rows[i] = x`
    alone stores, and does not write through `rows`.
    """

    def __init__(self, tree: ast.Module):
        """Find them."""
        self._names = {name for node in ast.walk(tree) for name in _written(node)}
        aliases = list(_aliases(tree))
        while more := {
            source
            for target, source in aliases
            if target in self._names and source not in self._names
        }:
            self._names |= more

    def through(self, name: str) -> bool:
        """Return whether the script writes through a name, or through an attribute so called."""
        return bool(name) and name in self._names


def _written(node: ast.AST) -> Iterator[str]:
    """Yield the dotted names that a node writes through."""
    if isinstance(node, ast.AugAssign):
        yield dotted_name(peeled(node.target))
    elif isinstance(node, ast.Assign):
        for target in node.targets:
            yield from _written_target(target)
    elif isinstance(node, ast.Call):
        yield from (dotted_name(peeled(k.value)) for k in node.keywords if k.arg == "out")
        if isinstance(node.func, ast.Attribute):
            if node.func.attr in WRITING_METHODS:
                yield dotted_name(peeled(node.func.value))
            if node.func.attr in WRITING_FUNCTIONS and node.args:
                yield dotted_name(peeled(node.args[0]))


def _written_target(target: ast.AST) -> Iterator[str]:
    if isinstance(target, ast.Tuple | ast.List):
        for element in target.elts:
            yield from _written_target(element)
    elif isinstance(target, ast.Subscript):
        base, is_deep = target.value, _is_whole(target.slice)
        is_deep = is_deep or isinstance(base, ast.Subscript | ast.Call)
        # `self.ctrl[0] = x` writes into an array, `rows[0] = x` replaces an entry of a list
        if is_deep or isinstance(base, ast.Attribute):
            yield dotted_name(peeled(base))


def _is_whole(index: ast.AST) -> bool:
    """Return whether an index is a slice, which writes into an array rather than replacing it."""
    parts = index.elts if isinstance(index, ast.Tuple) else [index]
    return any(isinstance(part, ast.Slice) for part in parts)


def _aliases(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield names and what they were taken from, such as `v` and `views` of `v = views[0]`."""
    for target, value in assignments(tree):
        if name := dotted_name(peeled(value)):
            yield dotted_name(target), name
    for node in ast.walk(tree):
        if isinstance(node, ast.For | ast.comprehension):
            names = [n for n in ast.walk(node.target) if isinstance(n, ast.Name)]
            sources = [n for n in ast.walk(node.iter) if isinstance(n, ast.Name | ast.Attribute)]
            for target in names:
                yield from ((target.id, dotted_name(source)) for source in sources)
