"""Values that tests of tuning share: distances, and what present settings do."""

from mjbench.commands.tune.accuracy import Distance, Units
from mjbench.commands.tune.reference import CurrentSettings
from mjbench.paired.records import LaunchRow
from mjbench.simulation.starts import Starts, Window

PRESENT_ERROR = 0.02


def apart(share):
    """Return a distance of positions, in metres as large as its share."""
    return Distance(share, Units(share, None))


def blocks(ratio):
    """Return a launch in which settings take `ratio` of the time of the present ones."""
    present_ns, candidate_ns = 1_000_000, round(1_000_000 * ratio)
    quad = [present_ns, candidate_ns, candidate_ns, present_ns]
    return LaunchRow(None, None, ["ABBA"] * 2, [quad] * 2)


def present(error=PRESENT_ERROR, is_comparable=True, solver_limited=0.0):
    """Return what the present settings do, with an error."""
    window = Window(64, 248, 1.0, solver_limited, None, None, 0, None, {})
    return CurrentSettings(
        nrun=64,
        horizon_s=0.5,
        horizon_ncontrol=31,
        ncontrol=62,
        run_s=1.0,
        is_comparable=is_comparable,
        starts=Starts(0.1, 0.1, window=window),
        error=apart(error),
        rounding=apart(1e-15),
        solver=apart(1e-2 if solver_limited else 1e-8),
        converged_error=apart(0.1 * error),
    )
