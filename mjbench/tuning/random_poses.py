"""Random poses of a model: every joint anywhere within its limits, and slightly beyond."""

from collections.abc import Iterator

import mujoco
import numpy as np

# Limits are soft: joints go beyond them by some of their range, on either side.
_BEYOND = 0.1


def draw(
    model: mujoco.MjModel, start: np.ndarray, count: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield (nq,) poses, uniform within the limits of hinges and slides, a tenth wider, and balls.

    A hinge or ball without limits turns to any angle. Free joints, and slides without limits, stay
    where they start: joints do not bound them.

    Args:
      start: (nq,) where joints start.
    """
    kinds, limited = np.asarray(model.jnt_type), np.asarray(model.jnt_limited).astype(bool)
    low, high = np.array(model.jnt_range).T
    is_hinge, is_slide = (kinds == int(_kind(name)) for name in ("HINGE", "SLIDE"))
    beyond = _BEYOND * (high - low)
    low, high = low - beyond, high + beyond
    low[is_hinge & ~limited], high[is_hinge & ~limited] = -np.pi, np.pi
    scalar = is_hinge | (is_slide & limited)
    at = np.asarray(model.jnt_qposadr)[scalar]
    balls = np.flatnonzero(kinds == int(_kind("BALL")))
    for _ in range(count):
        pose = start.copy()
        pose[at] = rng.uniform(low[scalar], high[scalar])
        for ball in balls:
            place = int(model.jnt_qposadr[ball])
            most_rad = float(high[ball]) if limited[ball] else np.pi
            pose[place : place + 4] = _rotation(most_rad, rng)
        yield pose


def _kind(name: str) -> mujoco.mjtJoint:
    return getattr(mujoco.mjtJoint, f"mjJNT_{name}")


def _rotation(most_rad: float, rng: np.random.Generator) -> np.ndarray:
    """Return (4,) a quaternion about a random axis, by a uniform angle up to `most_rad`."""
    axis, quaternion = rng.standard_normal(3), np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis / np.linalg.norm(axis), rng.uniform(0.0, most_rad))
    return quaternion
