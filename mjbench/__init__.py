"""mjbench: which way of stepping MuJoCo from Python is fastest, and do all ways agree.

Importing this package loads neither MuJoCo nor any optional dependency; import the module you need,
such as `mjbench.simulation.models` or `mjbench.paths`. docs/python.md shows what a program can
measure, docs/architecture.md is the map.
"""

__version__ = "0.1.0"

# Where each is in this package; `__init__.pyi` has their signatures.
_HOMES = {
    "capture": "commands.record.capture:Capture",
    "checkup": "api.checkup:checkup",
    "compare": "api.compare:compare",
    "engine_clock": "simulation.engine_clock:engine_clock",
    "latency": "api.latency:latency",
    "load": "commands.show.rows:load",
    "profile": "api.profile:profile",
    "record": "commands.record.recording:record",
    "timer": "api.timer:timer",
    "versions": "api.versions:versions",
}
__all__ = [*_HOMES]


def __getattr__(name: str) -> object:
    """Import a function when it is first used: each needs more than the standard library."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    module, _, attribute = _HOMES[name].partition(":")
    try:
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
    except (Exception, SystemExit) as error:
        from mjbench.errors import MachineError, foreign_module

        if line := foreign_module(error):
            raise MachineError(line) from error
        raise
