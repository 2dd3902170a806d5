"""What a rule of `mjbench lint` is, and what it yields."""

import ast
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mjbench.commands.lint.stepping_script import SteppingScript


@dataclass(frozen=True)
class Match:
    """A node that breaks a rule.

    Attributes:
      ns_per_step: about what it costs; None where that is not measured.
      message: what is wrong here, and what to write instead; empty for the rule's.
      instead: functions of the engine, called with the model and the MjData, that do enough in its
        place; none where the call moves out of the loop or is deleted.
      loop: that calls the function of the node in every iteration, or method that calls it in every
        step; None where the node stands in the loop itself.
    """

    node: ast.expr | ast.stmt
    ns_per_step: float | None = None
    message: str = ""
    instead: tuple[str, ...] = ()
    loop: ast.expr | ast.stmt | None = None


Matches = Callable[[SteppingScript], Iterator[Match]]


@dataclass(frozen=True)
class Rule:
    """What is looked for.

    Attributes:
      matches: yields the nodes of a script that break the rule. All of its docstring but the first
        paragraph is the rule's explanation.
      is_wrong_result: whether the program computes or records something else than it says; the
        other rules are about time.
    """

    code: str
    message: str
    matches: Matches
    is_wrong_result: bool = False

    @property
    def title(self) -> str:
        return f"{self.code} ({'wrong result' if self.is_wrong_result else 'time'}): {self.message}"

    @property
    def explanation(self) -> str:
        """What happens, why, what to write instead, and what that changes in results."""
        # from the source, because `python -OO` drops docstrings
        (function,) = ast.parse(inspect.getsource(self.matches)).body
        assert isinstance(function, ast.FunctionDef)
        text = ast.get_docstring(function) or ""
        return text.partition("\n\n")[2] + "\n"


def rule(code: str, message: str, is_wrong_result: bool = False) -> Callable[[Matches], Rule]:
    return lambda matches: Rule(code, message, matches, is_wrong_result)
