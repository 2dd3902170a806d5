"""Which names of a script certainly stay one MjData, or one MjModel, while a loop runs."""

import ast
import re

from mjbench.loop.name_bindings import NameBindings
from mjbench.loop.python_source import Program
from mjbench.loop.script_syntax import dotted_name, nodes_inside
from mjbench.loop.stepping_script import SteppingScript

Loop = ast.For | ast.While
DATA, MODEL = "mujoco.MjData", "mujoco.MjModel"
# Which argument of mj_step is of which type.
_STEP_ARGUMENTS = {MODEL: 0, DATA: 1}
_STEPS = {"mujoco.mj_step", "mujoco.mj_step1", "mujoco.mj_step2"}


class CertainNames:
    """What is known of the names of a script.

    Attributes:
      bindings: where they are bound.
      commands: of IPython, each on its line; the other lines are empty.
    """

    def __init__(self, program: Program, script: SteppingScript):
        """Look at a script.

        Args:
          program: the script.
          script: what follows from its syntax.
        """
        self.bindings: NameBindings = script.bindings
        self.commands = [n.text if n.text != n.python else "" for n in program.lines]
        self._parents = script.parents
        self._has_subclass = any(
            self.bindings.origin(dotted_name(base)) in (DATA, MODEL)
            for node in ast.walk(program.tree)
            if isinstance(node, ast.ClassDef)
            for base in node.bases
        )

    def is_in_command(self, name: str) -> bool:
        """Return whether a command of IPython names a name."""
        return any(re.search(rf"\b{name}\b", command) for command in self.commands)

    def rebinding(self, name: str, loop: Loop) -> str:
        """Return why a name may change its value during a loop, or have none before it."""
        if any(self.commands[loop.lineno - 1 : loop.end_lineno]):
            return "a command of IPython is in the loop"
        if self.is_in_command(name):
            return f"a command of IPython names {name}"
        reason = self.bindings.rebinding(name, loop)
        if not reason and not self.bindings.is_certainly_bound(name, loop):
            return f"{name} may have no value before the loop"
        return reason

    def is_certainly(self, name: str, kind: str, loop: Loop) -> bool:
        """Return whether a name in a loop is an MjData, or an MjModel, of mujoco.

        Args:
          name: the name.
          kind: `DATA` or `MODEL`.
          loop: the loop.
        """
        if self._has_subclass:  # which may do anything for `joint(…)`
            return False
        index = _STEP_ARGUMENTS[kind]
        for node in nodes_inside(loop):
            if (
                isinstance(node, ast.Call)
                and self.bindings.origin(dotted_name(node.func)) in _STEPS
                and len(node.args) > index
                and dotted_name(node.args[index]) == name
            ):
                return True
        owner = self.bindings.owner(name, loop)
        nodes = self.bindings.bindings(name, owner) if owner is not None else ()
        return bool(nodes) and all(self._is_assigned(node, kind) for node in nodes)

    def _is_assigned(self, target: ast.AST, kind: str) -> bool:
        """Return whether a binding assigns a new MjData, or a loaded MjModel."""
        statement = self._parents[target]
        if not isinstance(statement, ast.Assign | ast.AnnAssign):
            return False
        if not isinstance(statement.value, ast.Call):
            return False
        origin = self.bindings.origin(dotted_name(statement.value.func))
        return origin == DATA if kind == DATA else origin.startswith(f"{MODEL}.from_")
