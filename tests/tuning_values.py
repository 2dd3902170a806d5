"""Values that tests of tuning share: distances, and what present settings do."""

from mjbench.simulation.starts import Starts
from mjbench.tuning.distance import Distance, Units
from mjbench.tuning.physics import Physics
from mjbench.tuning.reference import Present

NOTHING = Physics(0.0, 0.0, 0.0, 0.0)
PRESENT_ERROR = 0.02


def apart(share):
    """Return a distance of positions and velocities, in metres as large as its share."""
    return Distance(share, Units(share, None), Units(share, None))


def present(error=PRESENT_ERROR, is_comparable=True):
    """Return what the present settings do, with an error."""
    return Present(
        nrun=64,
        horizon_s=0.5,
        horizon_ncontrol=31,
        ncontrol=62,
        run_s=1.0,
        is_comparable=is_comparable,
        starts=Starts(0.1, 0.1),
        error=apart(error),
        rounding=apart(1e-15),
        solver=apart(1e-8),
        motion_m=1.0,
        motion_rad=None,
        physics=NOTHING,
        reference_physics=NOTHING,
    )
