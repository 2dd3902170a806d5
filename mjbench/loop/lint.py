"""Find in a user's script what makes a stepping loop slow or its log wrong; nothing is executed.

A loop is looked at when it steps: it calls `mj_step`, or a function of the same file that does.
What an MjData is, is taken from how it is used and called: the second argument of `mj_step`, what
`MjData(…)` was assigned to, and names that end in `data`.
"""

import ast
import dataclasses
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mjbench.errors import InputError, one_line


@dataclass(frozen=True)
class Rule:
    """What is looked for.

    Attributes:
      code: as in `# noqa: MJB001`.
      message: what is wrong, and what to write instead.
      source: of the overhead table whose cost it has, if any; see `mjbench.loop.habits`.
    """

    code: str
    message: str
    source: str = ""


VIEW = Rule("MJB001", "a view is kept: every entry will show the last state; add .copy()")
NAMED = Rule(
    "MJB002",
    "named access inside a stepping loop; hoist it: x = data.joint('x').qpos before the loop",
    "named access by name",
)
ALLOCATION = Rule(
    "MJB003",
    "a new array in every step; make it before the loop and write into it (out=, x[:] =)",
    "concatenate",
)
CONTACT = Rule("MJB004", "contacts beyond data.ncon are of earlier steps; use [: data.ncon]")
FRESH = Rule("MJB005", "a new MjData for every episode; make one and call mj_resetData")
DOUBLE = Rule(
    "MJB006",
    "a loop over simulations around a loop over steps; mujoco.rollout or mujoco.batch does both"
    " on threads (mjbench compare says which)",
)
RULES = (VIEW, NAMED, ALLOCATION, CONTACT, FRESH, DOUBLE)

_STEPS = {"mj_step", "mj_step1", "mj_step2"}
_ACCESSORS = {"actuator", "body", "camera", "geom", "joint", "light", "sensor", "site", "tendon"}
_VIEWS = {"ravel", "reshape", "view", "transpose", "squeeze", "swapaxes"}
# Functions of NumPy that make an array, with the source of the overhead table that is like them.
_MAKES = ("zeros", "ones", "empty", "full", "zeros_like", "ones_like", "empty_like", "array", "eye")
_ALLOCATES = {
    **dict.fromkeys(_MAKES, "allocate zeros"),
    **dict.fromkeys(("concatenate", "append", "tile"), "concatenate"),
    **dict.fromkeys(("hstack", "vstack", "stack"), "hstack"),
}
_NUMPY = {"np", "numpy", "onp"}
# Array fields of MjData (mjdata.h); what is not among them is not taken for a view.
_FIELDS = re.compile(
    r"(qpos|qvel|act|ctrl|qacc|act_dot|sensordata|userdata|mocap_pos|mocap_quat|eq_active"
    r"|qacc_warmstart|qfrc_\w+|xfrc_\w+|xpos|xquat|xmat|xipos|ximat|xanchor|xaxis"
    r"|geom_x\w+|site_x\w+|cam_x\w+|light_x\w+|subtree_\w+|cdof\w*|cinert|crb|cvel|cacc|cfrc_\w+"
    r"|flex\w+|ten_\w+|wrap_\w+|actuator_\w+|qM|qLD\w*|energy|efc_\w+|plugin_state)$"
)
# Fields with one row of several numbers for each thing: an index gives a view, not a number.
_MATRICES = re.compile(
    r"(x(pos|quat|mat)|xi(pos|mat)|xanchor|xaxis|mocap_\w+|\w+_x(pos|mat|dir)|subtree_\w+|c(vel|acc|"
    r"inert|rb|dof\w*|frc_\w+)|xfrc_applied)$"
)


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
      file: as it was named.
      line: from 1.
      col: from 1.
      code: of the rule.
      message: of the rule.
      ns_per_step: about what it costs in each step; None where it is not a matter of time.
    """

    file: str
    line: int
    col: int
    code: str
    message: str
    ns_per_step: float | None


def check(file: str) -> list[Finding]:
    """Return the findings of a Python file, in the order of its lines.

    Raises:
      InputError: it cannot be read, or is not Python.
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
        tree = ast.parse(text)
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{file}: {one_line(error)}") from error
    lines = re.split(r"\r\n|\r|\n", text)  # as ast counts them
    found = {
        (node.lineno, node.col_offset + 1, rule.code): rule for node, rule in _Script(tree).look()
    }
    return [
        Finding(file, line, col, code, rule.message, costs().get(rule.source))
        for (line, col, code), rule in sorted(found.items())
        if not _excused(lines[line - 1], code)
    ]


def files(names: Sequence[str]) -> list[str]:
    """Return the Python files that names mean: files, and all below folders.

    Raises:
      InputError: no such file.
    """
    found = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            found += sorted(str(p) for p in path.rglob("*.py"))
        elif path.is_file():
            found.append(name)
        else:
            raise InputError(f"no such file: {name}")
    return found


@cache
def costs() -> dict[str, float]:
    """Return about how many ns each source adds to a step, by the stored overhead table.

    The table is what `mjbench overhead cartpole --json mjbench/overhead.json` wrote on the machine
    that it names; on another one it is the order of magnitude that holds.
    """
    stored = Path(__file__).with_name("overhead.json")
    if not stored.is_file():
        return {}
    (table,) = json.loads(stored.read_text(encoding="utf-8"))["results"]
    return {row["source"]: row["ns"] for row in table["costs"]}


def _excused(line: str, code: str) -> bool:
    found = re.search(r"#\s*noqa\b(?::\s*([\w, ]+))?", line, flags=re.IGNORECASE)
    if found is None:
        return False
    return found[1] is None or code in re.split(r"[,\s]+", found[1].upper())


class _Script:
    """What is known of a script: its MjData, its functions that step, its containers."""

    def __init__(self, tree: ast.Module):
        self.tree = tree
        self.parents = {
            child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)
        }
        self.stepping = self._stepping_functions()
        self.datas = self._datas()
        steps = (node for node in ast.walk(tree) if self.is_step(node))
        self.step_loops = {next(self._loops_around(node), None) for node in steps}

    def look(self) -> Iterator[tuple[ast.expr | ast.stmt, Rule]]:
        for loop in ast.walk(self.tree):
            if isinstance(loop, ast.For | ast.While) and self.steps(loop):
                yield from self._loop(loop)
            elif isinstance(loop, ast.ListComp | ast.GeneratorExp) and self.steps(loop):
                if self.is_view(loop.elt):
                    yield loop.elt, VIEW
                elif isinstance(loop.elt, ast.Tuple):
                    yield from ((e, VIEW) for e in loop.elt.elts if self.is_view(e))

    def _loop(self, loop: ast.For | ast.While) -> Iterator[tuple[ast.expr | ast.stmt, Rule]]:
        inner = self._within(loop)
        for node in inner:
            yield from self._stored(node)
            if isinstance(node, ast.Call) and self._each_step(node, loop):
                if self._is_named(node) or _name(node.func) == "mj_name2id":
                    yield node, NAMED
                elif self._allocates(node) and not self._sometimes(node, loop):
                    source = _ALLOCATES[_name(node.func)]
                    yield node, dataclasses.replace(ALLOCATION, source=source)
            if self._beyond_ncon(node):
                yield node, CONTACT  # type: ignore[misc]
        if isinstance(loop, ast.For) and any(
            isinstance(node, ast.For | ast.While) and self.steps(node) for node in inner
        ):
            for node in inner:
                if self._is_fresh(node, inner):
                    yield node, FRESH  # type: ignore[misc]
            if self._over_simulations(loop, inner):
                yield loop, DOUBLE

    # -- what a node is

    def steps(self, node: ast.AST) -> bool:
        """Return whether `mj_step` is called inside a node, or a function that calls it."""
        return any(
            self.is_step(n) or (isinstance(n, ast.Call) and _name(n.func) in self.stepping)
            for n in self._within(node)
        )

    def is_step(self, node: ast.AST) -> bool:
        return isinstance(node, ast.Call) and _name(node.func) in _STEPS

    def is_data(self, node: ast.AST) -> bool:
        """Return whether an expression is an MjData."""
        text = _dotted(node)
        return bool(text) and (text in self.datas or text.rpartition(".")[2] in ("data", "mjdata"))

    def is_view(self, node: ast.AST) -> bool:
        """Return whether an expression is a view of MuJoCo's memory."""
        if isinstance(node, ast.Attribute):
            if node.attr in ("T", "flat"):
                return self.is_view(node.value)
            if self._is_named(node.value):
                return True
            return self.is_data(node.value) and bool(_FIELDS.match(node.attr))
        if isinstance(node, ast.Subscript):
            if not self.is_view(node.value):
                return False
            index = node.slice
            several = isinstance(index, ast.Slice) or (
                isinstance(index, ast.Tuple) and any(isinstance(e, ast.Slice) for e in index.elts)
            )
            field = node.value.attr if isinstance(node.value, ast.Attribute) else ""
            return several or (_is_number(index) and bool(_MATRICES.match(field)))
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute) and node.func.attr in _VIEWS:
                return self.is_view(node.func.value)
            return _name(node.func) == "asarray" and bool(node.args) and self.is_view(node.args[0])
        return False

    def _is_named(self, node: ast.AST) -> bool:
        """Return whether a node is `data.joint(…)` or the like."""
        return (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in _ACCESSORS
            and self.is_data(node.func.value)
        )

    def _stored(self, node: ast.AST) -> Iterator[tuple[ast.expr, Rule]]:
        """Yield views that a statement or call of a loop keeps for later."""
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            kept = node.func.attr in ("append", "appendleft", "add", "insert", "put")
            if kept and _dotted(node.func.value) not in _NUMPY:
                yield from ((a, VIEW) for arg in node.args for a in self._views_in(arg))
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                lasting = isinstance(target, ast.Attribute) and not self.is_data(target.value)
                held = isinstance(target, ast.Subscript) and self._holds_objects(target.value)
                if lasting or held:
                    yield from ((v, VIEW) for v in self._views_in(node.value))

    def _views_in(self, node: ast.AST) -> Iterator[ast.expr]:
        """Yield the views that are an expression, or lie in a tuple, list or dict that it makes."""
        if isinstance(node, ast.expr) and self.is_view(node):
            yield node
        elif isinstance(node, ast.Tuple | ast.List):
            for element in node.elts:
                yield from self._views_in(element)
        elif isinstance(node, ast.Dict):
            for value in node.values:
                yield from self._views_in(value)
        elif isinstance(node, ast.Call) and _name(node.func) == "dict":
            for keyword in node.keywords:
                yield from self._views_in(keyword.value)

    def _holds_objects(self, container: ast.AST) -> bool:
        """Return whether a name was made a list or a dict: an array copies what is put in."""
        text = _dotted(container)
        return bool(text) and any(
            _dotted(target) == text and _makes_objects(value)
            for target, value in self._assignments()
        )

    def _assignments(self) -> Iterator[tuple[ast.AST, ast.AST]]:
        """Yield every assignment of the script, those of tuples one by one."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.AnnAssign) and node.value is not None:
                yield node.target, node.value
            elif isinstance(node, ast.Assign):
                for target in node.targets:
                    sides = (target, node.value)
                    if all(isinstance(side, ast.Tuple) for side in sides):
                        yield from zip(*(side.elts for side in sides), strict=False)  # type: ignore[attr-defined]
                    else:
                        yield sides

    def _allocates(self, node: ast.Call) -> bool:
        return (
            isinstance(node.func, ast.Attribute)
            and _dotted(node.func.value) in _NUMPY
            and node.func.attr in _ALLOCATES
            and not any(keyword.arg == "out" for keyword in node.keywords)
        )

    def _loops_around(self, node: ast.AST) -> Iterator[ast.AST]:
        """Yield the loops in whose every turn a node runs, the innermost first."""
        child, parent = node, self.parents.get(node)
        while parent is not None:
            once = isinstance(parent, ast.For) and child is parent.iter
            if isinstance(parent, ast.For | ast.While) and not once:
                yield parent
            child, parent = parent, self.parents.get(parent)

    def _each_step(self, node: ast.AST, loop: ast.AST) -> bool:
        """Return whether `loop` is the innermost around a node that steps in its own turns."""
        return next((x for x in self._loops_around(node) if x in self.step_loops), None) is loop

    def _sometimes(self, node: ast.AST, loop: ast.AST) -> bool:
        """Return whether a node of a loop runs only in some turns: it stands under an `if`."""
        while node is not loop:
            node = self.parents[node]
            if isinstance(node, ast.If):
                return True
        return False

    def _is_fresh(self, node: ast.AST, inner: Sequence[ast.AST]) -> bool:
        """Return whether a node makes an MjData of a model that is not made in the loop too."""
        if not (isinstance(node, ast.Call) and _name(node.func) == "MjData" and node.args):
            return False
        made = {_dotted(t) for n in inner if isinstance(n, ast.Assign) for t in n.targets}
        return _dotted(node.args[0]) not in made

    def _beyond_ncon(self, node: ast.AST) -> bool:
        """Return whether contacts are used without a look at `ncon`."""
        if isinstance(node, ast.For):
            return self._is_contact(node.iter)
        if isinstance(node, ast.Call) and _name(node.func) in ("len", "enumerate"):
            return bool(node.args) and self._is_contact(node.args[0])
        return (
            isinstance(node, ast.Attribute)
            and self._is_contact(node.value)
            and isinstance(node.ctx, ast.Load)
            and not isinstance(self.parents.get(node), ast.Subscript)
        )

    def _is_contact(self, node: ast.AST) -> bool:
        return (
            isinstance(node, ast.Attribute) and node.attr == "contact" and self.is_data(node.value)
        )

    def _over_simulations(self, loop: ast.For, inner: Sequence[ast.AST]) -> bool:
        """Return whether each turn starts a simulation of its own and steps it by itself."""
        starts = {"mj_resetData", "mj_resetDataKeyframe", "mj_setState", "MjData"}
        if any(isinstance(n, ast.Call) and _name(n.func) in starts for n in inner):
            return any(
                isinstance(n, ast.For) and any(self.is_step(m) for m in self._within(n))
                for n in inner
            )
        return False

    # -- what the script has

    def _stepping_functions(self) -> set[str]:
        return {
            node.name
            for node in ast.walk(self.tree)
            if isinstance(node, ast.FunctionDef) and any(self.is_step(n) for n in ast.walk(node))
        }

    def _datas(self) -> set[str]:
        found = set()
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
                if _name(node.value.func) == "MjData":
                    found |= {_dotted(target) for target in node.targets}
            elif isinstance(node, ast.Call) and self.is_step(node) and len(node.args) > 1:
                found.add(_dotted(node.args[1]))
        return found - {""}

    def _within(self, node: ast.AST) -> list[ast.AST]:
        """Return the nodes below one, without those of functions defined in it."""
        found, waiting = [], list(ast.iter_child_nodes(node))
        while waiting:
            child = waiting.pop()
            if not isinstance(child, ast.FunctionDef | ast.Lambda | ast.ClassDef):
                found.append(child)
                waiting += ast.iter_child_nodes(child)
        return found


def _name(function: ast.AST) -> str:
    return _dotted(function).rpartition(".")[2]


def _dotted(node: ast.AST) -> str:
    """Return `self.env.data` of such an expression; nothing of any other."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = _dotted(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return ""


def _makes_objects(node: ast.AST) -> bool:
    """Return whether an expression makes a list or a dict."""
    if isinstance(node, ast.BinOp):
        return _makes_objects(node.left)
    if isinstance(node, ast.Call):
        return _name(node.func) in ("list", "dict", "defaultdict", "deque")
    return isinstance(node, ast.List | ast.Dict | ast.ListComp | ast.DictComp)


def _is_number(node: ast.AST) -> bool:
    return not isinstance(node, ast.Slice | ast.Tuple | ast.List)
