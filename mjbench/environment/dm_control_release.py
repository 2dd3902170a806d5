"""Whether dm_control was built for the release of MuJoCo that is installed."""

import sys
from dataclasses import dataclass

import mujoco

# The module of dm_control that has the release of MuJoCo which its bindings were generated from.
_CONSTANTS = "dm_control.mujoco.wrapper.mjbindings.constants"


@dataclass(frozen=True)
class ReleaseMismatch:
    """A dm_control that was built for another release of MuJoCo than the installed one.

    Attributes:
      built_for: that release, such as `3.17.0`.
    """

    built_for: str
    installed: str

    def __str__(self) -> str:
        """Say both, and what to do."""
        return (
            f"dm_control is built for MuJoCo {self.built_for}, and {self.installed} is installed;"
            f" install it with mujoco=={self.built_for} in a virtual environment of its own"
        )


def mismatch() -> ReleaseMismatch | None:
    """Return how the releases differ; None where they do not, or dm_control was not imported."""
    number = getattr(sys.modules.get(_CONSTANTS), "mjVERSION_HEADER", None)
    if not isinstance(number, int) or number == mujoco.mj_version():
        return None
    # older releases have one digit for each part of the number, newer ones three
    base = 1000 if number >= 1_000_000 else 10
    built_for = f"{number // base**2}.{number // base % base}.{number % base}"
    return ReleaseMismatch(built_for, mujoco.mj_versionString())
