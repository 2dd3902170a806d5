"""Views that a function of the script returns or yields, and that its caller stores.

    def snapshot(data):
        return {"qpos": data.qpos}

    log.append(snapshot(data))

The fault is in the helper: there the view gets its `.copy()`. A helper whose views the script may
write through is left out.
"""

import ast
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

from mjbench.loop.script_names import assignments, dotted_name, is_input, last_name, nodes_inside
from mjbench.loop.stepping_script import SteppingScript
from mjbench.loop.view_writes import WRITING_FUNCTIONS, WRITING_METHODS, WritesThrough, peeled


@dataclass(frozen=True)
class Source:
    """Where a value comes from: a call of a helper, and what of its result the value is.

    Attributes:
      call: the call; the attribute, where the helper is a property.
      yields: whether the value is what the helper yields, not what it returns.
      index: of the part, in a tuple or a dict that the helper creates; None for all of it.
    """

    call: ast.expr
    yields: bool = False
    index: object = None


class HelperViews:
    """The views that functions of a script give to their callers."""

    def __init__(
        self,
        script: SteppingScript,
        writes: WritesThrough,
        views_in: Callable[[ast.expr], Iterator[ast.expr]],
    ):
        """Look at a script.

        Args:
          script: the script.
          writes: where it writes through what it holds.
          views_in: yields the views that an expression is, or holds.
        """
        self._script = script
        self._writes = writes
        self._views_in = views_in

    def stored(self, value: ast.expr, renewed: Collection[str]) -> Iterator[ast.expr]:
        """Yield the views in a value that is stored.

        Args:
          value: what is stored.
          renewed: names that stand for something else in each iteration.
        """
        for part in _parts(value):
            for source in _sources(self._script, part):
                given = {dotted_name(node) for node in ast.walk(source.call)}
                if not given.intersection(renewed):
                    yield from self._of(source)

    def _of(self, source: Source) -> Iterator[ast.expr]:
        """Yield the views that a helper gives to the caller in a value."""
        for function, view in self.given(source):
            if not _is_written(self._script, self._writes, function):
                yield view

    def given(self, source: Source) -> Iterator[tuple[ast.FunctionDef, ast.expr]]:
        """Yield the views that a value is, or holds, each with the helper that returns it."""
        for function in self._script.functions.called(source.call):
            for result in _results(self._script, function, source.yields):
                part = result if source.index is None else _part(result, source.index)
                for view in self._views_in(part) if part is not None else ():
                    if not is_input(view) and not _is_local(self._script, view, function):
                        yield function, view


def _parts(value: ast.expr) -> Iterator[ast.expr]:
    """Yield the values in a tuple, a list or a dict that an expression creates."""
    if isinstance(value, ast.Tuple | ast.List):
        for element in value.elts:
            yield from _parts(element)
    elif isinstance(value, ast.Dict):
        for element in value.values:
            yield from _parts(element)
    else:
        yield value


def _sources(script: SteppingScript, value: ast.AST) -> list[Source]:
    """Return the calls of functions that a value comes from; none if it may come from elsewhere."""
    if isinstance(value, ast.Call):
        if last_name(value.func) == "list" and len(value.args) == 1:
            inner = value.args[0]
            return [Source(inner, yields=True)] if isinstance(inner, ast.Call) else []
        return [Source(value)]
    if isinstance(value, ast.Attribute):
        return [Source(value)]
    if isinstance(value, ast.Subscript) and isinstance(value.value, ast.Call):
        key = value.slice.value if isinstance(value.slice, ast.Constant) else None
        return [Source(value.value, index=key)] if key is not None else []
    if not isinstance(value, ast.Name):
        return []
    owner = script.bindings.owner(value.id, value)
    bindings = script.bindings.bindings(value.id, owner) if owner else ()
    sources = [source_of_binding(script, binding) for binding in bindings]
    known = [source for source in sources if source is not None]
    return known if len(known) == len(sources) else []


def source_of_binding(script: SteppingScript, binding: ast.AST) -> Source | None:
    """Return where what a name is bound to comes from; None where that is not a plain call."""
    parent = script.parents[binding]
    index = None
    target = binding
    if isinstance(parent, ast.Tuple):
        index = parent.elts.index(binding)  # type: ignore[arg-type]
        target, parent = parent, script.parents[parent]
    if isinstance(parent, ast.Assign):
        is_known = isinstance(parent.value, ast.Call) or script.functions.called(parent.value)
        return Source(parent.value, index=index) if is_known else None
    if isinstance(parent, ast.For | ast.comprehension) and parent.target is target:
        return _source_of_iteration(parent.iter, index)
    return None


def _source_of_iteration(iterable: ast.expr, index: int | None) -> Source | None:
    if not isinstance(iterable, ast.Call):
        return None
    method = iterable.func.attr if isinstance(iterable.func, ast.Attribute) else ""
    inner = iterable.func.value if isinstance(iterable.func, ast.Attribute) else None
    if isinstance(inner, ast.Call):  # a key is no view, a value may be
        takes_value = (method, index) in (("items", 1), ("values", None))
        return Source(inner) if takes_value else None
    if last_name(iterable.func) == "enumerate" and index == 1 and iterable.args:
        return _source_of_iteration(iterable.args[0], None)
    return Source(iterable, yields=True, index=index)


def _results(script: SteppingScript, function: ast.FunctionDef, yields: bool) -> Iterator[ast.expr]:
    """Yield what a function returns, or yields."""
    inside = nodes_inside(function)
    is_generator = any(isinstance(n, ast.Yield | ast.YieldFrom) for n in inside)
    kind = ast.Yield if yields else ast.Return
    if is_generator is yields:
        for node in inside:
            if isinstance(node, kind) and node.value is not None:
                yield _assigned(function, node.value)


def _assigned(function: ast.FunctionDef, value: ast.expr) -> ast.expr:
    """Return what a name was assigned, where a function does so once; else the value itself."""
    if isinstance(value, ast.Name):
        module = ast.Module(body=function.body, type_ignores=[])
        values = [v for t, v in assignments(module) if dotted_name(t) == value.id]
        if len(values) == 1 and isinstance(values[0], ast.expr):
            return values[0]
    return value


def _part(result: ast.expr, index: object) -> ast.expr | None:
    """Return the part of a tuple, a list or a dict with an index; None where it is not plain."""
    if isinstance(result, ast.Dict):
        for key, value in zip(result.keys, result.values, strict=True):
            if isinstance(key, ast.Constant) and key.value == index:
                return value
    if isinstance(result, ast.Tuple | ast.List) and isinstance(index, int):
        starred = any(isinstance(element, ast.Starred) for element in result.elts)
        if not starred and -len(result.elts) <= index < len(result.elts):
            return result.elts[index]
    return None


def _is_local(script: SteppingScript, view: ast.expr, function: ast.FunctionDef) -> bool:
    """Return whether the MjData of a view belongs to one call of the helper."""
    names = [n for n in ast.walk(view) if isinstance(n, ast.Name)]
    return any(
        script.bindings.owner(name.id, name) is function
        and not all(isinstance(b, ast.arg) for b in script.bindings.bindings(name.id, function))
        for name in names
    )


def _is_written(script: SteppingScript, writes: WritesThrough, function: ast.FunctionDef) -> bool:
    """Return whether a caller may write through what a helper returns."""
    uses: list[ast.expr] = [call for call in script.calls if last_name(call.func) == function.name]
    if function.decorator_list:  # a property
        attributes = (node for node in script.nodes if isinstance(node, ast.Attribute))
        uses = [attribute for attribute in attributes if attribute.attr == function.name]
    return any(_writes(script, writes, use) for use in uses)


def _writes(script: SteppingScript, writes: WritesThrough, use: ast.expr) -> bool:
    """Return whether the script may write through what a call, or a property, returns."""
    node: ast.AST = use
    parent = script.parents[node]
    while isinstance(parent, ast.Subscript | ast.Attribute) and parent.value is node:
        if isinstance(parent, ast.Attribute) and parent.attr in WRITING_METHODS:
            return True
        node, parent = parent, script.parents[parent]
        if isinstance(parent, ast.Call) and parent.func is node:
            node, parent = parent, script.parents[parent]
    if not isinstance(getattr(node, "ctx", None), ast.Load | None):
        return True
    if isinstance(parent, ast.Call):
        return last_name(parent.func) in WRITING_FUNCTIONS
    if isinstance(parent, ast.keyword):
        return parent.arg == "out"
    targets: list[ast.expr] = []
    if isinstance(parent, ast.Assign):
        targets = parent.targets
    elif isinstance(parent, ast.For | ast.comprehension):
        targets = [parent.target]
    for target in targets:
        if isinstance(target, ast.Subscript):  # it holds the value as an entry
            if writes.through_entries(dotted_name(peeled(target))):
                return True
        elif any(writes.into(dotted_name(n)) for n in ast.walk(target)):
            return True
    return False
