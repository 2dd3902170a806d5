"""The release at hand against one fixed release, paired in the same minutes.

asv's times are those of a machine on a day; this ratio is not bent by the machine's drift, so that
releases measured months apart can be compared. The reference is installed beside, in mjbench's
cache (see mjbench.releases.installs).
"""

import numpy as np

from benchmarks import stored
from benchmarks.settings import Tracked
from mjbench.instrument import stats
from mjbench.paired.protocol import Target, TargetPair
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation import models

REFERENCE = "4.0.0"
# Launches vary by 0.5 to 0.9 %: the mean of these by about a quarter of a percent.
LAUNCHES = 8


class Reference(Tracked):
    """Time of a step over the time of the reference release's; below 1 is faster."""

    params = models.shipped()
    param_names = ("model",)
    timeout = 300  # the first one installs the reference
    version = "2"

    def setup(self, model: str) -> None:
        """See whether this release can load the model."""
        stored.load(model)

    def track_ratio_to_reference(self, model: str) -> float:
        """Compare."""
        source = models.resolve(model)
        reference = Target(installs.parse_release(REFERENCE), source)
        here = Target(installs.parse_release(installs.INSTALLED), source)
        with WorkerPool() as pool:
            pair = TargetPair(pool, reference, here)
            values = [pair.launch().value for _ in range(LAUNCHES)]
            pair.close()
        return float(np.exp(stats.anytime_interval(values, 0.99).mean))

    track_ratio_to_reference.unit = "new/reference"
    track_ratio_to_reference.pretty_name = f"time of a step over that of MuJoCo {REFERENCE}, paired"
