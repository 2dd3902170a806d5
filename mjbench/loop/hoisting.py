"""Which named accesses can be bound to a name before their loop, and why others cannot.

`data.joint("hip")` returns the same object whenever it is called: MuJoCo keeps one for each element
of an MjData or an MjModel, whose arrays are views (true of every release that was tried, from 2.3.7
to 4.0.0). `mj_name2id` depends on nothing but the model's names. So a call in a loop may become one
call before it, if

- the MjData or the MjModel is certainly one: a plain name to which the script assigns nothing else,
  or which the loop passes to `mj_step`;
- that name, and the arguments, stay what they are in the whole loop;
- no iteration passes it by, under an `if` or after a `continue`, a `break` or a `return`: a wrong
  name then raises before the loop instead of in its first iteration. A loop is taken for one that
  runs at least once.
"""

import ast
import builtins
import keyword
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from mjbench.loop.certain_names import DATA, MODEL, CertainNames, Loop
from mjbench.loop.lint_rules import NAMED_ACCESS
from mjbench.loop.python_source import Program
from mjbench.loop.script_syntax import COMPREHENSIONS, dotted_name, last_name
from mjbench.loop.stepping_script import SteppingScript

_NAME_TO_ID, _ELEMENT_TYPES = "mujoco.mj_name2id", "mujoco.mjtObj."


@dataclass(frozen=True)
class Hoist:
    """Accesses that become one name.

    Attributes:
      name: that is bound before the loop.
      loop: before which it is bound.
      calls: that are replaced by the name; all have the same syntax.
    """

    name: str
    loop: Loop
    calls: Sequence[ast.Call]


@dataclass(frozen=True)
class Refusal:
    """A finding whose remedy is not certain to be safe.

    Attributes:
      code: of its rule.
      node: where it points.
      reason: why it is left as it is, in one sentence without its full stop.
    """

    code: str
    node: ast.expr | ast.stmt
    reason: str


@dataclass(frozen=True)
class HoistPlan:
    """What can be hoisted, in the order of the script, and what cannot."""

    hoists: Sequence[Hoist]
    refusals: Sequence[Refusal]


@dataclass
class _Group:
    """Calls with the same syntax in one loop."""

    loop: Loop
    calls: list[ast.Call] = field(default_factory=list)


class Hoisting:
    """What is known of a script for hoisting."""

    def __init__(self, program: Program, script: SteppingScript, names: CertainNames):
        """Look at a script.

        Args:
          program: the script.
          script: what follows from its syntax.
          names: what is known of its names.
        """
        self._script = script
        self._names = names
        self._bindings = names.bindings
        self._lines = [line.text for line in program.lines]
        # a new name is none of these; where strings may hold code, nothing that the script contains
        texts = self._lines if self._bindings.reaches_names else names.commands
        tokens = {token for text in texts for token in re.findall(r"\w+", text)}
        self._taken = {*tokens, *self._bindings.identifiers, *dir(builtins), *keyword.kwlist}

    def plan(self, calls: Sequence[ast.Call]) -> HoistPlan:
        """Return which of some named accesses can be hoisted, each out of which loop.

        Args:
          calls: accesses in loops that step, such as `data.joint("hip")`, in the script's order.
        """
        refusals = []
        groups: dict[str, list[_Group]] = {}
        waiting = []
        for call in calls:
            loop = self._script.step_loop_around(call)
            reason = self._refusal(call, loop)
            if loop is None or reason:
                refusals.append(Refusal(NAMED_ACCESS, call, reason))
            elif self._always_runs(call, loop):
                _group_for(groups, call, self._widest_loop(call, loop)).calls.append(call)
            else:
                waiting.append(call)
        for call in waiting:  # the name is bound already, if another call needs it
            group = self._outermost_around(groups.get(ast.dump(call), ()), call)
            if group is None:
                reason = "not every step reaches it, and a wrong name would raise"
                refusals.append(Refusal(NAMED_ACCESS, call, reason))
            else:
                group.calls.append(call)
        return HoistPlan(list(self._hoists(self._merged(groups))), refusals)

    def _hoists(self, groups: Mapping[str, Sequence[_Group]]) -> Iterator[Hoist]:
        for same in groups.values():
            name = self._new_name(same[0].calls[0], same[0].loop)
            for group in same:
                yield Hoist(name, group.loop, group.calls)

    def _merged(self, groups: Mapping[str, Sequence[_Group]]) -> Mapping[str, Sequence[_Group]]:
        """Return the groups without those in the loop of another one, which has their calls."""
        for same in groups.values():
            for group in same:
                outer = self._outermost_around(same, group.loop)
                if outer is not None:
                    outer.calls += group.calls
                    group.calls.clear()
        nonempty = {key: [g for g in same if g.calls] for key, same in groups.items()}
        return {key: same for key, same in nonempty.items() if same}

    def _outermost_around(self, groups: Sequence[_Group], node: ast.AST) -> _Group | None:
        """Return the group whose loop is the outermost around a node, in the node's scope."""
        group_of = {group.loop: group for group in groups}
        scope = self._bindings.scope_of(node)
        around = [group_of[n] for n in self._script.above(node, scope) if n in group_of]
        return around[-1] if around else None

    def _refusal(self, call: ast.Call, loop: Loop | None) -> str:
        """Return why a call cannot be hoisted out of a loop; empty if it can."""
        if loop is None:
            return "it is in a function that the loop calls"
        lines = self._lines[call.lineno - 1 : call.end_lineno]
        if len(lines) > 1 and any("#" in line for line in lines[:-1]):
            return "a comment stands in it"
        for above in self._script.above(call, loop):
            if isinstance(above, ast.JoinedStr):
                return "it is in an f-string"
            if isinstance(above, COMPREHENSIONS):
                return "it is in a comprehension"
        return self._variation(call, loop)

    def _variation(self, call: ast.Call, loop: Loop) -> str:
        """Return why a call may return something else in another iteration of a loop."""
        scope = self._bindings.scope_of(loop)
        if isinstance(scope, ast.ClassDef):
            return "a name bound in the body of a class becomes its attribute"
        if call.keywords or any(isinstance(argument, ast.Starred) for argument in call.args):
            return "its arguments are not plain"
        if last_name(call.func) == "mj_name2id":
            return self._variation_of_id(call, loop)
        assert isinstance(call.func, ast.Attribute)  # the rule matches nothing else
        owner = call.func.value
        if not isinstance(owner, ast.Name):
            shown = ast.unparse(owner)
            return f"{shown} may be another object in the next step; bind it to a name first"
        if len(call.args) != 1:
            return "its arguments are not plain"
        if not any(self._names.is_certainly(owner.id, kind, loop) for kind in (DATA, MODEL)):
            return f"{owner.id} is not certain to be an MjData or an MjModel of mujoco"
        return self._names.rebinding(owner.id, loop) or self._variation_of_argument(
            call.args[0], loop
        )

    def _variation_of_id(self, call: ast.Call, loop: Loop) -> str:
        if self._bindings.origin(dotted_name(call.func)) != _NAME_TO_ID:
            return "mj_name2id is not certain to be that of mujoco"
        if len(call.args) != 3:
            return "its arguments are not plain"
        model, kind, name = call.args
        if not isinstance(model, ast.Name):
            shown = ast.unparse(model)
            return f"{shown} may be another object in the next step; bind it to a name first"
        is_plain = isinstance(kind, ast.Constant) and isinstance(kind.value, int)
        if not (is_plain or self._bindings.origin(dotted_name(kind)).startswith(_ELEMENT_TYPES)):
            return "its arguments are not plain"
        return self._names.rebinding(model.id, loop) or self._variation_of_argument(name, loop)

    def _variation_of_argument(self, argument: ast.expr, loop: Loop) -> str:
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str | int):
            return ""
        if isinstance(argument, ast.Name):
            return self._names.rebinding(argument.id, loop)
        return "its arguments are not plain"

    def _widest_loop(self, call: ast.Call, loop: Loop) -> Loop:
        """Return the outermost loop that a call can leave.

        If it only left `loop`, the rule would match it again in the next loop outside that steps.
        """
        scope = self._bindings.scope_of(loop)
        while outer := self._script.step_loop_around(loop):
            if (
                self._bindings.scope_of(outer) is not scope
                or self._variation(call, outer)
                or not self._always_runs(loop, outer)
            ):
                break
            loop = outer
        return loop

    def _always_runs(self, node: ast.AST, loop: Loop) -> bool:
        """Return whether every iteration of a loop reaches a node, unless it ends the loop."""
        for above in (*self._script.above(node, loop), loop):
            if not _reaches(above, node):
                return False
            node = above
        return True

    def _new_name(self, call: ast.Call, loop: Loop) -> str:
        """Return a name for what a call in a loop returns, which the script does not have."""
        name = _describing_name(call)
        owner, _, _ = dotted_name(call.func).rpartition(".")
        if owner and self._names.is_certainly(owner, MODEL, loop):
            name = f"{owner}_{name}"
        wanted, number = name, 2
        while name in self._taken:
            name, number = f"{wanted}_{number}", number + 1
        self._taken.add(name)
        return name


def _group_for(groups: dict[str, list[_Group]], call: ast.Call, loop: Loop) -> _Group:
    """Return the group of the calls with the syntax of `call` in a loop, a new one if need be."""
    same = groups.setdefault(ast.dump(call), [])
    for group in same:
        if group.loop is loop:
            return group
    same.append(_Group(loop))
    return same[-1]


def _describing_name(call: ast.Call) -> str:
    """Return `hip_joint` for `data.joint("hip")`, `hip_id` for `mj_name2id(model, 3, "hip")`."""
    argument = call.args[-1]
    if isinstance(argument, ast.Name):
        element = argument.id.removesuffix("name").strip("_")
    else:
        assert isinstance(argument, ast.Constant)
        element = str(argument.value)
    element = re.sub(r"[^0-9A-Za-z]+", "_", element).strip("_").lower()
    if last_name(call.func) == "mj_name2id":
        kind = "id"
    else:
        assert isinstance(call.func, ast.Attribute)
        kind = call.func.attr
    if not element:
        return f"named_{kind}"
    if element[0].isdigit():
        return f"{kind}_{element}"
    return element if element.endswith(f"_{kind}") else f"{element}_{kind}"


def _reaches(above: ast.AST, child: ast.AST) -> bool:
    """Return whether executing a node always executes one of those directly below it.

    A loop counts as one that runs at least once.
    """
    if isinstance(child, ast.stmt):
        if not isinstance(above, ast.For | ast.While) or child not in above.body:
            return False  # even a `with` may catch what a wrong name raises
        earlier = above.body[: above.body.index(child)]
        return not any(map(_may_end, earlier))
    match above:
        case ast.BoolOp():
            return child is above.values[0]
        case ast.IfExp() | ast.If() | ast.While():
            return child is above.test
        case ast.Compare():
            return child is above.left or child is above.comparators[0]
        case ast.For():
            return child is above.iter
        case ast.Match():
            return child is above.subject
        case ast.Assert() | ast.match_case() | ast.ExceptHandler() | ast.AsyncFor():
            return False
    return True


def _may_end(statement: ast.AST, is_in_inner: bool = False) -> bool:
    """Return whether a statement may end the iteration, or the loop, in whose body it is.

    Args:
      statement: the statement.
      is_in_inner: whether it is in a loop inside that one.
    """
    if isinstance(statement, ast.Return | ast.Raise):
        return True
    if isinstance(statement, ast.Continue | ast.Break):
        return not is_in_inner
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return False
    inner = statement.body if isinstance(statement, ast.For | ast.AsyncFor | ast.While) else []
    return any(
        _may_end(child, is_in_inner or child in inner) for child in ast.iter_child_nodes(statement)
    )
