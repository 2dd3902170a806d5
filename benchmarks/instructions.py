"""Instructions of a step, counted by Callgrind: exact, whatever else the machine does.

One process under Callgrind counts all models, each over its stored start states and controls (see
mjbench.counts.instructions).
"""

import pickle
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench.counts.instructions import InstructionCounter, ModelCount, unavailable
from mjbench.releases import installs
from mjbench.simulation import models, workload
from mjbench.status import Status

# Simulations of each model; Callgrind runs some fifty times slower than the processor.
NBATCH = 2


@dataclass(frozen=True)
class CachedCount:
    """What `setup_cache` hands to each model's process; asv pickles it.

    Attributes:
      status: `ok`, `unavailable` where this release or machine cannot count, or `failed`.
      instructions_per_step: of the engine; 0 unless ok.
    """

    status: Status
    detail: str = ""
    instructions_per_step: float = 0.0


class Instructions(Tracked):
    """Instructions that `mj_step` executes, with all that it calls, per step."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 600

    def setup_cache(self) -> dict[str, CachedCount]:
        """Count all models at once; return the counts by model."""
        problem = unavailable()
        if problem:
            return dict.fromkeys(models.shipped(), CachedCount(Status.UNAVAILABLE, problem))
        cache: dict[str, CachedCount] = {}
        with tempfile.TemporaryDirectory() as folder, InstructionCounter() as counter:
            sources = []
            for name in models.shipped():
                source = models.resolve(name)
                try:
                    counter.use_workload(source, _write_workload(name, Path(folder)))
                    sources.append(source)
                except NotImplementedError as reason:
                    cache[name] = CachedCount(Status.UNAVAILABLE, str(reason))
            for count in counter.count(installs.parse_release(installs.INSTALLED), sources):
                cache[count.model] = _cached(count)
        return cache

    setup_cache.timeout = 600  # type: ignore[attr-defined]

    def setup(self, cache: dict[str, CachedCount], model: str) -> None:
        """Skip a model that cannot be counted; fail for one that should have been."""
        count = cache[model]
        if count.status == Status.UNAVAILABLE:
            raise NotImplementedError(count.detail)
        if count.status != Status.OK:
            raise RuntimeError(count.detail)

    def track_instructions_per_step(self, cache: dict[str, CachedCount], model: str) -> float:
        """Return the engine's instructions per step, a mean over all steps of all simulations."""
        return cache[model].instructions_per_step

    track_instructions_per_step.unit = "instructions/step"
    track_instructions_per_step.pretty_name = "instructions per step"


def _cached(count: ModelCount) -> CachedCount:
    if count.instructions_per_step is None:
        return CachedCount(Status.FAILED, count.detail)
    return CachedCount(Status.OK, instructions_per_step=count.instructions_per_step)


def _write_workload(name: str, folder: Path) -> Path:
    """Write the stored workload of a model to a file; return the file."""
    nstep = stored.nstep_of(name)
    file = folder / f"{name}.pickle"
    file.write_bytes(pickle.dumps(workload.portable(stored.stored_workload(name, NBATCH, nstep))))
    return file
