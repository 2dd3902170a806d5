"""Contacts that a step detected at its start: of C, and of engines that are compared with it."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts that are near enough to count, of all simulations in one list.

    Attributes:
      simulation: (ncon,) indices.
      geom: (ncon, 2) ids of the geoms, the lower one first; -1 for a flex.
      distance: (ncon,) between the geoms, in m; negative where they penetrate.
      position: (ncon, 3) midpoints, in m.
      frame: (ncon, 3, 3) axes as rows: the normal, from the lower geom to the other, and two
        tangents.
    """

    simulation: np.ndarray
    geom: np.ndarray
    distance: np.ndarray
    position: np.ndarray
    frame: np.ndarray

    @property
    def normal(self) -> np.ndarray:
        """(ncon, 3) unit normals."""
        return np.asarray(self.frame[:, 0])

    def counts(self, nbatch: int) -> np.ndarray:
        return np.bincount(self.simulation, minlength=nbatch)

    def select(self, rows: np.ndarray) -> "Contacts":
        arrays = (self.simulation, self.geom, self.distance, self.position, self.frame)
        return Contacts(*(array[rows] for array in arrays))

    def first(self, nbatch: int) -> "Contacts":
        return self.select(self.simulation < nbatch)

    @classmethod
    def joined(cls, parts: Sequence["Contacts"], nbatch: int) -> "Contacts":
        """Return the contacts of several batches as one: their simulations follow each other."""
        simulation = np.concatenate([p.simulation + i * nbatch for i, p in enumerate(parts)])
        rest = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("geom", "distance", "position", "frame")
        )
        return cls(simulation, *rest)

    @classmethod
    def together(cls, one: "Contacts", other: "Contacts") -> "Contacts":
        """Return two lists of contacts of the same simulations as one."""
        return cls.joined([one, other], 0)

    @classmethod
    def of(
        cls,
        simulation: ArrayLike,
        geom: ArrayLike,
        distance: ArrayLike,
        position: ArrayLike,
        frame: ArrayLike,
    ) -> "Contacts":
        """Return contacts with the lower geom first; the normals of `frame` point from geom 0."""
        pairs = np.asarray(geom, dtype=int).reshape(-1, 2)
        frames = np.array(frame, dtype=float).reshape(-1, 3, 3)
        is_swapped = pairs[:, 0] > pairs[:, 1]
        frames[is_swapped] = turned(frames[is_swapped])
        return cls(
            np.asarray(simulation, dtype=int),
            np.sort(pairs, axis=1),
            np.array(distance, dtype=float),
            np.array(position, dtype=float).reshape(-1, 3),
            frames,
        )

    @classmethod
    def of_c(cls, contacts_of_simulations: Sequence[Sequence[mujoco.MjContact]]) -> "Contacts":
        """Return the contacts of MjData, for each simulation those that counted."""
        rows = [
            (i, np.array(c.geom), c.dist, np.array(c.pos), np.array(c.frame))
            for i, contacts in enumerate(contacts_of_simulations)
            for c in contacts
        ]
        if not rows:
            return cls.of([], [], [], [], [])
        return cls.of(*zip(*rows, strict=True))


def turned(frames: np.ndarray) -> np.ndarray:
    """Return (n, 3, 3) frames of the same contacts with the geoms in the other order."""
    return np.asarray(frames * np.array([-1.0, 1.0, -1.0])[:, None])
