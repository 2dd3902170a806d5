"""What a rule of `mjbench lint` yields."""

import ast
from dataclasses import dataclass


@dataclass(frozen=True)
class Match:
    """A node that breaks a rule.

    Attributes:
      node: where the finding points.
      habit: that costs about as much in each step; empty where the rule is not about time.
      message: what is wrong here, and what to write instead; empty for the rule's.
      callee: what is called, such as "mj_forward"; empty where the rule is not about a call.
      instead: functions of the engine, called with the model and the MjData, that do enough in its
        place; none where the call moves out of the loop or is deleted.
      loop: that calls the function of the node in every iteration; None where the node stands in
        the loop itself.
    """

    node: ast.expr | ast.stmt
    habit: str = ""
    message: str = ""
    callee: str = ""
    instead: tuple[str, ...] = ()
    loop: ast.expr | ast.stmt | None = None
