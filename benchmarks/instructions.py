"""Instructions of a step, counted by Callgrind: exact, whatever else the machine does.

Two processes under Callgrind, side by side, count half of the models each, over stored start states
and controls (see mjbench.counts.instructions). `setup_cache` imports what counts them: asv imports
this module where NumPy and MuJoCo alone are installed.
"""

import pickle
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import stored
from benchmarks.settings import Cached, Tracked, for_asv
from mjbench.simulation import models, workload
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.counts.instructions import ModelCount

# Simulations of each model; Callgrind runs some fifty times slower than the processor.
NBATCH = 2


class Instructions(Tracked):
    """Instructions that `mj_step` executes, with all that it calls, per step."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 600

    @for_asv(timeout=600)
    def setup_cache(self) -> dict[str, Cached[float]]:
        """Count all models at once; return the counts by model."""
        from mjbench.counts import instructions
        from mjbench.releases import release_names

        problem = instructions.unavailable()
        if problem:
            return dict.fromkeys(self.params, Cached(Status.UNAVAILABLE, problem))
        cache: dict[str, Cached[float]] = {}
        with tempfile.TemporaryDirectory() as folder, instructions.InstructionCounter() as counter:
            sources = []
            for name in self.params:
                source = models.resolve(name)
                try:
                    counter.use_workload(source, _write_workload(name, Path(folder)))
                    sources.append(source)
                except NotImplementedError as reason:
                    cache[name] = Cached(Status.UNAVAILABLE, str(reason))
            release = release_names.parse_release(release_names.INSTALLED)
            halves = sources[::2], sources[1::2]
            with ThreadPoolExecutor(len(halves)) as pool:
                for counts in pool.map(lambda half: list(counter.count(release, half)), halves):
                    cache |= {count.model: _cached(count) for count in counts}
        return cache

    def setup(self, cache: dict[str, Cached[float]], model: str) -> None:
        """Skip a model that cannot be counted; fail for one that should have been."""
        cache[model].get()

    @for_asv(unit="instructions/step", pretty_name="instructions per step")
    def track_instructions_per_step(self, cache: dict[str, Cached[float]], model: str) -> float:
        """Return the engine's instructions per step, a mean over all steps of all simulations."""
        return cache[model].get()


def _cached(count: "ModelCount") -> Cached[float]:
    if count.instructions_per_step is None:
        return Cached(Status.FAILED, count.detail)
    return Cached(Status.OK, value=count.instructions_per_step)


def _write_workload(name: str, folder: Path) -> Path:
    """Write the stored workload of a model to a file; return the file."""
    nstep = stored.nstep_of(name)
    file = folder / f"{name}.pickle"
    file.write_bytes(pickle.dumps(workload.portable(stored.stored_workload(name, NBATCH, nstep))))
    return file
