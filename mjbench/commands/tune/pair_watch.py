"""Watch which bodies touch while a model is stepped, and how close the others come."""

from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat, geom_pairs

# Distances that are computed at most: a pair of meshes takes some 10 µs.
_MAX_DISTANCES = 20_000
# Pairs whose bounding spheres are compared at most, in all samples together.
_MAX_GAPS = 20_000_000
# Distances are computed up to this many metres.
_FAR_M = 1000.0


@dataclass(frozen=True)
class IdlePair:
    """Two bodies that collision detection tested in detail, and that never touched.

    Attributes:
      closest_m: the shortest distance seen; None where none was computed, as in old releases.
    """

    body1: str
    body2: str
    closest_m: float | None


class PairWatch:
    """Which bodies touched, of those whose joints bound how they can lie to each other.

    A pair that comes out of the filters is tested in detail about where both the bounding spheres
    and the axis-aligned boxes of two geoms overlap, which `sample` looks for: only these pairs cost
    anything that an exclusion saves. Bodies that can go anywhere, such as loose objects, are left
    out: that two did not meet yet says nothing.
    """

    def __init__(self, model: mujoco.MjModel, nsample: int):
        pairs = geom_pairs.read(model)
        self._model = model
        self._pairs = pairs.only(pairs.are_bounded)
        self._keys = self._pairs.bodies[:, 0] * model.nbody + self._pairs.bodies[:, 1]
        self._was_near = np.zeros(len(self._keys), dtype=bool)
        self._closest_m = np.full(len(self._keys), np.inf)
        self._touched: set[int] = set()
        self._max_distances = max(1, _MAX_DISTANCES // max(1, nsample))
        self._calls, self._every = 0, 1 + nsample * len(self._keys) // _MAX_GAPS

    def contacts(self, data: mujoco.MjData) -> None:
        """Take the contacts of a step; one within its margin counts."""
        if not data.ncon or not len(self._keys):
            return
        contact = data.contact
        geoms = np.stack([np.asarray(contact.geom1), np.asarray(contact.geom2)], axis=1)
        geoms = geoms[(geoms >= 0).all(axis=1)]  # the others are of a flex
        bodies = np.sort(np.asarray(self._model.geom_bodyid)[geoms], axis=1)
        self._touched.update((bodies[:, 0] * self._model.nbody + bodies[:, 1]).tolist())

    def sample(self, data: mujoco.MjData) -> None:
        """Take the distances of a step, after `mj_step`; with many pairs, of some steps only."""
        self._calls += 1
        if not len(self._keys) or self._calls % self._every:
            return
        gap_m = self._gaps(data)
        is_near = np.flatnonzero((gap_m <= 0) & ~self._was_near)
        self._was_near[is_near[self._boxes_overlap(data, is_near)]] = True
        if not compat.has_geom_distance():
            return
        nearer = np.flatnonzero(gap_m < self._closest_m)
        gain_m = np.minimum(self._closest_m[nearer], _FAR_M) - gap_m[nearer]
        for pair in nearer[np.argsort(-gain_m)][: self._max_distances]:
            geom1, geom2 = map(int, self._pairs.geoms[pair])
            most_m = min(float(self._closest_m[pair]), _FAR_M)
            self._closest_m[pair] = mujoco.mj_geomDistance(
                self._model, data, geom1, geom2, most_m, None
            )

    def idle(self) -> tuple[tuple[IdlePair, ...], int]:
        """Return the pairs tested in detail that never touched, and how many have no name."""
        idle, unnamed = [], 0
        for key in np.unique(self._keys[self._was_near]):
            if int(key) in self._touched:
                continue
            bodies, kind = divmod(int(key), self._model.nbody), mujoco.mjtObj.mjOBJ_BODY
            names = [mujoco.mj_id2name(self._model, kind, body) or "" for body in bodies]
            if not all(names):
                unnamed += 1
                continue
            closest_m = float(self._closest_m[self._keys == key].min())
            is_known = np.isfinite(closest_m)
            idle.append(IdlePair(names[0], names[1], closest_m if is_known else None))
        return tuple(idle), unnamed

    def _gaps(self, data: mujoco.MjData) -> np.ndarray:
        """Return (npair,) what separates the bounding spheres of two geoms, in metres.

        It is a lower bound of their distance beyond the margins (their sum; some releases take the
        larger one). Where it is not above 0, the engine tests a pair in detail. Planes have no
        sphere: there it is the distance of the other geom's sphere.
        """
        model, (first, second) = self._model, self._pairs.geoms.T
        radius, margin = np.asarray(model.geom_rbound), np.asarray(model.geom_margin)
        centre, is_plane = data.geom_xpos, geom_pairs.are_planes(model)
        between = centre[second] - centre[first]
        gap = np.linalg.norm(between, axis=1) - radius[first] - radius[second]
        for plane, other, sign in ((first, second, 1.0), (second, first, -1.0)):
            rows = is_plane[plane]
            normal = data.geom_xmat[plane[rows]][:, 2::3]  # the z axis
            gap[rows] = sign * np.sum(between[rows] * normal, axis=1) - radius[other[rows]]
        return np.asarray(gap - margin[first] - margin[second])

    def _boxes_overlap(self, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
        """Return (nrow,) bool: whether axis-aligned boxes of pairs overlap; a plane's do."""
        model, (first, second) = self._model, self._pairs.geoms[rows].T
        rotation = data.geom_xmat.reshape(-1, 3, 3)
        middle = data.geom_xpos + np.einsum("gij,gj->gi", rotation, model.geom_aabb[:, :3])
        half = np.einsum("gij,gj->gi", np.abs(rotation), model.geom_aabb[:, 3:])
        half += np.asarray(model.geom_margin)[:, None]
        half[geom_pairs.are_planes(model)] = np.inf
        apart = np.abs(middle[first] - middle[second]) > half[first] + half[second]
        return np.asarray(~apart.any(axis=1))
