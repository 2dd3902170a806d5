"""`mjbench run` in this process, with brief measurements after the program has ended."""

import inline_tasks
import pytest

from mjbench.commands.profile import step_parts
from mjbench.commands.run.remedies import remedy_pairs
from mjbench.host import isolate


def measure_briefly(patch: pytest.MonkeyPatch) -> None:
    """Time parts of steps and remedies in the fewest rounds, in this process."""
    patch.setattr(isolate, "run", inline_tasks.run)
    for module in (step_parts, remedy_pairs):
        patch.setattr(module, "MOST_ROUNDS", module.LEAST_ROUNDS)
