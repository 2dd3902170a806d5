"""The release under test against one fixed release, timed in turns in the same minutes.

asv's times are those of one machine on one day. This ratio does not follow the machine's drift, so
releases that were measured months apart can be compared by it. The reference release is installed
in mjbench's cache (see mjbench.releases.installs). `python -m benchmarks.history measure` measures
the same, and keeps every launch. `setup_cache` imports what measures: asv imports this module where
NumPy and MuJoCo alone are installed.
"""

from benchmarks import stored
from benchmarks.history import release_ratios
from benchmarks.history.release_ratios import REFERENCE, RatioRecord
from benchmarks.settings import Cached, Tracked, for_asv
from mjbench.simulation import models
from mjbench.status import Status

# Launches of two processes, in each of which all models are timed: one turn of the schedule of
# placements. `benchmarks.history measure` has two to ten turns.
LAUNCHES = release_ratios.SCHEDULE_LAUNCHES


class Reference(Tracked):
    """Time of a step, as a ratio to that of the reference release; below 1 is faster."""

    params = models.shipped()
    param_names = ("model",)
    version = "4"

    @for_asv(timeout=600)  # the first one installs the reference
    def setup_cache(self) -> dict[str, Cached[float]]:
        """Measure all models in the same launches; return the ratios by model."""
        from benchmarks.history import timing
        from benchmarks.history.tasks import StepTask
        from mjbench.paired.worker_pool import WorkerPool
        from mjbench.releases import release_names

        releases = (
            release_names.parse_release(REFERENCE),
            release_names.parse_release(release_names.INSTALLED),
        )
        cache: dict[str, Cached[float]] = {}
        tasks = []
        for model in self.params:
            try:
                stored.load(model)
                tasks.append(StepTask(releases, models.resolve(model)))
            except NotImplementedError as reason:
                cache[model] = Cached(Status.UNAVAILABLE, str(reason))
        with WorkerPool() as pool:
            records = timing.measure(pool, tasks, LAUNCHES)
        return cache | {record.model: _cached(record) for record in records}

    def setup(self, cache: dict[str, Cached[float]], model: str) -> None:
        """Skip a model that this release cannot load; fail for one that was not measured."""
        cache[model].get()

    @for_asv(
        unit="new/reference", pretty_name=f"time of a step over that of MuJoCo {REFERENCE}, paired"
    )
    def track_ratio_to_reference(self, cache: dict[str, Cached[float]], model: str) -> float:
        """Return the time of a step over the reference release's, a ratio without unit."""
        return cache[model].get()


def _cached(record: RatioRecord) -> Cached[float]:
    ratio = release_ratios.averaged(record.launches)
    if record.status != Status.OK or ratio is None:
        return Cached(record.status, record.detail or "too few launches")
    return Cached(Status.OK, value=ratio.ratio)
