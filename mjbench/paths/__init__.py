"""The ways of stepping MuJoCo, by name.

`registry()` lists them in the order they are shown; `find` returns the path that a name on the
command line stands for, including `module:Class` for a path of the user's own.
"""

import importlib

from mjbench.errors import InputError, one_line, suggestion
from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath

# The path that every speed-up is relative to.
BASE = "python_loop"

__all__ = [
    "BASE",
    "Option",
    "Options",
    "Prepared",
    "Resources",
    "States",
    "SteppingPath",
    "find",
    "registry",
]


def registry() -> dict[str, SteppingPath]:
    """Return every path by name, each a new object."""
    from mjbench.paths.batch import BatchRollout, BatchStep
    from mjbench.paths.mjx import Mjx, Mjx64, MjxWarp
    from mjbench.paths.processes import Processes
    from mjbench.paths.python_loop import PythonLoop, PythonLoopHold
    from mjbench.paths.rollout import Rollout
    from mjbench.paths.threads import Threads
    from mjbench.paths.warp import Warp

    classes = (
        *(PythonLoop, PythonLoopHold, Rollout, BatchStep, BatchRollout, Threads, Processes),
        *(Mjx, Mjx64, MjxWarp, Warp),
    )
    return {path_class.name: path_class() for path_class in classes}


def find(name: str) -> SteppingPath:
    """Return the path called `name`, or an object of the class that `module:Class` names.

    Raises:
      InputError: no such path; the message lists the known ones.
    """
    paths = registry()
    if name in paths:
        return paths[name]
    module, colon, attribute = name.partition(":")
    if not colon:
        hint = suggestion(name, paths)
        raise InputError(f"no path {name!r}{hint}; the paths are {', '.join(paths)}")
    try:
        path_class = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"path {name}: {one_line(error)}") from error
    if isinstance(path_class, type) and issubclass(path_class, SteppingPath):
        return path_class()
    raise InputError(f"path {name}: not a subclass of mjbench.paths.SteppingPath")
