"""Which names of a script certainly stay one MjData, or one MjModel, while a loop runs."""

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from mjbench.loop.name_bindings import NameBindings
from mjbench.loop.python_source import PythonProgram
from mjbench.loop.script_syntax import dotted_name, nodes_inside
from mjbench.loop.stepping_script import Loop, SteppingScript

DATA, MODEL = "mujoco.MjData", "mujoco.MjModel"
# Which argument of mj_step is of which type.
_STEP_ARGUMENTS = {MODEL: 0, DATA: 1}
_STEPS = {"mujoco.mj_step", "mujoco.mj_step1", "mujoco.mj_step2"}


@dataclass(frozen=True, eq=False)
class CertainNames:
    """What is known of the names of a script."""

    program: PythonProgram
    script: SteppingScript

    @property
    def bindings(self) -> NameBindings:
        return self.script.bindings

    @cached_property
    def commands(self) -> Sequence[str]:
        return [line.text for line in self.program.lines if line.is_command]

    @cached_property
    def _has_subclass(self) -> bool:
        bases = (b for n in self.script.nodes if isinstance(n, ast.ClassDef) for b in n.bases)
        return any(self.bindings.origin(dotted_name(base)) in (DATA, MODEL) for base in bases)

    def is_in_command(self, name: str) -> bool:
        return any(re.search(rf"\b{name}\b", command) for command in self.commands)

    def rebinding(self, name: str, loop: Loop) -> str:
        """Return why a name may change its value during a loop, or have none before it."""
        lines = self.program.lines[loop.lineno - 1 : loop.end_lineno]
        if any(line.is_command for line in lines):
            return "a command of IPython is in the loop"
        if self.is_in_command(name):
            return f"a command of IPython names {name}"
        reason = self.bindings.rebinding(name, loop)
        if not reason and not self.bindings.is_certainly_bound(name, loop):
            return f"{name} may have no value before the loop"
        return reason

    def is_certainly(self, name: str, kind: str, loop: Loop) -> bool:
        """Return whether a name in a loop is an MjData, or an MjModel, of mujoco: of `kind`."""
        if self._has_subclass:  # which may do anything for `joint(…)`
            return False
        index = _STEP_ARGUMENTS[kind]
        calls = (node for node in nodes_inside(loop) if isinstance(node, ast.Call))
        steps = (call for call in calls if self.bindings.origin(dotted_name(call.func)) in _STEPS)
        if any(name in map(dotted_name, step.args[index : index + 1]) for step in steps):
            return True
        nodes = self.bindings.of(name, loop)
        return bool(nodes) and all(self._is_assigned(node, kind) for node in nodes)

    def _is_assigned(self, target: ast.AST, kind: str) -> bool:
        statement = self.script.parents[target]
        if not isinstance(statement, ast.Assign | ast.AnnAssign):
            return False
        if not isinstance(statement.value, ast.Call):
            return False
        origin = self.bindings.origin(dotted_name(statement.value.func))
        return origin == DATA if kind == DATA else origin.startswith(f"{MODEL}.from_")
