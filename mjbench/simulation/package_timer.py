"""What mjbench says of the timer that MuJoCo's Python package installs (see `engine_clock`)."""

NAME = "the timer of MuJoCo's Python package"
# Turns it off in a program that does not use mjbench, and what else that does.
OFF_CODE = "mujoco.mj_resetCallbacks()"
OFF_NOTE = (
    f"Call {OFF_CODE} after creating MjData. It removes callbacks of your own, too;"
    " mjbench.engine_clock(False) removes the timer alone. Steps compute the same; mjData.timer and"
    " the viewer's profiler stay blank."
)
OFF_SNIPPET = f"{OFF_CODE}  # after creating MjData; removes callbacks of your own, too"
# The share of a step, or the gain, from which on turning it off is advised.
MIN_GAIN = 0.03
