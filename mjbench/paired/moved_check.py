"""Whether libraries can be moved: checked once for each release, by what moved ones do.

A comparison averages over placements of machine code where those of both releases can.
"""

import itertools
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjbench.errors import InputError
from mjbench.host.child_connection import ChildError
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases import movable, placement
from mjbench.releases.moved_install import ImmovableError
from mjbench.releases.placement import AS_SHIPPED, RESIDUES, Placement, PlacementPair
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation import models
from mjbench.simulation.starts import KEYFRAME_STARTS
from mjbench.simulation.workload_sampling import SampleRequest

# A model with many contacts, which most of the engine's loops work on; simulations and steps of it.
_MODEL, _NBATCH, _NSTEP = "pile", 2, 20


def check_movable(pool: WorkerPool, release: ReleaseSpec) -> None:
    """Make sure that a release can be moved: to every residue, and within its page.

    Moved libraries must load, report the version of the release, and step a model to the same
    states to the last bit. A release that passed is not checked again, and one that did not is not
    as long as the pool lasts.

    Raises:
      ImmovableError: it cannot.
    """
    if release.key in pool.immovable:
        raise pool.immovable[release.key]
    try:
        _check(pool, release)
    except ImmovableError as error:
        pool.immovable[release.key] = error
        raise


def _check(pool: WorkerPool, release: ReleaseSpec) -> None:
    install = pool.movable(release)
    if pool.forbids_programs():
        raise ImmovableError("the temporary folder permits no programs: set TMPDIR")
    if movable.was_checked(install):
        return
    rng = random.Random(0)
    placements = [None, *(Placement.draw(residue, rng) for residue in RESIDUES)]
    processes: list[WorkerProcess] = []
    try:
        processes.extend(pool.start(release, placement=placement) for placement in placements)
        _compare(pool, release, processes)
    finally:
        pool.end(processes)
    movable.note_checked(install)


def _compare(pool: WorkerPool, release: ReleaseSpec, processes: Sequence[WorkerProcess]) -> None:
    """Step a model in each process, the first of which is as shipped."""
    source, request = models.resolve(_MODEL), SampleRequest(_NBATCH, _NSTEP, starts=KEYFRAME_STARTS)
    workload, expected = Path(), None
    for process in processes:
        try:
            pool.wait_for(process, release)
            process.call(Worker.load_model, source.name, source.path, {})
            if expected is None:
                workload = pool.save(process.call(Worker.make_workload, request).workload)
            states = process.call(Worker.observe, workload).final_state
        except (InputError, ChildError) as error:
            if expected is not None:
                raise ImmovableError(f"with moved libraries it fails: {error}") from error
            if isinstance(error, ChildError):
                raise
            raise ImmovableError(f"it cannot be checked: {error}") from error
        if expected is None:
            expected = states
        elif not np.array_equal(states, expected):
            raise ImmovableError("with moved libraries it steps to other states")


@dataclass(frozen=True)
class PlacementControl:
    """How the launches of a comparison place the libraries of both targets.

    Attributes:
      averages: whether they average over placements, and do not take the builds as shipped.
      problem: why they cannot; empty where they do, or were not to.
    """

    averages: bool
    problem: str = ""

    def placements(self) -> Iterator[PlacementPair]:
        if self.averages:
            return placement.schedule(random.Random())
        return itertools.repeat(AS_SHIPPED)

    def launches_with(self, judged: int) -> int:
        """Return the number of launches that hold at least `judged` ones for a verdict."""
        return placement.launches_with(judged) if self.averages else judged


def placement_control(
    pool: WorkerPool, baseline: ReleaseSpec, candidate: ReleaseSpec
) -> PlacementControl:
    """Return that placements are averaged, if the libraries of both releases can be moved."""
    for release in (baseline, candidate):
        try:
            check_movable(pool, release)
        except ImmovableError as error:
            problem = f"the code of MuJoCo {release.version} cannot be moved: {error}"
            return PlacementControl(False, problem)
    return PlacementControl(True)
