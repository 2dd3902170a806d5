"""What a Python loop adds to `mj_step`: each habit of `commands/profile/habits.py` in a loop."""

import functools
from collections.abc import Callable

from benchmarks import stored
from benchmarks.settings import Timed, for_asv
from mjbench.commands.profile import habits
from mjbench.simulation import models

NSTEP = 1000


@functools.cache
def _loop(habit_name: str, model_name: str) -> Callable[[], None]:
    """Return a run of the loop with a habit in it; compiled once in a process.

    Raises:
      NotImplementedError: the release or the model lacks what the habit needs.
    """
    habit, model = habits.BY_NAME[habit_name], stored.load(model_name)
    file = str(models.resolve(model_name).path)
    if not habit.requires(model, file):
        raise NotImplementedError(f"{habit_name}: not with this model or release")
    return habits.compile_loop(habit, model, NSTEP, file).run


class Overhead(Timed):
    """Seconds of a thousand steps of a Python loop with one habit in it.

    A habit's cost is the difference from `bare loop`.
    """

    # a step as short as the cart-pole's, beside which a habit of 100 ns can be seen
    params = ([habit.name for habit in habits.HABITS], ["cartpole"])
    # `source` is the habit: committed results have this name
    param_names = ("source", "model")

    def setup(self, source: str, model: str) -> None:
        """Compile the loop with the habit."""
        self.run = _loop(source, model)

    @for_asv(pretty_name="1000 × mj_step with a habit in the loop")
    def time_1000_steps(self, source: str, model: str) -> None:
        """Reset to the start state, and step 1000 times with the habit after each step."""
        self.run()
