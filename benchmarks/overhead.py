"""What a Python loop adds to `mj_step`: each habit inside a stepping loop (mjbench.loop.habits)."""

import functools
from collections.abc import Callable

from benchmarks import stored
from benchmarks.settings import Timed
from mjbench.loop import habits
from mjbench.simulation import models

NSTEP = 1000


@functools.cache
def _loop(source: str, model: str) -> Callable[[], None]:
    found, opened = habits.find(source), stored.load(model)
    file = str(models.resolve(model).path)
    if not habits.available(found, opened, file):
        raise NotImplementedError(f"{source}: not with this model or release")
    return habits.loop(found, opened, NSTEP, file).run


class Overhead(Timed):
    """A thousand steps with one habit in the loop; subtract the bare loop."""

    # a step as short as the cart-pole's, beside which a habit of 100 ns can be seen
    params = ([source.name for source in habits.HABITS], ["cartpole"])
    param_names = ("source", "model")

    def setup(self, source: str, model: str) -> None:
        """Compile the loop."""
        self.run = _loop(source, model)

    def time_1000_steps(self, source: str, model: str) -> None:
        """Step."""
        self.run()

    time_1000_steps.pretty_name = "1000 × mj_step with a habit in the loop"
