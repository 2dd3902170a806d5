"""Do two targets compute the same? They step from the same states at several points of a run.

Who draws a workload records states along some of its simulations: the *probe*. Each target then
takes one step from every state of the probe. Rounding cannot grow in one step, so a difference
there is a change of what a step computes. Each target also runs these simulations freely; how far
such runs drift apart says little, because contact multiplies any difference of rounding.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjbench.bounds import AnyFloat, NonNegativeInt
from mjbench.simulation import agreement, workload
from mjbench.simulation.reference_run import states_after
from mjbench.simulation.workload import PortableWorkload, Workload

# Simulations that are recorded, at most: the first ones of the workload.
NPROBE = 8
# At these shares of the run states are recorded.
_POINTS = (0.0, 0.25, 0.5, 0.75, 1.0)

Fields = Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Followed:
    """What a target did from the states of a probe.

    Attributes:
      nsteps: number of steps before each point of the run.
      run: qpos, qvel and act of its own run, each (npoint, nprobe, size).
      stepped: the same, one step after each state of the probe.
    """

    nsteps: Sequence[int]
    run: Fields
    stepped: Fields


@dataclass(frozen=True)
class RunDrift:
    """How far two runs from the same starts are apart.

    Attributes:
      difference: the largest of qpos, qvel and act (see `StateDrift`).
    """

    step: NonNegativeInt
    difference: AnyFloat


@dataclass(frozen=True)
class StateDrift:
    """How far two targets differ, in units of `agreement.field_scales` of the baseline's run.

    Attributes:
      one_step: the largest after one step from the same states, at any point of the run.
      runs: differences of free runs, at each point after the start.
    """

    one_step: float
    runs: Sequence[RunDrift] = ()


def points(nstep: int) -> list[int]:
    return sorted({round(share * nstep) for share in _POINTS})


def probe(drawn: Workload) -> Fields:
    """Return states along a workload by MjData field, each (npoint * nprobe, size)."""
    states = states_after(_probed(drawn), points(drawn.nstep))
    return workload.fields(drawn.model, states.reshape(-1, states.shape[2]))


def portable(drawn: Workload) -> PortableWorkload:
    return dataclasses.replace(workload.portable(drawn), probe=probe(drawn))


def follow(own: Workload, probe: Fields) -> Followed:
    model, nsteps = own.model, points(own.nstep)
    states = states_after(_probed(own), nsteps)
    run = workload.fields(model, states.reshape(-1, states.shape[2]))
    stepped = workload.fields(model, workload.stepped(model, workload.states(model, probe)))
    compared = [field for field in ("qpos", "qvel", "act") if field in stepped]

    def by_point(rows: np.ndarray) -> np.ndarray:
        return rows.reshape(len(nsteps), -1, rows.shape[1])

    return Followed(
        nsteps,
        {field: by_point(run[field]) for field in compared},
        {field: by_point(stepped[field]) for field in compared},
    )


def drift(
    baseline: Followed, candidate: Followed, is_compared: np.ndarray, start_alike: bool = True
) -> StateDrift | None:
    """Return how far two targets differ; None where their states differ in size.

    Args:
      is_compared: (nbatch,) bool, the simulations that diverge in neither.
      start_alike: whether their runs begin in the same states; otherwise runs are not compared.
    """
    if _shapes(baseline) != _shapes(candidate):
        return None
    nprobe = next(iter(baseline.stepped.values())).shape[1]
    keep = np.flatnonzero(is_compared[:nprobe])
    scales = agreement.field_scales(baseline.run)

    kept = np.s_[:, keep]
    one_step = agreement.drift(_of(candidate.stepped, kept), _of(baseline.stepped, kept), scales)
    runs = []
    for i, nstep in enumerate(baseline.nsteps):
        if start_alike and nstep > 0:
            after, reference = _of(candidate.run, (i, keep)), _of(baseline.run, (i, keep))
            runs.append(RunDrift(nstep, agreement.drift(after, reference, scales)))
    return StateDrift(one_step, tuple(runs))


def _probed(drawn: Workload) -> Workload:
    return drawn.only(np.arange(drawn.nbatch) < NPROBE)


def _of(fields: Fields, rows: tuple[Any, ...]) -> Fields:
    return {field: values[rows] for field, values in fields.items()}


def _shapes(followed: Followed) -> Mapping[str, tuple[int, ...]]:
    return {field: values.shape for field, values in followed.stepped.items()}
