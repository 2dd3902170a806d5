"""The ways of stepping MuJoCo, by name.

`registry()` lists them in the order they are shown; `find` returns the path that a name on the
command line stands for, including `module:Class` for a path of the user's own.
"""

import contextlib
import importlib
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from mjbench.errors import InputError, describe, one_line, suggestion
from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation.workload import Product

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
    "user_module_files",
]


# Where the class of each path is, by the path's name; in the order they are shown.
_CLASSES = {
    "python_loop": "python_loop:PythonLoop",
    "python_loop_hold": "python_loop:PythonLoopHold",
    "rollout": "rollout:Rollout",
    "batch_step": "mujoco_batch:BatchStep",
    "batch_rollout": "mujoco_batch:BatchRollout",
    "threads": "threads:Threads",
    "processes": "processes:Processes",
    "mjx": "mjx:Mjx",
    "mjx64": "mjx:Mjx64",
    "mjx_warp": "mjx:MjxWarp",
    "warp": "warp:Warp",
}


def registry() -> dict[str, SteppingPath]:
    return {name: _own(name) for name in _CLASSES}


def _own(name: str) -> SteppingPath:
    module, _, class_name = _CLASSES[name].partition(":")
    path: SteppingPath = getattr(importlib.import_module(f"{__name__}.{module}"), class_name)()
    return path


def shipped(name: str) -> SteppingPath | None:
    """Return one of mjbench's own paths; None for another. It imports nothing that a file names."""
    return _own(name) if name in _CLASSES else None


def title(name: str) -> str:
    """Return what sentences call a path: its title, or its name."""
    path = shipped(name)
    return path.title or name if path else name


def find(name: str) -> SteppingPath:
    """Return the path called `name`, or of the class `module:Class`; InputError if it is none."""
    if name in _CLASSES:
        return _own(name)
    module, colon, attribute = name.partition(":")
    if not colon:
        hint = suggestion(name, _CLASSES)
        raise InputError(f"no path {name!r}{hint}; the paths are {', '.join(_CLASSES)}")
    try:
        with _running_user_code():
            path_class = getattr(importlib.import_module(module), attribute)
            if not (isinstance(path_class, type) and issubclass(path_class, SteppingPath)):
                raise InputError(f"path {name}: not a subclass of mjbench.paths.SteppingPath")
            path = path_class()
            problem = _problem(path)
    except (InputError, KeyboardInterrupt):
        raise
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"path {name}: {one_line(error)}") from error
    except BaseException as error:  # the module may do anything, such as sys.exit()
        raise InputError(f"path {name}: {describe(error)}") from error
    if problem:
        raise InputError(f"path {name}: {problem}")
    return path


def user_module_files(names: Iterable[str]) -> list[Path]:
    """Return the files of the modules, already imported, that names such as `module:Class` name."""
    modules = {name.partition(":")[0] for name in names if ":" in name}
    files = (getattr(sys.modules.get(module), "__file__", None) for module in sorted(modules))
    return [Path(file) for file in files if file]


@contextlib.contextmanager
def _running_user_code() -> Iterator[None]:
    """Run code of the user's own, which may print, or change the folder."""
    folder = Path.cwd()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        os.chdir(folder)


def _problem(path: SteppingPath) -> str:
    """Return what is wrong with a path of the user's own, in one line; empty if nothing is."""
    from mjbench.paths.accelerated import AcceleratedPath
    from mjbench.simulation.accelerated_judgement import Precision

    kinds = {"name": str, "summary": str, "closed_loop": bool, "compiles": bool}
    kinds |= {"options": tuple, "products": tuple}
    if isinstance(path, AcceleratedPath):
        kinds["precision"] = Precision
    for attribute, kind in kinds.items():
        value = getattr(path, attribute, None)
        if not isinstance(value, kind):
            return f"its {attribute} must be a {kind.__name__}, not {one_line(repr(value), 80)}"
    for option in path.options:
        if not isinstance(option, Option):
            return f"its options must be of mjbench.paths.Option, not {one_line(repr(option), 80)}"
    for product in path.products:
        if not isinstance(product, Product):
            return f"its products must be of Product, not {one_line(repr(product), 80)}"
    if path.compiles != isinstance(path, AcceleratedPath):
        return (
            "compiles must be True for a subclass of mjbench.paths.accelerated.AcceleratedPath,"
            " and False for any other path"
        )
    return ""
