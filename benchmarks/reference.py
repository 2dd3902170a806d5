"""The release under test against one fixed release, timed in turns in the same minutes.

asv's times are those of one machine on one day. This ratio does not follow the machine's drift, so
releases that were measured months apart can be compared by it. The reference release is installed
in mjbench's cache (see mjbench.releases.installs). `mjbench history measure` measures the same, and
keeps every launch.
"""

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench.paired import release_ratio
from mjbench.paired.release_tasks import StepTask
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs, release_ratios
from mjbench.releases.release_ratios import REFERENCE
from mjbench.simulation import models
from mjbench.status import Status


class Reference(Tracked):
    """Time of a step, as a ratio to that of the reference release; below 1 is faster."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 300  # the first one installs the reference
    version = "4"

    def setup(self, model: str) -> None:
        """Skip models that this release cannot load."""
        stored.load(model)

    def track_ratio_to_reference(self, model: str) -> float:
        """Return the time of a step over the reference release's, a ratio without unit."""
        releases = (
            installs.parse_release(REFERENCE),
            installs.parse_release(installs.INSTALLED),
        )
        task = StepTask(releases, models.resolve(model))
        with WorkerPool() as pool:
            (record,) = release_ratio.measure(pool, [task])
        ratio = release_ratios.averaged(record.launches)
        if record.status != Status.OK or ratio is None:
            raise RuntimeError(record.detail)
        return ratio.ratio

    track_ratio_to_reference.unit = "new/reference"
    track_ratio_to_reference.pretty_name = f"time of a step over that of MuJoCo {REFERENCE}, paired"
