"""Instructions of a step, counted by Callgrind: exact, whatever else the machine does.

One process under Callgrind counts all models of a release, each over its stored start states and
controls (see mjbench.instructions).
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench import installs, models, workload
from mjbench import instructions as room

# Simulations of each model; Callgrind runs some fifty times slower than the processor.
NBATCH = 2
# Begins what is told of a model that could not be counted although the release can load it.
FAILED = "failed: "


class Instructions(Tracked):
    """Instructions of one step."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 600

    def setup_cache(self) -> dict[str, float | str]:
        """Count; return instructions per step by model, or why there is no count."""
        problem = room.unavailable()
        if problem:
            return dict.fromkeys(models.shipped(), problem)
        found: dict[str, float | str] = {}
        with tempfile.TemporaryDirectory() as folder:
            names = []
            for name in models.shipped():
                try:
                    _write(name, Path(folder) / f"{len(names)}.npz")
                    names.append(name)
                except NotImplementedError as reason:
                    found[name] = str(reason)
            sources = [models.resolve(name) for name in names]
            here = installs.wanted(installs.HERE)
            for count in room.count(here, sources, given=Path(folder)):
                if count.instructions_per_step is None:
                    found[count.model] = f"{FAILED}{count.detail}"
                else:
                    found[count.model] = count.instructions_per_step
        return found

    setup_cache.timeout = 600  # type: ignore[attr-defined]

    def setup(self, counts: dict[str, float | str], model: str) -> None:
        """See whether the model was counted."""
        found = counts[model]
        if isinstance(found, str):
            raise (RuntimeError if found.startswith(FAILED) else NotImplementedError)(found)

    def track_instructions_per_step(self, counts: dict[str, float | str], model: str) -> float:
        """Tell."""
        return float(counts[model])

    track_instructions_per_step.unit = "instructions/step"
    track_instructions_per_step.pretty_name = "instructions per step"


def _write(name: str, file: Path) -> None:
    """Write the stored workload of a model as mjbench.counted reads it."""
    nstep = stored.HEAVY_NSTEP if name in stored.HEAVY else stored.NSTEP
    made = stored.stored_workload(name, NBATCH, nstep)
    fields = workload.fields(made.model, made.initial_state)
    np.savez(file, control=made.control, hold=made.hold, **fields)
