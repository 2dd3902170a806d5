"""Colliding meshes that a primitive nearly fills: reported, never replaced.

A mesh collides as its convex hull. A primitive that contains the hull and is hardly larger collides
about alike, and faster. Each primitive is fitted in a few frames: that of the mesh's inertia, that
of its file, and those of an edge of its largest face, which are a box's own.
"""

import enum
import functools
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import Share
from mjbench.simulation import geom_pairs

# The hull's share of the primitive's volume, at least.
MIN_SHARE = 0.9
# Shares that differ by less are the same: the simpler primitive is noted.
_SAME_SHARE = 0.01


class Primitive(enum.StrEnum):
    """A geom type of MJCF, the one that collides fastest first."""

    SPHERE = "sphere"
    CAPSULE = "capsule"
    BOX = "box"
    CYLINDER = "cylinder"
    ELLIPSOID = "ellipsoid"


@dataclass(frozen=True)
class MeshNote:
    """A mesh geom that a primitive could replace.

    Attributes:
      geom: its name, or `geom 3` by its index where it has none.
      primitive: that contains the convex hull.
      share: the hull's share of the primitive's volume, from MIN_SHARE to 1.
    """

    geom: str
    mesh: str
    primitive: Primitive
    share: Share


def mesh_notes(model: mujoco.MjModel) -> list[MeshNote]:
    notes = []
    best_fit = functools.cache(lambda mesh: _best_fit(model, mesh))
    for geom in map(int, geom_pairs.colliding_geoms(model)):
        if int(model.geom_type[geom]) != int(mujoco.mjtGeom.mjGEOM_MESH):
            continue
        mesh = int(model.geom_dataid[geom])
        fit = best_fit(mesh)
        if fit is not None and fit[1] >= MIN_SHARE:
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or f"geom {geom}"
            mesh_name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_MESH, mesh)
            notes.append(MeshNote(name, mesh_name or f"mesh {mesh}", *fit))
    return notes


@dataclass(frozen=True, eq=False)
class _Hull:
    """Vertices (nvertex, 3) of a convex hull, and triangles (ntriangle, 3, 3), in m."""

    vertices: np.ndarray
    triangles: np.ndarray

    def volume(self) -> float:
        """Return the volume in m³, as the sum of tetrahedra from a point inside."""
        corners = self.triangles - self.vertices.mean(axis=0)
        return float(np.abs(np.linalg.det(corners)).sum() / 6.0)


def _hull(model: mujoco.MjModel, mesh: int) -> _Hull | None:
    """Return the convex hull as stored in `mesh_graph` (see its documentation); None without."""
    start = int(model.mesh_graphadr[mesh])
    if start < 0:
        return None
    graph = np.asarray(model.mesh_graph)[start:]
    nvertex, ntriangle = int(graph[0]), int(graph[1])
    vertices_at = 2 + nvertex  # after vert_edgeadr: vert_globalid
    triangles_at = vertices_at + nvertex + nvertex + 3 * ntriangle  # after edge_localid
    first = int(model.mesh_vertadr[mesh])
    points = np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], dtype=float)
    triangles = graph[triangles_at : triangles_at + 3 * ntriangle].reshape(-1, 3)
    return _Hull(points[graph[vertices_at : vertices_at + nvertex]], points[triangles])


def _best_fit(model: mujoco.MjModel, mesh: int) -> tuple[Primitive, float] | None:
    """Return the primitive that a mesh's hull fills most, and its share; None without a hull."""
    hull = _hull(model, mesh)
    if hull is None:
        return None
    best = dict.fromkeys(Primitive, np.inf)  # m³
    for frame in _frames(model, mesh, hull):
        points = hull.vertices @ frame
        middle = (points.max(axis=0) + points.min(axis=0)) / 2
        for primitive, volume in _volumes(points - middle):
            best[primitive] = min(best[primitive], volume)
    shares = {primitive: hull.volume() / volume for primitive, volume in best.items()}
    most = max(shares.values())
    return next((p, share) for p, share in shares.items() if share >= most - _SAME_SHARE)


def _frames(model: mujoco.MjModel, mesh: int, hull: _Hull) -> list[np.ndarray]:
    """Return (3, 3) frames whose columns are axes to fit primitives along."""
    frames = [np.eye(3)]  # the compiler aligns a mesh with its inertia
    if hasattr(model, "mesh_quat"):  # 3.0.0 on
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, np.asarray(model.mesh_quat[mesh], dtype=float))
        frames.append(rotation.reshape(3, 3).T)
    edges = np.roll(hull.triangles, -1, axis=1) - hull.triangles
    normals = np.cross(edges[:, 0], edges[:, 1])
    largest = int(np.argmax(np.linalg.norm(normals, axis=1)))
    z = normals[largest] / np.linalg.norm(normals[largest])
    for edge in edges[largest]:
        x = edge / np.linalg.norm(edge)
        frames.append(np.stack([x, np.cross(z, x), z], axis=1))
    return frames


def _volumes(points: np.ndarray) -> list[tuple[Primitive, float]]:
    """Return the volumes in m³ of primitives that contain (npoint, 3) points, about the origin."""
    half = np.abs(points).max(axis=0)
    # by which an ellipsoid of these half axes must grow to hold all points
    growth = np.linalg.norm(points / half, axis=1).max()
    volumes = [
        (Primitive.SPHERE, 4 / 3 * np.pi * np.linalg.norm(points, axis=1).max() ** 3),
        (Primitive.BOX, 8.0 * half.prod()),
        (Primitive.ELLIPSOID, 4 / 3 * np.pi * half.prod() * growth**3),
    ]
    for axis in range(3):
        along = np.abs(points[:, axis])
        across = np.linalg.norm(np.delete(points, axis, axis=1), axis=1)
        radius = across.max()
        # where its round end begins: far enough for every point to be inside
        length = np.maximum(0.0, along - np.sqrt(radius**2 - across**2)).max()
        disc = np.pi * radius**2
        volumes.append((Primitive.CYLINDER, disc * 2 * half[axis]))
        volumes.append((Primitive.CAPSULE, disc * (2 * length + 4 / 3 * radius)))
    return [(primitive, float(volume)) for primitive, volume in volumes]
