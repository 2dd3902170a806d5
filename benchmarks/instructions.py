"""Instructions of a step, counted by Callgrind: exact, whatever else the machine does.

One process under Callgrind counts all models of a release, each over its stored start states and
controls (see mjbench.counts.instructions).
"""

import pickle
import tempfile
from pathlib import Path

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench.counts import instructions as room
from mjbench.releases import installs
from mjbench.simulation import models, workload

# Simulations of each model; Callgrind runs some fifty times slower than the processor.
NBATCH = 2


class Instructions(Tracked):
    """Instructions of one step."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 600

    def setup_cache(self) -> dict[str, tuple[str, float | str]]:
        """Count; return, by model, (`ok`, instructions per step), or how and why not.

        It is (`unable`, …) where this release or machine cannot, (`failed`, …) where it should.
        """
        problem = room.unavailable()
        if problem:
            return dict.fromkeys(models.shipped(), ("unable", problem))
        found: dict[str, tuple[str, float | str]] = {}
        with tempfile.TemporaryDirectory() as folder, room.Counter() as counter:
            sources = []
            for name in models.shipped():
                source = models.resolve(name)
                try:
                    counter.give(source, _write(name, Path(folder)))
                    sources.append(source)
                except NotImplementedError as reason:
                    found[name] = ("unable", str(reason))
            for count in counter.count(installs.parse_release(installs.INSTALLED), sources):
                if count.instructions_per_step is None:
                    found[count.model] = ("failed", count.detail)
                else:
                    found[count.model] = ("ok", count.instructions_per_step)
        return found

    setup_cache.timeout = 600  # type: ignore[attr-defined]

    def setup(self, counts: dict[str, tuple[str, float | str]], model: str) -> None:
        """See whether the model was counted."""
        status, found = counts[model]
        if status != "ok":
            raise (RuntimeError if status == "failed" else NotImplementedError)(found)

    def track_instructions_per_step(
        self, counts: dict[str, tuple[str, float | str]], model: str
    ) -> float:
        """Tell."""
        return float(counts[model][1])

    track_instructions_per_step.unit = "instructions/step"
    track_instructions_per_step.pretty_name = "instructions per step"


def _write(name: str, folder: Path) -> Path:
    """Write the stored workload of a model to a file; return it."""
    nstep = stored.HEAVY_NSTEP if name in stored.HEAVY else stored.NSTEP
    made = stored.stored_workload(name, NBATCH, nstep)
    file = folder / f"{name}.pickle"
    file.write_bytes(pickle.dumps(workload.portable(made)))
    return file
