"""Which views a script stores in its stepping loops, where each will show the last state.

A store counts where it is certain to be a log: what holds it outlives the innermost loop that
steps, every iteration adds an entry, and all entries are the same memory of the one MjData that
steps there. A registry that is filled once, for live reading, and an entry that is replaced in each
step are no logs. Views of inputs, such as `ctrl`, are left out: a program may store them to write
through them. So is what is stored where the script writes through it.
"""

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from mjbench.loop.lint_helper_views import HelperViews
from mjbench.loop.script_names import (
    FUNCTIONS,
    creates_container,
    dotted_name,
    is_input,
    is_step,
    last_name,
    nodes_inside,
)
from mjbench.loop.stepping_script import SteppingBody, SteppingLoop, SteppingMethod, SteppingScript
from mjbench.loop.view_writes import WritesThrough, peeled

# Methods of a list or a deque that store an argument.
_STORING_METHODS = {"append", "appendleft", "insert"}
# Names that promise a state of the past, such as `obj_init_pos` and `_last`.
_PAST = re.compile(
    r"(^|_)(init|initial|start|first|home|prev|previous|last|old|before|saved)(_|$)", re.IGNORECASE
)


@dataclass(frozen=True)
class Store:
    """Where a statement or a call stores something.

    Attributes:
      place: the list, the dict or the attribute.
      key: under which it is stored in `place`; None for one more entry, and for an attribute.
      values: what is stored.
    """

    place: ast.expr
    key: ast.expr | None
    values: list[ast.expr]


@dataclass(frozen=True)
class StoredView:
    """A view that a script stores.

    Attributes:
      view: the expression.
      is_returned: whether a function of the script gives it to the caller, which stores it.
    """

    view: ast.expr
    is_returned: bool = False


class StoredViews:
    """The views that a script stores."""

    def __init__(self, script: SteppingScript):
        """Look at a script."""
        self._script = script
        self._loops = {loop.node: loop for loop in (*script.loops, *script.environment_loops)}
        self._counted = {
            dotted_name(node.target) for node in script.nodes if isinstance(node, ast.AugAssign)
        } - {""}
        self._renewed_attributes = {
            node.attr
            for function in script.nodes
            if isinstance(function, FUNCTIONS) and function.name != "__init__"
            for node in ast.walk(function)
            if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Load)
        }

    @cached_property
    def _writes(self) -> WritesThrough:
        return WritesThrough(self._script.tree)

    @cached_property
    def helpers(self) -> HelperViews:
        """The views that functions of the script give to their callers."""
        return HelperViews(self._script, self._writes, self._views_in)

    def all(self) -> Iterator[StoredView]:
        """Yield them."""
        for loop in self._loops.values():
            for node in loop.inner:
                if self.loop_around(node) is loop:
                    yield from self._stored(node, loop)
        for method in self._script.methods:
            for node in method.inner:
                if self.loop_around(node) is None and self._script.attribute_of_self(node):
                    yield from self._stored(node, method)
        for comprehension in self._script.comprehensions:
            yield from self._collected(comprehension)

    def loop_around(self, node: ast.AST) -> SteppingLoop | None:
        """Return the innermost loop around a node that steps in any way; None without one."""
        around = (self._loops.get(loop) for loop in self._script.loops_around(node))
        return next((loop for loop in around if loop is not None), None)

    def _stored(self, node: ast.AST, body: SteppingBody) -> Iterator[StoredView]:
        """Yield the views that a node of a loop or a method stores for later, to be read."""
        store = store_of(node)
        if store is None or not self._is_log(store, node, body):
            return
        for value in store.values:
            for view in self._views_in(value):
                if self._is_of_the_one_data(view, body.inner):
                    yield StoredView(view)
            renewed = _bound(body.inner) - _bound_by_inner_loops(body.inner)
            for view in self.helpers.stored(value, renewed):
                yield StoredView(view, is_returned=True)

    def _collected(self, comprehension: ast.ListComp) -> Iterator[StoredView]:
        """Yield the views of which a comprehension that steps makes a list."""
        statement = self._script.parents.get(comprehension)
        names = map(dotted_name, statement.targets) if isinstance(statement, ast.Assign) else ()
        if any(map(self._writes.through_entries, names)):
            return
        inner, element = nodes_inside(comprehension), comprehension.elt
        for view in self.helpers.stored(element, ()):
            yield StoredView(view, is_returned=True)
        for view in element.elts if isinstance(element, ast.Tuple) else [element]:
            if self._script.is_view(view) and self._is_of_the_one_data(view, inner):
                yield StoredView(view)

    def _is_log(self, store: Store, node: ast.AST, body: SteppingBody) -> bool:
        """Return whether every iteration of a body adds an entry to what outlives it."""
        if isinstance(node, ast.Assign) and store.key is None:
            attribute = last_name(store.place)
            return bool(_PAST.search(attribute)) and not self._writes.through_attribute(attribute)
        place = dotted_name(peeled(store.place))
        if self._writes.through_entries(place) or place in _bound(body.inner):
            return False
        if isinstance(body, SteppingMethod) and body.node.name == "__init__":
            return False
        assigned = self._script.assigned(store.place)
        is_unknown = store.key is None and not any(isinstance(v, ast.Call) for v in assigned)
        if not (is_unknown or (assigned and all(map(creates_container, assigned)))):
            return False  # an array, or an object of a class that may copy
        return self.adds(store.key, body) and self._may_repeat(node, place, body)

    def adds(self, key: ast.expr | None, body: SteppingBody) -> bool:
        """Return whether a key is another one in each iteration of a body."""
        if key is None:
            return True
        counts = self._counted
        if isinstance(body, SteppingLoop):
            counts = counts | (_bound(body.inner) - _bound_by_inner_loops(body.inner))
        return any(
            dotted_name(node) in counts
            or (isinstance(node, ast.Attribute) and node.attr == "time")
            or (isinstance(node, ast.Call) and last_name(node.func) == "len")
            for node in ast.walk(key)
        )

    def _may_repeat(self, node: ast.AST, place: str, body: SteppingBody) -> bool:
        """Return whether a body may store at a node more than once.

        It may not where it leaves the loop afterwards, or under `if i == 0` and `if not log`.
        """
        while node is not body.node:
            child, node = node, self._script.parents[node]
            if isinstance(node, ast.If) and child is not node.test:
                parts = list(ast.walk(node.test))
                is_single = any(isinstance(n, ast.Eq | ast.Is) for n in parts)
                is_periodic = any(isinstance(n, ast.Mod) for n in parts)
                if (is_single and not is_periodic) or place in map(dotted_name, parts):
                    return False
            block = next((b for b in _blocks(node) if child in b), None)
            last = block[-1] if block and isinstance(body, SteppingLoop) else None
            if isinstance(last, ast.Break | ast.Return | ast.Raise):
                return False
        return True

    def _views_in(self, node: ast.AST) -> Iterator[ast.expr]:
        """Yield the view that an expression is, or those in the tuple, list or dict it creates."""
        if isinstance(node, ast.expr) and (self._script.is_view(node) or self._is_alias(node)):
            yield node
        elif isinstance(node, ast.Tuple | ast.List):
            for element in node.elts:
                yield from self._views_in(element)
        elif isinstance(node, ast.Dict):
            for value in node.values:
                yield from self._views_in(value)
        elif isinstance(node, ast.Call) and last_name(node.func) == "dict":
            for keyword in node.keywords:
                yield from self._views_in(keyword.value)

    def _is_alias(self, node: ast.expr) -> bool:
        """Return whether nothing but views were assigned to a name."""
        values = self._script.assigned(node) if isinstance(node, ast.Name) else []
        return bool(values) and all(v is not None and self._script.is_view(v) for v in values)

    def _is_of_the_one_data(self, view: ast.expr, inner: Sequence[ast.AST]) -> bool:
        """Return whether a view is the same memory of the MjData that steps, in each iteration."""
        again = _bound(inner)
        stepped = {
            dotted_name(node.args[1])
            for node in inner
            if isinstance(node, ast.Call) and is_step(node) and len(node.args) > 1
        }
        for expression in self._behind(view):
            data = next((n for n in ast.walk(expression) if self._script.is_data(n)), None)
            if is_input(view) or is_input(expression) or data is None or self._is_renewed(data):
                return False
            if stepped and dotted_name(data) not in stepped:
                return False
            if again.intersection(map(dotted_name, ast.walk(data))):
                return False
            varying = again - _bound_by_inner_loops(inner)
            if any(n.id in varying and not self._is_resolved(n) for n in _names(expression)):
                return False
        return True

    def _behind(self, view: ast.expr) -> Iterator[ast.expr]:
        """Yield what a view is an array of: itself, or what was assigned to a name in it."""
        names = [n for n in ast.walk(view) if self._is_resolved(n)]
        for name in names:
            for value in self._script.assigned(name):
                assert isinstance(value, ast.expr)
                yield from self._behind(value)
        if not names:
            yield view

    def _is_resolved(self, node: ast.AST) -> bool:
        """Return whether it is known which view, or which part of an MjData, a name stands for."""
        if not isinstance(node, ast.Name | ast.Attribute) or self._script.is_data(node):
            return False
        is_alias = isinstance(node, ast.Name) and self._is_alias(node)
        return is_alias or self._script.is_named_part(node)

    def _is_renewed(self, node: ast.AST) -> bool:
        """Return whether another function may make a name stand for another MjData."""
        if isinstance(node, ast.Name):
            return node.id in self._script.bindings.declared
        return last_name(node) in self._renewed_attributes


@lru_cache(maxsize=1)
def stored_views(script: SteppingScript) -> StoredViews:
    """Return the views that a script stores; one object for all rules, which run one by one."""
    return StoredViews(script)


def store_of(node: ast.AST) -> Store | None:
    """Return where a statement or a call stores something; None for several places, or none."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        is_of_numpy = dotted_name(node.func.value) in ("np", "numpy", "onp")
        if node.func.attr in _STORING_METHODS and not is_of_numpy:
            return Store(node.func.value, None, node.args)
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        (target,) = node.targets
        if isinstance(target, ast.Attribute):
            return Store(target, None, [node.value])
        if isinstance(target, ast.Subscript) and not isinstance(target.slice, ast.Slice):
            return Store(target.value, target.slice, [node.value])
    return None


def _names(node: ast.AST) -> Iterator[ast.Name]:
    return (n for n in ast.walk(node) if isinstance(n, ast.Name))


def _bound(inner: Sequence[ast.AST]) -> set[str]:
    """Return the names and attributes that some nodes bind."""
    bound = (
        dotted_name(node)
        for node in inner
        if isinstance(node, ast.Name | ast.Attribute) and not isinstance(node.ctx, ast.Load)
    )
    return {*bound} - {""}


def _bound_by_inner_loops(inner: Sequence[ast.AST]) -> set[str]:
    """Return the names that loops inside a body bind, which take the same values each time."""
    loops = (node for node in inner if isinstance(node, ast.For))
    return {name.id for loop in loops for name in _names(loop.target)}


def _blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield the lists of statements below a node."""
    for _, value in ast.iter_fields(node):
        if isinstance(value, list) and value and isinstance(value[0], ast.stmt):
            yield value
