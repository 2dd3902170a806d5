"""Meshes that a primitive nearly fills are noted, whatever frame their file has."""

import mujoco
import numpy as np
import pytest

from mjbench.commands.tune.mesh_notes import MeshNote, Primitive, mesh_notes

# A rotation about no axis of the shapes.
TURN = "euler='20 35 50'"


def text(points: np.ndarray) -> str:
    return " ".join(f"{value:.6f}" for value in points.ravel())


def box(x: float, y: float, z: float) -> np.ndarray:
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    return corners * [x, y, z]


def ball(x: float, y: float, z: float) -> np.ndarray:
    # a Fibonacci sphere
    k = np.arange(400) + 0.5
    height, angle = 1 - k / 200, np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - height**2)
    return np.stack([x * radius * np.cos(angle), y * radius * np.sin(angle), z * height], axis=1)


def cylinder(radius: float, half: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(24, half)], axis=1)
    return np.concatenate([ring, ring * [1, 1, -1]])


def capsule(radius: float, half: float) -> np.ndarray:
    points, end = ball(radius, radius, radius), np.array([0, 0, half])
    return np.concatenate([points + end, points - end])


def turned(points: np.ndarray) -> np.ndarray:
    rotation, quaternion = np.empty(9), np.array([0.3, 0.5, -0.6, 0.2])
    mujoco.mju_quat2Mat(rotation, quaternion / np.linalg.norm(quaternion))
    return points @ rotation.reshape(3, 3)


def notes(points: np.ndarray, geom: str = "name='g'") -> list[MeshNote]:
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='m' vertex='{text(points)}'/></asset><worldbody><body>"
        f"<freejoint/><geom type='mesh' mesh='m' {geom}/></body></worldbody></mujoco>"
    )
    return mesh_notes(model)


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize(
    ("primitive", "points"),
    [
        (Primitive.BOX, box(0.1, 0.2, 0.3)),
        (Primitive.BOX, box(0.1, 0.1, 0.3)),  # its inertia has no axes of its own in a plane,
        (Primitive.BOX, box(0.1, 0.1, 0.1)),  # or in space
        (Primitive.SPHERE, ball(0.1, 0.1, 0.1)),
        (Primitive.ELLIPSOID, ball(0.1, 0.2, 0.3)),
        (Primitive.CYLINDER, cylinder(0.1, 0.2)),
        (Primitive.CAPSULE, capsule(0.1, 0.2)),
    ],
)
def test_the_primitive_is_noted_in_any_frame(
    primitive: Primitive, points: np.ndarray, turn: bool
) -> None:
    (note,) = notes(turned(points) if turn else points, f"name='g' {TURN}")
    assert (note.geom, note.mesh, note.primitive) == ("g", "m", primitive)
    assert 0.9 <= note.share <= 1.0 + 1e-6
    if primitive == Primitive.BOX:
        assert note.share == pytest.approx(1.0, abs=1e-3)


def test_a_shape_that_fills_no_primitive_is_not_noted() -> None:
    wedge = box(0.1, 0.1, 0.1)[[0, 1, 2, 4, 5, 6]]
    assert notes(wedge) == []


def test_the_share_is_that_of_the_hull() -> None:
    # a box and a point beyond: a box with a pyramid of height 0.02 on it
    points = np.concatenate([box(0.1, 0.1, 0.2), [[0, 0, 0.21]]])
    (note,) = notes(points)
    hull, primitive = 0.2 * 0.2 * (0.4 + 0.01 / 3), 0.2 * 0.2 * 0.41
    assert note.primitive == Primitive.BOX
    assert note.share == pytest.approx(hull / primitive, rel=1e-4)


def test_a_geom_that_is_only_drawn_is_not_noted() -> None:
    assert notes(box(0.1, 0.2, 0.3), "contype='0' conaffinity='0'") == []


def test_a_geom_without_a_name_has_its_index() -> None:
    (note,) = notes(box(0.1, 0.2, 0.3), "")
    assert note.geom == "geom 0"
