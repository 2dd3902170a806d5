"""How far runs of one model are from runs of another, in its own units and as a share of motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import AnyFloat
from mjbench.commands.tune.trajectories import Trajectories

# Motion that is smaller, in m or rad, counts as this much: errors of a model at rest are small.
LEAST_MOTION = 1e-2
# Runs of which an error is said to hold.
SHARE = 0.9
# Of `bound`.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Units:
    """A length and an angle of the degrees of freedom; None where there are none.

    Attributes:
      m: of slides and of the positions of free bodies.
      rad: of hinges, balls and the orientations of free bodies.
    """

    m: AnyFloat | None
    rad: AnyFloat | None

    def larger(self, other: "Units") -> "Units":
        pairs = (self.m, other.m), (self.rad, other.rad)
        return Units(*(None if a is None or b is None else max(a, b) for a, b in pairs))


@dataclass(frozen=True)
class Distance:
    """How far runs are apart: what nine runs in ten do not exceed (see `bound`).

    Each run counts with its largest distance at any time, a root mean square over the degrees of
    freedom of a unit.

    Attributes:
      share: of positions, as a share of the motion; the larger of the two units.
      position: in m and rad.
    """

    share: AnyFloat
    position: Units

    def larger(self, other: "Distance") -> "Distance":
        return Distance(max(self.share, other.share), self.position.larger(other.position))


@dataclass(frozen=True, eq=False)
class Motion:
    """How far a model moves: what distances are a share of.

    Attributes:
      is_rad: (nv,) bool: which degrees of freedom are angles.
      position: root mean square over runs of the farthest distance from the start, in m and rad.
    """

    is_rad: np.ndarray
    position: Units


def motion(model: mujoco.MjModel, initial_qpos: np.ndarray, runs: Trajectories) -> Motion:
    """Return how far a model moves from (nrun, nq) initial positions."""
    is_rad = angular(model)
    moved = _position_errors(model, np.repeat(initial_qpos[:, None], runs.qpos.shape[1], 1), runs)
    per_run = _largest_rms(moved, is_rad)
    rms = (None if v is None else float(np.sqrt(np.mean(v**2))) for v in per_run)
    return Motion(is_rad, Units(*rms))


def angular(model: mujoco.MjModel) -> np.ndarray:
    """Return (nv,) bool: which degrees of freedom are angles."""
    is_rad = np.zeros(model.nv, dtype=bool)
    for kind, address in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            is_rad[address + 3 : address + 6] = True
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            is_rad[address : address + 3] = True
        elif kind == mujoco.mjtJoint.mjJNT_HINGE:
            is_rad[address] = True
    return is_rad


def shares_over_time(
    model: mujoco.MjModel, scale: Motion, runs: Trajectories, reference: Trajectories
) -> np.ndarray:
    """Return (nrun, ncontrol) distances of positions at the end of each control, as shares."""
    errors = _position_errors(model, reference.qpos, runs)
    return _share(scale, _rms_by_unit(errors, scale.is_rad))


def bounds_over_time(
    model: mujoco.MjModel, scale: Motion, runs: Trajectories, reference: Trajectories
) -> np.ndarray:
    """Return (ncontrol,) what nine runs in ten do not exceed at the end of each control."""
    return np.array([bound(column) for column in shares_over_time(model, scale, runs, reference).T])


def shares(
    model: mujoco.MjModel, scale: Motion, runs: Trajectories, reference: Trajectories
) -> np.ndarray:
    """Return (nrun,) largest distances of positions at any time, as shares of the motion."""
    return np.asarray(np.max(shares_over_time(model, scale, runs, reference), axis=1))


def distance(
    model: mujoco.MjModel, scale: Motion, runs: Trajectories, reference: Trajectories
) -> Distance:
    position = _largest_rms(_position_errors(model, reference.qpos, runs), scale.is_rad)
    return Distance(
        bound(shares(model, scale, runs, reference)),
        Units(*(None if v is None else bound(v) for v in position)),
    )


def bound(values: np.ndarray) -> float:
    """Return what nine of ten values do not exceed, with a confidence of CONFIDENCE.

    It is the k-th smallest of n, the first for which the quantile 0.9 is smaller with that
    probability: the number of values below a quantile has a binomial distribution (Conover,
    Practical Nonparametric Statistics, 1999, section 3.3). With fewer than 29 values it is the
    largest, and the confidence is less.
    """
    ordered = np.sort(values)
    n, below = len(ordered), 0.0
    for k in range(1, n + 1):
        below += math.comb(n, k - 1) * SHARE ** (k - 1) * (1 - SHARE) ** (n - k + 1)
        if below >= CONFIDENCE:
            return float(ordered[k - 1])
    return float(ordered[-1])


def _position_errors(
    model: mujoco.MjModel, reference_qpos: np.ndarray, runs: Trajectories
) -> np.ndarray:
    """Return (nrun, ncontrol, nv) differences of positions, in tangent space."""
    errors = np.empty(runs.qvel.shape)
    out = np.empty(model.nv)
    for row in np.ndindex(errors.shape[:2]):
        mujoco.mj_differentiatePos(model, out, 1.0, reference_qpos[row], runs.qpos[row])
        errors[row] = out
    return errors


def _rms_by_unit(errors: np.ndarray, is_rad: np.ndarray) -> list[np.ndarray | None]:
    """Return (nrun, ncontrol) root mean squares over the degrees of freedom in m and in rad."""
    return [
        np.sqrt(np.mean(errors[..., mask] ** 2, axis=-1)) if mask.any() else None
        for mask in (~is_rad, is_rad)
    ]


def _largest_rms(errors: np.ndarray, is_rad: np.ndarray) -> list[np.ndarray | None]:
    """Return (nrun,) the largest of these over time."""
    return [None if rms is None else rms.max(axis=1) for rms in _rms_by_unit(errors, is_rad)]


def _share(scale: Motion, rms: Sequence[np.ndarray | None]) -> np.ndarray:
    """Return distances as shares of the motion: the larger of the two units."""
    shares = [
        values / max(moved or 0.0, LEAST_MOTION)
        for values, moved in zip(rms, (scale.position.m, scale.position.rad), strict=True)
        if values is not None
    ]
    return np.asarray(np.max(shares, axis=0))
