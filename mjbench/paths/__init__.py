"""The ways of stepping MuJoCo, by name.

`registry()` lists them in the order they are shown; `find` turns a word from the command line
into a path, `module:Class` for one of your own included.
"""

import difflib
import importlib

from mjbench.errors import InputError, one_line
from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath

# The path that every speed-up is a speed-up over.
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

    kinds = (
        *(PythonLoop, PythonLoopHold, Rollout, BatchStep, BatchRollout, Threads, Processes),
        *(Mjx, Mjx64, MjxWarp, Warp),
    )
    return {kind.name: kind() for kind in kinds}


def find(name: str) -> SteppingPath:
    """Return the path called `name`, or an object of the class that `module:Class` names.

    Raises:
      InputError: no such path; the message lists those there are.
    """
    paths = registry()
    if name in paths:
        return paths[name]
    module, colon, attribute = name.partition(":")
    if colon:
        try:
            kind = getattr(importlib.import_module(module), attribute)
        except (ImportError, AttributeError, ValueError) as error:
            raise InputError(f"path {name}: {one_line(error)}") from error
        if isinstance(kind, type) and issubclass(kind, SteppingPath):
            return kind()
        raise InputError(f"path {name}: not a subclass of mjbench.paths.SteppingPath")
    near = difflib.get_close_matches(name, paths, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    raise InputError(f"no path {name!r}{hint}; there are {', '.join(paths)}")
