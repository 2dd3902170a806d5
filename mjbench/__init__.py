"""mjbench: which way of stepping MuJoCo from Python is fastest, and do all ways agree.

Importing this package loads neither MuJoCo nor any optional dependency; import the module you need,
such as `mjbench.simulation.models` or `mjbench.paths`. docs/architecture.md is the map.
"""

__version__ = "0.1.0"

__all__ = ["record"]


def __getattr__(name: str) -> object:
    """Import `record` when it is first used: it needs MuJoCo."""
    if name == "record":
        from mjbench.loop.recording import record

        return record
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
