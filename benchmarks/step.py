"""`mj_step` by model: its time, its memory, and what it computed.

Every release starts from the same stored states and applies the same stored controls (see
stored.py), one `mj_step` call at a time from Python. Ten simulations of a hundred steps make a
thousand steps, so milliseconds per call read as microseconds per step.
"""

import dataclasses
from collections.abc import Callable

from benchmarks import stored
from benchmarks.settings import Cached, Timed, Tracked, for_asv
from mjbench.errors import describe
from mjbench.simulation import models, reference_run
from mjbench.status import Status


class Step(Timed):
    """Time of 1000 calls of `mj_step`, in seconds, for models with a short step."""

    params = stored.light()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Prepare the loop, and compare its final states with the reference run's."""
        self.run = stored.prepared_run("python_loop", model).run

    @for_asv(pretty_name="1000 × mj_step (ms read as µs per step)")
    def time_1000_steps(self, model: str) -> None:
        """Step 10 simulations 100 times each, in seconds."""
        self.run()


class HeavyStep(Timed):
    """Time of 100 calls of `mj_step`, in seconds, for models whose step takes about 1 ms."""

    params = stored.HEAVY
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Prepare the loop, and compare its final states with the reference run's."""
        self.run = stored.prepared_run("python_loop", model, nstep=stored.HEAVY_NSTEP).run

    @for_asv(pretty_name="100 × mj_step, heavy models")
    def time_100_steps(self, model: str) -> None:
        """Step 10 simulations 10 times each, in seconds."""
        self.run()


class Memory(Tracked):
    """Peak memory of a process that loads a model and steps it, in bytes."""

    params = models.shipped()
    param_names = ("model",)
    version = "2"  # of a process that is forked, which takes 0 to 6 % less

    def setup(self, model: str) -> None:
        """Load the model and prepare the loop."""
        nstep = stored.nstep_of(model)
        self.run: Callable[[], None] = stored.prepared_run("python_loop", model, nstep=nstep).run

    @for_asv(pretty_name="peak memory of load and step")
    def peakmem_stepping(self, model: str) -> None:
        """Step the stored workload; asv reads the peak memory of the process, in bytes."""
        self.run()


class Work(Tracked):
    """What a step computes on average, counted over the stored workload.

    Where a count differs between releases, so does the work: a change of time there is not one of
    the code alone.
    """

    params = models.shipped()
    param_names = ("model",)

    @for_asv(timeout=300)
    def setup_cache(self) -> dict[str, Cached[reference_run.Work]]:
        """Step the stored workload of each model once, counting."""
        return {model: _counted(model) for model in self.params}

    def setup(self, cache: dict[str, Cached[reference_run.Work]], model: str) -> None:
        """Skip a model that this release cannot load."""
        cache[model].get()

    @for_asv(unit="contacts/step", pretty_name="contacts per step")
    def track_contacts(self, cache: dict[str, Cached[reference_run.Work]], model: str) -> float:
        """Return contacts (`data.ncon`) per step."""
        return cache[model].get().contacts

    @for_asv(unit="constraints/step", pretty_name="constraints per step")
    def track_constraints(self, cache: dict[str, Cached[reference_run.Work]], model: str) -> float:
        """Return scalar constraints (`data.nefc`) per step."""
        return cache[model].get().constraints

    @for_asv(unit="iterations/step", pretty_name="solver iterations per step")
    def track_solver_iterations(
        self, cache: dict[str, Cached[reference_run.Work]], model: str
    ) -> float:
        """Return solver iterations per step, summed over constraint islands."""
        return cache[model].get().solver_iterations


def _counted(model: str) -> Cached[reference_run.Work]:
    """Return the work with solver iterations summed over islands, as all stored results have it."""
    try:
        observation = reference_run.observe(
            stored.stored_workload(model, nstep=stored.nstep_of(model))
        )
    except NotImplementedError as reason:
        return Cached(Status.UNAVAILABLE, str(reason))
    except Exception as error:  # of one model, which must not cost the others theirs
        return Cached(Status.FAILED, describe(error))
    iterations = observation.summed_iterations
    return Cached(
        Status.OK, value=dataclasses.replace(observation.work, solver_iterations=iterations)
    )


class Drift(Tracked):
    """Whether a step computes the same result as in the release that stored the states."""

    params = models.shipped()
    param_names = ("model",)

    def setup(self, model: str) -> None:
        """Check that this release can load the model."""
        stored.load(model)

    @for_asv(unit="SI", pretty_name="largest difference of qpos, qvel, act after one step")
    def track_drift(self, model: str) -> float:
        """Return the largest difference of qpos, qvel and act after one step, in SI units."""
        return stored.drift(model)
