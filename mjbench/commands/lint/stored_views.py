"""Which views a script stores in its stepping loops, where each will show the last state.

A store counts where it is certain to be a log: what holds it outlives the innermost loop that
steps, every iteration adds an entry, and all entries are the same memory of the one MjData that
steps there. A registry that is filled once, for live reading, and an entry that is replaced in each
step are no logs. Views of inputs, such as `ctrl`, are left out: a program may store them to write
through them. So is what is stored where the script writes through it.

A view may come out of a function of the script:

    def snapshot(data):
        return {"qpos": data.qpos}

    log.append(snapshot(data))

The fault is in the helper: there the view gets its `.copy()`. A helper whose views the script may
write through is left out.
"""

import ast
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from mjbench.commands.lint.rule import Match
from mjbench.commands.lint.script_syntax import (
    FUNCTIONS,
    block_around,
    creates_container,
    dotted_name,
    elements,
    is_bound,
    is_call,
    is_input,
    is_numpy_call,
    is_periodic,
    is_step,
    last_name,
    name_nodes,
    nodes_inside,
    peeled,
)
from mjbench.commands.lint.stepping_script import Loop, SteppingBody, SteppingScript
from mjbench.commands.lint.view_writes import WRITING_FUNCTIONS, WRITING_METHODS, WritesThrough

# Methods of a list or a deque that store an argument.
_STORING_METHODS = {"append", "appendleft", "insert"}
# Names that promise a state of the past, such as `obj_init_pos` and `_last`.
_PAST = re.compile(
    r"(^|_)(init|initial|start|first|home|prev|previous|last|old|before|saved)(_|$)", re.IGNORECASE
)
# What is wrong with a view that a function returns, and the script stores.
_RETURNED = (
    "a view is returned, and the caller stores it: every entry will show the last state;"
    " add .copy()"
)


@dataclass(frozen=True)
class Store:
    """Where something is stored; `key` is None for one more entry, and for an attribute."""

    place: ast.expr
    key: ast.expr | None
    values: list[ast.expr]


@dataclass(frozen=True)
class Source:
    """Where a value comes from: a call of a function of the script.

    Attributes:
      call: the attribute, where the function is a property.
      index: of the part, in a tuple or a dict that the function creates; None for all of it.
    """

    call: ast.expr
    yields: bool = False
    index: object = None


class StoredViews:
    """The views that a script stores."""

    def __init__(self, script: SteppingScript):
        self._script = script
        self._loops = dict.fromkeys((*script.loops, *script.environment_loops))  # in order
        self._counted = {
            dotted_name(node.target) for node in script.nodes if isinstance(node, ast.AugAssign)
        } - {""}
        self._renewed_attributes = {
            node.attr
            for function in script.nodes
            if isinstance(function, FUNCTIONS) and function.name != "__init__"
            for node in ast.walk(function)
            if isinstance(node, ast.Attribute) and is_bound(node)
        }

    @cached_property
    def _writes(self) -> WritesThrough:
        return WritesThrough(self._script.nodes)

    def matches(self) -> Iterator[Match]:
        """Yield the stored views; with a message where it is not that of the rule."""
        for loop in self._loops:
            for node in nodes_inside(loop):
                if self.loop_around(node) is loop:
                    yield from self._stored(node, loop)
        for method in self._script.methods:
            for node in nodes_inside(method):
                if self.loop_around(node) is None:
                    yield from self._stored(node, method)
        for comprehension in self._script.comprehensions:
            yield from self._collected(comprehension)

    def loop_around(self, node: ast.AST) -> Loop | None:
        return next(filter(self._loops.__contains__, self._script.loops_around(node)), None)

    def _stored(self, node: ast.AST, body: SteppingBody) -> Iterator[Match]:
        store = store_of(node)
        if store is None or not self._is_log(store, node, body):
            return
        # what is local to a method ends with it
        if not isinstance(body, Loop) and not dotted_name(store.place).startswith("self."):
            return
        for value in store.values:
            yield from self._entries(value, nodes_inside(body), _renewed(nodes_inside(body)))

    def _collected(self, comprehension: ast.ListComp) -> Iterator[Match]:
        statement = self._script.parents.get(comprehension)
        targets = statement.targets if isinstance(statement, ast.Assign) else ()
        if any(self._writes.through_entries(dotted_name(target)) for target in targets):
            return
        yield from self._entries(comprehension.elt, nodes_inside(comprehension), ())

    def _entries(
        self, value: ast.expr, inner: Sequence[ast.AST], renewed: Collection[str]
    ) -> Iterator[Match]:
        for view in self._views_in(value):
            if self._is_of_the_one_data(view, inner):
                yield Match(view)
        for view in self._of_helpers(value, renewed):
            yield Match(view, message=_RETURNED)

    def _is_log(self, store: Store, node: ast.AST, body: SteppingBody) -> bool:
        """Return whether every iteration of a body adds an entry to what outlives it."""
        if isinstance(node, ast.Assign) and store.key is None:
            attribute = last_name(store.place)
            return bool(_PAST.search(attribute)) and not self._writes.through_attribute(attribute)
        place = dotted_name(peeled(store.place))
        if self._writes.through_entries(place) or place in _bound(nodes_inside(body)):
            return False
        if getattr(body, "name", "") == "__init__":
            return False
        assigned = self._script.assigned(store.place)
        is_unknown = store.key is None and not any(isinstance(v, ast.Call) for v in assigned)
        if not (is_unknown or (assigned and all(map(creates_container, assigned)))):
            return False  # an array, or an object of a class that may copy
        return self.adds(store.key, body) and self._may_repeat(node, place, body)

    def adds(self, key: ast.expr | None, body: SteppingBody) -> bool:
        if key is None:
            return True
        is_method = isinstance(body, FUNCTIONS)
        counts = self._counted | (set() if is_method else _renewed(nodes_inside(body)))
        return any(
            dotted_name(node) in counts
            or (isinstance(node, ast.Attribute) and node.attr == "time")
            or is_call(node, "len")
            for node in ast.walk(key)
        )

    def _may_repeat(self, node: ast.AST, place: str, body: SteppingBody) -> bool:
        while node is not body:
            child, node = node, self._script.parents[node]
            if isinstance(node, ast.If) and child is not node.test:
                parts = list(ast.walk(node.test))
                is_single = any(isinstance(n, ast.Eq | ast.Is) for n in parts)
                is_once = is_single and not is_periodic(node.test)
                if is_once or place in map(dotted_name, parts):
                    return False
            last = block_around(child, node)[-1:] if isinstance(body, Loop) else []
            if any(isinstance(each, ast.Break | ast.Return | ast.Raise) for each in last):
                return False
        return True

    def _views_in(self, value: ast.expr) -> Iterator[ast.expr]:
        """Yield the view that an expression is, or those in the tuple, list or dict it creates."""
        for part in elements(value):
            if self._script.is_view(part) or self._script.is_alias(part):
                yield part

    def _is_of_the_one_data(self, view: ast.expr, inner: Sequence[ast.AST]) -> bool:
        """Return whether a view is the same memory of the MjData that steps, in each iteration."""
        again, varying = _bound(inner), _renewed(inner)
        steps = (node for node in inner if is_step(node) and len(node.args) > 1)
        stepped = {dotted_name(step.args[1]) for step in steps}
        for expression in self._behind(view):
            data = next((n for n in ast.walk(expression) if self._script.is_data(n)), None)
            if data is None or is_input(view) or is_input(expression):
                return False
            # another function may make the name stand for another MjData
            if isinstance(data, ast.Name) and data.id in self._script.bindings.declared:
                return False
            if isinstance(data, ast.Attribute) and data.attr in self._renewed_attributes:
                return False
            if stepped and dotted_name(data) not in stepped:
                return False
            if again.intersection(map(dotted_name, ast.walk(data))):
                return False
            if any(n.id in varying and not self._is_resolved(n) for n in name_nodes(expression)):
                return False
        return True

    def _behind(self, view: ast.expr) -> Iterator[ast.expr]:
        """Yield what a view is an array of: itself, or what was assigned to a name in it."""
        resolved = [n for n in ast.walk(view) if self._is_resolved(n)]
        for name in resolved:
            for value in self._script.assigned(name):
                assert isinstance(value, ast.expr)
                yield from self._behind(value)
        if not resolved:
            yield view

    def _is_resolved(self, node: ast.AST) -> bool:
        """Return whether it is known which view, or which part of an MjData, a name stands for."""
        if not isinstance(node, ast.Name | ast.Attribute) or self._script.is_data(node):
            return False
        return self._script.is_alias(node) or self._script.is_named_part(node)

    def _of_helpers(self, value: ast.expr, renewed: Collection[str]) -> Iterator[ast.expr]:
        """Yield the views in a value that calls return or yield, of what is the same each time."""
        for part in elements(value):
            for source in self._sources(part):
                given = {dotted_name(node) for node in ast.walk(source.call)}
                if given.isdisjoint(renewed):
                    for function, view in self.returned(source):
                        if not any(map(self._writes_into, self._uses(function))):
                            yield view

    def returned(self, source: Source) -> Iterator[tuple[ast.FunctionDef, ast.expr]]:
        """Yield the views that a value is, or holds, each with the function that returns it."""
        for function in self._script.functions.called(source.call):
            for result in self._results(function, source.yields):
                part = result if source.index is None else _part(result, source.index)
                for view in self._views_in(part) if part is not None else ():
                    if not is_input(view) and not self._is_local(view, function):
                        yield function, view

    def _results(self, function: ast.FunctionDef, yields: bool) -> Iterator[ast.expr]:
        inside = nodes_inside(function)
        is_generator = any(isinstance(n, ast.Yield | ast.YieldFrom) for n in inside)
        for node in inside if is_generator is yields else ():
            if isinstance(node, ast.Yield if yields else ast.Return) and node.value is not None:
                yield self._script.resolved(node.value)

    def _sources(self, value: ast.expr) -> list[Source]:
        """Return the calls that a value comes from; none if it may come from elsewhere."""
        match value:
            case ast.Call(args=[inner]) if is_call(value, "list"):
                return [Source(inner, yields=True)] if isinstance(inner, ast.Call) else []
            case ast.Call() | ast.Attribute():
                return [Source(value)]
            case ast.Subscript(value=ast.Call() as call, slice=ast.Constant(value=key)):
                return [Source(call, index=key)] if key is not None else []
            case ast.Name():
                bindings = self._script.bindings.of(value.id, value)
                sources = [*map(self.source_of_binding, bindings)]
                return [each for each in sources if each is not None] if all(sources) else []
        return []

    def source_of_binding(self, binding: ast.AST) -> Source | None:
        """Return where what a name is bound to comes from; None where that is not a plain call."""
        index, target, parent = None, binding, self._script.parents[binding]
        if isinstance(parent, ast.Tuple):
            index = parent.elts.index(binding)  # type: ignore[arg-type]
            target, parent = parent, self._script.parents[parent]
        match parent:
            case ast.Assign(value=value):
                is_known = isinstance(value, ast.Call) or self._script.functions.called(value)
                return Source(value, index=index) if is_known else None
            case ast.For(iter=iterable) | ast.comprehension(iter=iterable) if (
                parent.target is target
            ):
                return _source_of_iteration(iterable, index)
        return None

    def _is_local(self, view: ast.expr, function: ast.FunctionDef) -> bool:
        """Return whether the MjData of a view belongs to one call of a function."""
        bindings = self._script.bindings
        return any(
            bindings.owner(name.id, name) is function
            and not all(isinstance(b, ast.arg) for b in bindings.bindings(name.id, function))
            for name in name_nodes(view)
        )

    def _uses(self, function: ast.FunctionDef) -> Iterator[ast.expr]:
        if function.decorator_list:
            attributes = (node for node in self._script.nodes if isinstance(node, ast.Attribute))
            return (attribute for attribute in attributes if attribute.attr == function.name)
        return (call for call in self._script.calls if is_call(call, function.name))

    def _writes_into(self, use: ast.expr) -> bool:
        """Return whether the script may write through what a call, or a property, returns."""
        parents = self._script.parents
        node: ast.AST = use
        parent = parents[node]
        while isinstance(parent, ast.Subscript | ast.Attribute) and parent.value is node:
            if isinstance(parent, ast.Attribute) and parent.attr in WRITING_METHODS:
                return True
            node, parent = parent, parents[parent]
            if isinstance(parent, ast.Call) and parent.func is node:
                node, parent = parent, parents[parent]
        if is_bound(node):
            return True
        match parent:
            case ast.Call(func=function):
                return last_name(function) in WRITING_FUNCTIONS
            case ast.keyword(arg=name):
                return name == "out"
            case ast.Assign(targets=targets):
                return any(map(self._is_written, targets))
            case ast.For(target=target) | ast.comprehension(target=target):
                return self._is_written(target)
        return False

    def _is_written(self, target: ast.expr) -> bool:
        if isinstance(target, ast.Subscript):  # it holds the value as an entry
            return self._writes.through_entries(dotted_name(peeled(target)))
        return any(self._writes.into(dotted_name(n)) for n in ast.walk(target))


@lru_cache(maxsize=1)
def stored_views(script: SteppingScript) -> StoredViews:
    """Return the views that a script stores; one object for all rules, which run one by one."""
    return StoredViews(script)


def store_of(node: ast.AST) -> Store | None:
    """Return where a statement or a call stores something; None for several places, or none."""
    match node:
        case ast.Call(func=ast.Attribute(value=place, attr=method), args=values):
            is_store = method in _STORING_METHODS and not is_numpy_call(node)
            return Store(place, None, values) if is_store else None
        case ast.Assign(targets=[ast.Attribute() as target], value=value):
            return Store(target, None, [value])
        case ast.Assign(targets=[ast.Subscript(value=place, slice=key)], value=value):
            return None if isinstance(key, ast.Slice) else Store(place, key, [value])
    return None


def _bound(inner: Sequence[ast.AST]) -> set[str]:
    nodes = (n for n in inner if isinstance(n, ast.Name | ast.Attribute) and is_bound(n))
    return {*map(dotted_name, nodes)} - {""}


def _renewed(inner: Sequence[ast.AST]) -> set[str]:
    """Return what nodes bind, without the names of their loops, which repeat their values."""
    loops = (node for node in inner if isinstance(node, ast.For))
    return _bound(inner) - {name.id for loop in loops for name in name_nodes(loop.target)}


def _source_of_iteration(iterable: ast.expr, index: int | None) -> Source | None:
    match iterable:
        case ast.Call(func=ast.Attribute(value=ast.Call() as inner, attr=method)):
            # a key is no view, a value may be
            takes_value = (method, index) in (("items", 1), ("values", None))
            return Source(inner) if takes_value else None
        case ast.Call(args=[inner, *_]) if is_call(iterable, "enumerate") and index == 1:
            return _source_of_iteration(inner, None)
        case ast.Call():
            return Source(iterable, yields=True, index=index)
    return None


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
