"""mjbench: which way of stepping MuJoCo from Python is fastest, and do all ways agree.

Importing this package loads neither MuJoCo nor any optional dependency; import the module you need,
such as `mjbench.simulation.models` or `mjbench.paths`. docs/python.md shows what a program can
measure, docs/architecture.md is the map.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjbench.api.compare import compare as compare
    from mjbench.api.latency import latency as latency
    from mjbench.api.profile import profile as profile
    from mjbench.api.timer import timer as timer
    from mjbench.api.versions import versions as versions
    from mjbench.loop.capture import Capture as capture  # noqa: N813 - it is called as a function
    from mjbench.loop.recording import record as record
    from mjbench.report.rows import load as load
    from mjbench.simulation.engine_clock import engine_clock as engine_clock

__version__ = "0.1.0"

__all__ = [
    "capture",
    "compare",
    "engine_clock",
    "latency",
    "load",
    "profile",
    "record",
    "timer",
    "versions",
]

# Functions in modules of the same name, which need what the command line needs.
_MEASURING = ("compare", "latency", "profile", "versions")


def __getattr__(name: str) -> object:
    """Import a function when it is first used: each needs more than the standard library."""
    if name == "capture":
        from mjbench.loop.capture import Capture

        return Capture
    if name in _MEASURING:
        import importlib

        from mjbench.instrument import extras

        extras.require(f"mjbench.{name}", "cli", extras.OF_EVERY_COMMAND)
        return getattr(importlib.import_module(f"mjbench.api.{name}"), name)
    if name == "engine_clock":
        from mjbench.simulation.engine_clock import engine_clock

        return engine_clock
    if name == "load":
        from mjbench.report.rows import load

        return load
    if name == "record":
        from mjbench.loop.recording import record

        return record
    if name == "timer":
        from mjbench.api.timer import timer

        return timer
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
