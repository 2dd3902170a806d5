"""`mj_step`, model by model: time, memory, and whether it was the same work.

Every release starts from the same stored state and replays the same stored controls (see
stored.py), one `mj_step` at a time from Python, in ten simulations of a hundred steps: a
thousand steps, so that milliseconds read as microseconds per step.
"""

import functools
from collections.abc import Callable

from benchmarks import stored
from benchmarks.settings import Timed, Tracked
from mjbench.simulation import models, work


class Step(Timed):
    """A thousand steps."""

    params = stored.light()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Prepare the loop."""
        self.run = stored.prepared("python_loop", (model,)).run

    def time_1000_steps(self, model: str) -> None:
        """Step."""
        self.run()

    time_1000_steps.pretty_name = "1000 × mj_step (ms read as µs per step)"


class HeavyStep(Timed):
    """A hundred steps of the models whose step takes most of a millisecond."""

    params = stored.HEAVY
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Prepare the loop."""
        self.run = stored.prepared("python_loop", (model, stored.NBATCH, stored.HEAVY_NSTEP)).run

    def time_100_steps(self, model: str) -> None:
        """Step."""
        self.run()

    time_100_steps.pretty_name = "100 × mj_step, heavy models"


class Memory(Tracked):
    """The most memory that a process needs that loads a model and steps it."""

    params = models.shipped()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Prepare the loop."""
        self.run: Callable[[], None] = stored.prepared("python_loop", _sizes(model)).run

    def peakmem_stepping(self, model: str) -> None:
        """Step."""
        self.run()

    peakmem_stepping.pretty_name = "peak memory of load and step"


class Work(Tracked):
    """What a step does. Where these change, a change of time is not one of the code alone."""

    params = models.shipped()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Count."""
        self.work = _work(model)

    def track_contacts(self, model: str) -> float:
        """Count contacts."""
        return self.work.contacts

    def track_constraints(self, model: str) -> float:
        """Count scalar constraints."""
        return self.work.constraints

    def track_solver_iterations(self, model: str) -> float:
        """Count iterations, summed over islands."""
        return self.work.solver_iterations

    track_contacts.unit = "contacts/step"
    track_contacts.pretty_name = "contacts per step"
    track_constraints.unit = "constraints/step"
    track_constraints.pretty_name = "constraints per step"
    track_solver_iterations.unit = "iterations/step"
    track_solver_iterations.pretty_name = "solver iterations per step"


@functools.cache
def _work(model: str) -> work.Work:
    return work.observe(stored.stored_workload(*_sizes(model))).work


class Drift(Tracked):
    """How far one step from stored states leads from the release that stored them."""

    params = models.shipped()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Load."""
        stored.load(model)

    def track_drift(self, model: str) -> float:
        """Compare."""
        return stored.drift(model)

    track_drift.unit = "SI"
    track_drift.pretty_name = "largest difference of qpos, qvel, act after one step"


def _sizes(model: str) -> tuple[str, int, int]:
    return model, stored.NBATCH, stored.HEAVY_NSTEP if model in stored.HEAVY else stored.NSTEP
