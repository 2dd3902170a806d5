"""Whether a comparison averages over placements of machine code, and why it does not."""

import itertools
import random
from collections.abc import Iterator
from dataclasses import dataclass

from mjbench.paired import moved_check
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import placement
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.moved_image import ImmovableError
from mjbench.releases.placement import AS_SHIPPED, PlacementPair


@dataclass(frozen=True)
class Averaging:
    """How the launches of a comparison place the libraries of both targets.

    Attributes:
      is_on: whether they are moved from launch to launch.
      problem: why they cannot be; empty where they are, or were not to be.
    """

    is_on: bool
    problem: str = ""

    def placements(self) -> Iterator[PlacementPair]:
        """Return the placements of one launch after the other."""
        if self.is_on:
            return placement.schedule(random.Random())
        return itertools.repeat(AS_SHIPPED)

    def launches_with(self, judged: int) -> int:
        """Return the number of launches that hold at least `judged` ones for a verdict."""
        return placement.launches_with(judged) if self.is_on else judged


def averaging(pool: WorkerPool, baseline: ReleaseSpec, candidate: ReleaseSpec) -> Averaging:
    """Return that placements are averaged, if the libraries of both releases can be moved.

    Raises:
      InputError: a release does not exist.
      MachineError: a release cannot be installed.
    """
    for release in (baseline, candidate):
        try:
            moved_check.check(pool, release)
        except ImmovableError as error:
            problem = f"the code of MuJoCo {release.version} cannot be moved: {error}"
            return Averaging(False, problem)
    return Averaging(True)
