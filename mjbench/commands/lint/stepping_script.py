"""What a script's syntax says of its stepping loops: its MjData, its views, what runs each step.

A loop steps when it calls `mj_step`, or a function of the same file that does. Others step an
environment: by its `step`, that of dm_control's physics, or Gymnasium's `do_simulation`. What an
MjData is follows from how it is used and named: the second argument of `mj_step`, what `MjData(…)`
was assigned to, and what is called `data` or `mjdata`, such as `self.data`. An MjModel is the first
argument of `mj_step`, and what `MjModel.from_xml_path(…)` was assigned to. An environment is what
`make(…)`, `load(…)` or a class whose name ends in `Env` was assigned to, and what is called `env`.
"""

import ast
import itertools
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property

from mjbench.commands.lint.name_bindings import NameBindings, ScriptFunctions
from mjbench.commands.lint.script_syntax import (
    FUNCTIONS,
    ancestors,
    assignments,
    dotted_name,
    is_call,
    is_step,
    last_name,
    name_nodes,
    nodes_inside,
)

# Methods that step an environment.
_ENVIRONMENT_STEPS = {"step", "step_wait"}
# What creates an environment.
_CREATES_ENVIRONMENT = re.compile(r"(make|make_vec|make_env|load|\w*(Env|VectorEnv|Environment))$")
_ENVIRONMENT_PACKAGES = {"gym", "gymnasium", "suite", "metaworld", "robosuite"}
_LOADS_MODEL = re.compile(r"from_(binary_path|xml_path|xml_string)$")
# Names of environments.
_ENVIRONMENTS = {"env", "envs", "environment", "physics", "venv", "vec_env"}
# Methods that return the part of an MjData, or also of an MjModel, that belongs to a named element;
# with how the fields of MjData begin whose rest is the field of such a part.
PART_PREFIXES = {
    "body": "",
    "joint": "",
    "jnt": "",
    "actuator": "",
    "geom": "geom_",
    "site": "site_",
    "cam": "cam_",
    "camera": "cam_",
    "light": "light_",
    "ten": "ten_",
    "tendon": "ten_",
    "sensor": "sensor",
}
_MODEL_ACCESSORS = PART_PREFIXES.keys() | {
    *("eq", "equality", "exclude", "hfield", "key", "keyframe", "mat", "material", "mesh"),
    *("numeric", "pair", "skin", "tex", "text", "texture", "tuple"),
}
# What such a part has that is not an array.
_NUMBERS_AND_NAMES = {"id", "name"}
# Methods of an array that return a view of it; those that do so where it is contiguous.
VIEW_METHODS = {"view", "transpose", "squeeze", "swapaxes", "ravel", "reshape"}
_RESHAPING = {"ravel", "reshape"}
# Methods of a container that store an argument.
STORING_METHODS = {"append", "appendleft", "add", "insert", "put"}
# Array fields of MjData (mjdata.h); nothing else is taken for a view.
FIELDS = re.compile(
    r"(qpos|qvel|act|ctrl|qacc|act_dot|sensordata|userdata|mocap_pos|mocap_quat|eq_active"
    r"|qacc_warmstart|qfrc_\w+|xfrc_\w+|xpos|xquat|xmat|xipos|ximat|xanchor|xaxis"
    r"|geom_x\w+|site_x\w+|cam_x\w+|light_x\w+|subtree_\w+|cdof\w*|cinert|crb|cvel|cacc|cfrc_\w+"
    r"|flex\w+|ten_\w+|wrap_\w+|actuator_\w+|qM|qLD\w*|energy|efc_\w+|plugin_state)$"
)
# Fields with a row of several numbers for each element: an index gives a view, not a number.
_MATRICES = re.compile(
    r"(x(pos|quat|mat)|xi(pos|mat)|xanchor|xaxis|mocap_\w+|\w+_x(pos|mat|dir)|subtree_\w+|c(vel|acc|"
    r"inert|rb|dof\w*|frc_\w+)|xfrc_applied)$"
)


Loop = ast.For | ast.While
# A loop that steps, or a method that does, such as an environment's `step`.
SteppingBody = Loop | FUNCTIONS


class SteppingScript:
    """The syntax of a script, and what follows from it.

    Attributes:
      values: that are assigned, by their targets.
      model_names: of what is an MjModel.
      environment_loops: those of the others that step an environment.
      episode_loops: those of `loops`, all `for`, that have another one inside.
    """

    def __init__(self, tree: ast.Module):
        self.tree = tree
        self.nodes = list(ast.walk(tree))
        self.calls = [node for node in self.nodes if isinstance(node, ast.Call)]
        self.parents: Mapping[ast.AST, ast.AST] = {
            child: node for node in self.nodes for child in ast.iter_child_nodes(node)
        }
        self.values = dict(assignments(tree))
        self._values_of_names: defaultdict[str, list[ast.AST]] = defaultdict(list)
        for target, value in self.values.items():
            self._values_of_names[dotted_name(target)].append(value)
        self._stepping_functions = self._names_of_functions(is_step)
        self._environment_names = self._assigned_names(_creates_environment)
        self._environment_functions = self._names_of_functions(self._steps_environment)
        arguments = [call.args for call in self.calls if is_step(call)]
        created = self._assigned_names(lambda call: is_call(call, "MjData"))
        self._data_names = created | ({dotted_name(a[1]) for a in arguments if len(a) > 1} - {""})
        loaded = self._assigned_names(lambda c: bool(_LOADS_MODEL.match(last_name(c.func))))
        self.model_names = loaded | ({dotted_name(a[0]) for a in arguments if a} - {""})
        steps = (n for n in self.nodes if is_step(n) or self._steps_environment(n))
        # the innermost loop around each call that steps
        self._step_loops = {next(self.loops_around(node), None) for node in steps}
        loops = [node for node in self.nodes if isinstance(node, Loop)]
        self.loops = [loop for loop in loops if self.steps_inside(loop)]
        stepping = {*self.loops}
        self.environment_loops = [
            loop for loop in loops if loop not in stepping and self.steps_environment_inside(loop)
        ]
        self.episode_loops = [
            loop
            for loop in self.loops
            if isinstance(loop, ast.For) and stepping.intersection(nodes_inside(loop))
        ]
        self.methods = [
            node
            for node in self.nodes
            if isinstance(node, FUNCTIONS)
            and isinstance(self.parents.get(node), ast.ClassDef)
            and self.steps_either_inside(node)
        ]
        self.comprehensions = [
            node
            for node in self.nodes
            if isinstance(node, ast.ListComp) and self.steps_either_inside(node)
        ]

    def _assigned_names(self, is_value: Callable[[ast.Call], bool]) -> set[str]:
        values = self.values.items()
        named = {dotted_name(t) for t, v in values if isinstance(v, ast.Call) and is_value(v)}
        return named - {""}

    def _names_of_functions(self, has: Callable[[ast.AST], bool]) -> set[str]:
        functions = (node for node in self.nodes if isinstance(node, FUNCTIONS))
        return {function.name for function in functions if any(map(has, ast.walk(function)))}

    @cached_property
    def bindings(self) -> NameBindings:
        return NameBindings(self.tree, self.parents)

    @cached_property
    def functions(self) -> ScriptFunctions:
        return ScriptFunctions(self.bindings, self.parents, self.calls)

    @cached_property
    def names(self) -> Mapping[str, Sequence[ast.Name]]:
        names: defaultdict[str, list[ast.Name]] = defaultdict(list)
        for name in name_nodes(self.tree):
            names[name.id].append(name)
        return names

    @cached_property
    def _indirect_functions(self) -> set[ast.FunctionDef]:
        """The functions that call, through others of the script, one that calls `mj_step`."""
        if not self._stepping_functions:
            return set()
        named = [n for n in self.nodes if isinstance(n, ast.FunctionDef)]
        waiting = [function for function in named if function.name in self._stepping_functions]
        indirect: set[ast.FunctionDef] = set()
        while waiting:
            for call in self.functions.calls_of(waiting.pop()):
                functions = (n for n in self.above(call) if isinstance(n, FUNCTIONS | ast.Lambda))
                caller = next(functions, None)
                if isinstance(caller, ast.FunctionDef) and caller not in indirect:
                    indirect.add(caller)
                    waiting.append(caller)
        return indirect

    def is_view(self, node: ast.AST) -> bool:
        match node:
            case ast.Attribute(value=array, attr="T"):
                return self.is_view(array)
            case ast.Attribute(value=owner, attr=field):
                if self.is_named_part(owner):
                    return field not in _NUMBERS_AND_NAMES
                return self.is_data(owner) and bool(FIELDS.match(field))
            case ast.Subscript(value=array):
                is_row = isinstance(array, ast.Attribute) and self.is_named_part(array.value)
                return self.is_view(array) and index_gives_view(node, is_row)
            case ast.Call(keywords=[_, *_]):  # `dtype` or `order` may make a copy
                return False
            case ast.Call(func=ast.Attribute(value=array, attr=method)) if method in VIEW_METHODS:
                is_whole = isinstance(array, ast.Attribute) and array.attr != "T"
                return self.is_view(array) and (is_whole or method not in _RESHAPING)
            case ast.Call(func=function, args=[array]):
                is_asarray = self.bindings.origin(dotted_name(function)) == "numpy.asarray"
                return is_asarray and self.is_view(array)
        return False

    def assigned(self, node: ast.AST) -> list[ast.AST | None]:
        """Return what was assigned to a name in its scope, or to an attribute anywhere.

        None stands for what a name gets by other means, as a parameter does.
        """
        if not isinstance(node, ast.Name):
            return list(self.assigned_anywhere(dotted_name(node)))
        if node.id in self.bindings.declared:
            return [None]
        return [self.values.get(target) for target in self.bindings.of(node.id, node)]

    def resolved(self, node: ast.expr) -> ast.expr:
        """Return what a name was assigned, where that happens once; any other expression itself."""
        match self.assigned(node) if isinstance(node, ast.Name) else []:
            case [ast.expr() as value]:
                return value
        return node

    def assigned_anywhere(self, name: str) -> Sequence[ast.AST]:
        return self._values_of_names.get(name, []) if name else []

    def is_named_access(self, node: ast.AST) -> bool:
        """Return whether a node is `data.joint(…)`, `model.body(…)` or the like."""
        match node:
            case ast.Call(func=ast.Attribute(value=owner, attr=accessor)):
                is_of_model = (
                    accessor in _MODEL_ACCESSORS and dotted_name(owner) in self.model_names
                )
                return is_of_model or self.is_access_to_data(node)
        return False

    def step_loop_around(self, node: ast.AST) -> Loop | None:
        return next((n for n in self.loops_around(node) if n in self._step_loops), None)

    def is_conditional(self, node: ast.AST) -> bool:
        """Return whether a node is under an `if` of its loop that steps, or of its function."""
        above = self.above(node, self.step_loop_around(node))
        nearest = next((each for each in above if isinstance(each, ast.If | FUNCTIONS)), None)
        return isinstance(nearest, ast.If)

    def steps_inside(self, node: ast.AST) -> bool:
        return any(isinstance(n, ast.Call) and self._steps(n) for n in nodes_inside(node))

    def _steps(self, call: ast.Call) -> bool:
        if is_step(call) or last_name(call.func) in self._stepping_functions:
            return True
        indirect = self._indirect_functions
        return bool(indirect) and not indirect.isdisjoint(self.functions.called(call))

    def steps_either_inside(self, node: ast.AST) -> bool:
        return self.steps_inside(node) or self.steps_environment_inside(node)

    def steps_environment_inside(self, node: ast.AST) -> bool:
        calls = [n for n in nodes_inside(node) if isinstance(n, ast.Call)]
        functions = self._environment_functions
        return any(self._steps_environment(c) or last_name(c.func) in functions for c in calls)

    def _steps_environment(self, node: ast.AST) -> bool:
        if not isinstance(node, ast.Call):
            return False
        if is_call(node, "do_simulation"):  # of Gymnasium's MujocoEnv; no other class has it
            return True
        owner, _, method = dotted_name(node.func).rpartition(".")
        if method not in _ENVIRONMENT_STEPS:
            return False
        parts = owner.split(".")
        return bool(_ENVIRONMENTS.intersection(parts)) or owner in self._environment_names

    def is_data(self, node: ast.AST) -> bool:
        name = dotted_name(node)
        return name in self._data_names or name.rpartition(".")[2] in ("data", "mjdata")

    def is_access_to_data(self, node: ast.AST) -> bool:
        match node:
            case ast.Call(func=ast.Attribute(value=owner, attr=accessor)):
                return accessor in PART_PREFIXES and self.is_data(owner)
        return False

    def is_named_part(self, node: ast.AST) -> bool:
        return self._is_always(node, self.is_access_to_data) or self.is_access_to_data(node)

    def is_alias(self, node: ast.AST) -> bool:
        """Return whether a name always stands for a view."""
        return isinstance(node, ast.Name) and self._is_always(node, self.is_view)

    def _is_always(self, node: ast.AST, test: Callable[[ast.AST], bool]) -> bool:
        """Return whether a test holds for all that is ever assigned to a name or an attribute."""
        values = self.assigned(node)
        return bool(values) and all(value is not None and test(value) for value in values)

    def above(self, node: ast.AST, until: ast.AST | None = None) -> Iterator[ast.AST]:
        """Yield the nodes above a node, the innermost first, without `until` and those above."""
        above = ancestors(self.parents, node)
        return itertools.takewhile(lambda each: each is not until, above)

    def loops_around(self, node: ast.AST) -> Iterator[Loop]:
        """Yield the loops in whose every iteration a node runs, the innermost first."""
        child = node
        for parent in ancestors(self.parents, node):
            if isinstance(parent, Loop):
                is_iterable = isinstance(parent, ast.For) and child is parent.iter
                if not (is_iterable or child in parent.orelse):  # these are evaluated once
                    yield parent
            child = parent


def _creates_environment(call: ast.Call) -> bool:
    package, _, function = dotted_name(call.func).rpartition(".")
    is_of_package = bool(_ENVIRONMENT_PACKAGES.intersection(package.split(".")))
    is_class = function[:1].isupper()
    return bool(_CREATES_ENVIRONMENT.match(function)) and (is_class or is_of_package)


def index_gives_view(node: ast.Subscript, is_row: bool) -> bool:
    """Return whether indexing a view gives a view again; that of a named element is one row."""
    index = node.slice
    parts = index.elts if isinstance(index, ast.Tuple) else [index]
    if not all(isinstance(part, ast.Slice) or _is_integer(part) for part in parts):
        return False  # an array as an index makes a copy, and a name may stand for one
    if any(isinstance(part, ast.Slice) for part in parts):
        return True
    if isinstance(index, ast.Tuple) or not isinstance(node.value, ast.Attribute):
        return False
    return not is_row and bool(_MATRICES.match(node.value.attr))


def _is_integer(node: ast.AST) -> bool:
    """Return whether an expression is a number such as 2 or -1."""
    node = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(node, ast.Constant) and type(node.value) is int
