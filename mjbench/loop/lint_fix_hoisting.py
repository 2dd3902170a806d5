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
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.loop.lint_certain_names import DATA, MODEL, CertainNames
from mjbench.loop.script_syntax import COMPREHENSIONS, dotted_name, is_call
from mjbench.loop.stepping_script import Loop

_NAME_TO_ID, _ELEMENT_TYPES = "mujoco.mj_name2id", "mujoco.mjtObj."
_NOT_PLAIN = "its arguments are not plain"


@dataclass(frozen=True)
class Hoist:
    """Accesses with the same syntax that become a name, which is bound before their loop."""

    name: str
    loop: Loop
    calls: Sequence[ast.Call]


class Hoisting:
    """What is known of a script for hoisting."""

    def __init__(self, names: CertainNames):
        self._script = names.script
        self._names = names
        self._bindings = names.bindings
        self._lines = [line.text for line in names.program.lines]
        # a new name is none of these; where strings may hold code, nothing that the script contains
        texts = self._lines if self._bindings.reaches_names else names.commands
        tokens = {token for text in texts for token in re.findall(r"\w+", text)}
        self._taken = {*tokens, *self._bindings.identifiers, *dir(builtins), *keyword.kwlist}

    def plan(self, calls: Sequence[ast.Call]) -> tuple[list[Hoist], dict[ast.AST, str]]:
        """Return which named accesses can be hoisted, each out of which loop; why others cannot."""
        refusals: dict[ast.AST, str] = {}
        alike: defaultdict[str, list[tuple[ast.Call, Loop]]] = defaultdict(list)
        for call in calls:
            loop = self._script.step_loop_around(call)
            reason = self._refusal(call, loop)
            if loop is None or reason:
                refusals[call] = reason
            else:
                alike[ast.dump(call)].append((call, loop))
        hoists: list[Hoist] = []
        for accesses in alike.values():
            by_loop: defaultdict[Loop, list[ast.Call]] = defaultdict(list)
            moved_out_of = {
                self._widest_loop(call, loop)
                for call, loop in accesses
                if self._always_runs(call, loop)
            }
            for call, loop in accesses:
                above = self._script.above(loop, self._bindings.scope_of(loop))
                around = [n for n in (loop, *above) if n in moved_out_of]
                if around:  # also of a call that not every step reaches: the name is bound already
                    by_loop[around[-1]].append(call)
                else:
                    refusals[call] = "not every step reaches it, and a wrong name would raise"
            if by_loop:
                name = self._new_name(*accesses[0])
                hoists += [Hoist(name, loop, of_loop) for loop, of_loop in by_loop.items()]
        return hoists, refusals

    def _refusal(self, call: ast.Call, loop: Loop | None) -> str:
        """Return why a call cannot be hoisted out of a loop; empty if it can."""
        if loop is None:
            return "it is in a function that the loop calls"
        lines = self._lines[call.lineno - 1 : call.end_lineno]
        if any("#" in line for line in lines[:-1]):
            return "a comment stands in it"
        for above in self._script.above(call, loop):
            if isinstance(above, ast.JoinedStr):
                return "it is in an f-string"
            if isinstance(above, COMPREHENSIONS):
                return "it is in a comprehension"
        return self._variation(call, loop)

    def _variation(self, call: ast.Call, loop: Loop) -> str:
        """Return why a call may return something else in another iteration of a loop."""
        if isinstance(self._bindings.scope_of(loop), ast.ClassDef):
            return "a name bound in the body of a class becomes its attribute"
        if call.keywords or any(isinstance(argument, ast.Starred) for argument in call.args):
            return _NOT_PLAIN
        if is_call(call, "mj_name2id"):
            return self._variation_of_id(call, loop)
        assert isinstance(call.func, ast.Attribute)  # the rule matches nothing else
        owner = call.func.value
        if not isinstance(owner, ast.Name):
            return _may_be_another(owner)
        if len(call.args) != 1:
            return _NOT_PLAIN
        if not any(self._names.is_certainly(owner.id, kind, loop) for kind in (DATA, MODEL)):
            return f"{owner.id} is not certain to be an MjData or an MjModel of mujoco"
        return self._variation_of_names(owner.id, call.args[0], loop)

    def _variation_of_id(self, call: ast.Call, loop: Loop) -> str:
        if self._bindings.origin(dotted_name(call.func)) != _NAME_TO_ID:
            return "mj_name2id is not certain to be that of mujoco"
        match call.args:
            case [ast.Name(id=model), ast.Constant(value=int()), name]:
                return self._variation_of_names(model, name, loop)
            case [ast.Name(id=model), kind, name]:
                is_type = self._bindings.origin(dotted_name(kind)).startswith(_ELEMENT_TYPES)
                return self._variation_of_names(model, name, loop) if is_type else _NOT_PLAIN
            case [model, _, _]:
                return _may_be_another(model)
        return _NOT_PLAIN

    def _variation_of_names(self, owner: str, element: ast.expr, loop: Loop) -> str:
        reason = self._names.rebinding(owner, loop)
        match element:
            case ast.Constant(value=str() | int()):
                return reason
            case ast.Name(id=name):
                return reason or self._names.rebinding(name, loop)
        return reason or _NOT_PLAIN

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
        name = _describing_name(call)
        owner, _, _ = dotted_name(call.func).rpartition(".")
        if owner and self._names.is_certainly(owner, MODEL, loop):
            name = f"{owner}_{name}"
        wanted, number = name, 2
        while name in self._taken:
            name, number = f"{wanted}_{number}", number + 1
        self._taken.add(name)
        return name


def _may_be_another(owner: ast.expr) -> str:
    return f"{ast.unparse(owner)} may be another object in the next step; bind it to a name first"


def _describing_name(call: ast.Call) -> str:
    """Return `hip_joint` for `data.joint("hip")`, `hip_id` for `mj_name2id(model, 3, "hip")`."""
    argument = call.args[-1]
    if isinstance(argument, ast.Name):
        element = argument.id.removesuffix("name").strip("_")
    else:
        assert isinstance(argument, ast.Constant)
        element = str(argument.value)
    element = re.sub(r"[^0-9A-Za-z]+", "_", element).strip("_").lower()
    kind = "id" if is_call(call, "mj_name2id") else getattr(call.func, "attr", "")
    if not element:
        return f"named_{kind}"
    if element[0].isdigit():
        return f"{kind}_{element}"
    return element if element.endswith(f"_{kind}") else f"{element}_{kind}"


def _reaches(above: ast.AST, child: ast.AST) -> bool:
    """Return whether executing a node always executes its child; a loop runs at least once."""
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
    """Return whether a statement in a loop, or in an inner one, may end its iteration, or it."""
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
