"""A step's profile with round numbers."""

from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.profile.rendering import FrameTime
from mjbench.interval import Interval
from mjbench.simulation.reference_run import Work


def step_profile(has_timer: bool = True) -> ProfileRow:
    """Return the profile of a model with 4 contacts, rendered by EGL alone."""
    steps = ProfiledSteps(
        timestep=0.002,
        loop_ns=3000.0,
        engine_ns=2000.0,
        speedup_without_timer=Interval(1.2, 1.19, 1.21) if has_timer else None,
        work=Work(contacts=4.0, constraints=0.0, solver_iterations=2.5),
        stages={"kinematics": 0.25, "other": 0.75, "actuation": 0.0},
        warnings={},
    )
    frames = [FrameTime("egl", 0.01), FrameTime("osmesa", None, "it needs libosmesa6")]
    return ProfileRow("pole", steps=steps, frames=frames)
