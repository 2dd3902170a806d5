"""Create an environment from its source, in the process that is to step it.

What the user's code raises becomes one line with its file and line. The error for a package that is
not installed has the command that installs it.
"""

import contextlib
import importlib
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from mjbench import extras
from mjbench.commands.env.source import EnvironmentSource, Origin
from mjbench.errors import InputError, MjbenchError, describe, shown, suggestion

# The module of dm_control that has the release of MuJoCo which its bindings were generated from.
_CONSTANTS = "dm_control.mujoco.wrapper.mjbindings.constants"
_OWN_FOLDER = str(Path(__file__).resolve().parents[2])
_LIBRARY_FOLDERS = tuple(
    sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


@dataclass(frozen=True)
class ReleaseMismatch:
    """A dm_control that was built for another release of MuJoCo than the installed one.

    Attributes:
      built_for: that release, such as `3.17.0`.
    """

    built_for: str
    installed: str

    def __str__(self) -> str:
        return (
            f"dm_control is built for MuJoCo {self.built_for}, and {self.installed} is installed;"
            f" install it with mujoco=={self.built_for} in a virtual environment of its own"
        )


def dm_control_mismatch() -> ReleaseMismatch | None:
    """Return how the releases differ; None where they do not, or dm_control was not imported."""
    number = getattr(sys.modules.get(_CONSTANTS), "mjVERSION_HEADER", None)
    if not isinstance(number, int) or number == mujoco.mj_version():
        return None
    # older releases have one digit for each part of the number, newer ones three
    base = 1000 if number >= 1_000_000 else 10
    built_for = f"{number // base**2}.{number // base % base}.{number % base}"
    return ReleaseMismatch(built_for, mujoco.mj_versionString())


def make(source: EnvironmentSource) -> Any:
    """Return a new environment; a factory runs in, and is imported from, the user's folder."""
    match source.origin:
        case Origin.GYMNASIUM:
            return _from_gymnasium(source)
        case Origin.DM_CONTROL:
            return _from_dm_control(source)
        case Origin.FACTORY:
            return _from_factory(source)


@contextlib.contextmanager
def as_input_error(what: str) -> Iterator[None]:
    """Turn what the user's code raises into an InputError with its file and line."""
    try:
        yield
    except (MjbenchError, KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:  # it may be SystemExit
        mismatch = dm_control_mismatch()
        cause = f"; {mismatch}" if mismatch else ""
        raise InputError(f"{what} raised {describe(error)}{place_of(error)}{cause}") from error


def place_of(error: BaseException) -> str:
    """Return ` (my_env.py:42)` for what raised: the user's own line, then that of a library."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith((_OWN_FOLDER, "<frozen"))
    ]
    if not frames:
        return ""
    own = [frame for frame in frames if not frame.filename.startswith(_LIBRARY_FOLDERS)]
    places = dict.fromkeys(
        f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*own[-1:], frames[-1])
    )
    return f" ({', from '.join(places)})"


def _from_gymnasium(source: EnvironmentSource) -> Any:
    gymnasium = _imported("gymnasium", extras.install_command("env"))
    module, _, name = source.attribute.rpartition(":")
    if module:
        _user_module(module, source.folder)
    with as_input_error("making it"):
        try:
            return gymnasium.make(name)
        except gymnasium.error.DependencyNotInstalled as error:
            raise InputError(
                f"it needs a package that is not installed here: {extras.install_command('env')}"
            ) from error
        except gymnasium.error.UnregisteredEnv as error:
            raise _unknown(source, name, gymnasium.registry) from error


def _from_dm_control(source: EnvironmentSource) -> Any:
    _imported("dm_control", "python -m pip install dm_control")
    with as_input_error("making it"):
        from dm_control import suite

        names = [f"dm_control:{domain}-{task}" for domain, task in suite.ALL_TASKS]
        if source.name not in names:
            raise _unknown(source, source.name, names)
        return suite.load(source.module, source.attribute)


def _from_factory(source: EnvironmentSource) -> Any:
    factory = _user_module(source.module, source.folder)
    for name in source.attribute.split("."):
        known = [each for each in dir(factory) if not each.startswith("_")]
        try:
            factory = getattr(factory, name)
        except AttributeError:
            raise InputError(f"{source.module} has no {name}{suggestion(name, known)}") from None
    if not callable(factory):
        raise InputError(
            f"{source.attribute} is {type(factory).__name__}, not a function that returns an"
            " environment"
        )
    with as_input_error(f"{source.attribute}()"):
        return factory()


def _user_module(name: str, folder: Path) -> Any:
    os.chdir(folder)
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    with as_input_error(f"importing {name}"):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise  # a module that the user's own imports
            raise InputError(f"no module {name} in this folder or installed") from error


def _imported(package: str, command: str) -> Any:
    try:
        with as_input_error(f"importing {package}"):
            return importlib.import_module(package)
    except InputError as error:
        if isinstance(error.__cause__, ModuleNotFoundError) and error.__cause__.name == package:
            raise InputError(f"{package} is not installed here: {command}") from error
        raise


def _unknown(source: EnvironmentSource, name: str, names: Iterable[str]) -> InputError:
    return InputError(f"{source.origin} has no environment {shown(name)}{suggestion(name, names)}")
