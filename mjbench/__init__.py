"""mjbench: which way of stepping MuJoCo from Python is fastest, and do all ways agree.

Importing this package loads neither MuJoCo nor any optional dependency; import the module you need,
such as `mjbench.simulation.models` or `mjbench.paths`. docs/architecture.md is the map.
"""

__version__ = "0.1.0"

__all__ = ["capture", "engine_clock", "load", "record"]


def __getattr__(name: str) -> object:
    """Import a function when it is first used: each needs more than the standard library."""
    if name == "capture":
        from mjbench.loop.capture import Capture

        return Capture
    if name == "engine_clock":
        from mjbench.simulation.engine_clock import engine_clock

        return engine_clock
    if name == "load":
        from mjbench.report.rows import load

        return load
    if name == "record":
        from mjbench.loop.recording import record

        return record
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
