"""What the word after `mjbench` stands for: a model, a program or an environment.

Nothing is imported or run to find out. What could be two things is refused in a line that names the
commands for each.
"""

import difflib
import importlib.util
import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mjbench.commands.env import source as environments
from mjbench.commands.env.source import EnvironmentSource
from mjbench.errors import InputError, shown
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

# What can be checked, for messages.
FORMS = (
    f"a shipped model, {models.FORMS}, a Python program, a Gymnasium id such as"
    " Humanoid-v5, or MODULE:FUNCTION, which returns an environment"
)
_PROGRAM, _MODULE = ".py", "-m"
# What has commands of its own, by what its name ends in.
_OTHER_FILES = {
    ".ipynb": "is a notebook: save it as a Python file (jupyter nbconvert --to script)",
    ".jsonl": "is a run file: `mjbench show` prints it",
    ".npz": "has states of a model: check the model, and give it by --states",
}
_ENVIRONMENT_ID = re.compile(r"-v\d+$")


class TargetKind(StrEnum):
    """What is checked."""

    MODEL = "model"
    PROGRAM = "program"
    ENVIRONMENT = "environment"


@dataclass(frozen=True)
class ProgramFile:
    """A Python program with its arguments.

    Attributes:
      words: what follows `python`: a file, or -m and a module, and the arguments.
      path: its file; None for a module that is not in the current folder.
    """

    words: tuple[str, ...]
    path: Path | None

    @property
    def name(self) -> str:
        return " ".join(self.words[: 2 if self.words[0] == _MODULE else 1])


CheckedSource = ModelSource | EnvironmentSource | ProgramFile


def kind_of(source: CheckedSource) -> TargetKind:
    match source:
        case ModelSource():
            return TargetKind.MODEL
        case EnvironmentSource():
            return TargetKind.ENVIRONMENT
    return TargetKind.PROGRAM


def is_program(word: str) -> bool:
    """Return whether a word is the name of a program, or says that one follows."""
    return word == _MODULE or Path(word).suffix == _PROGRAM


def may_be_target(word: str) -> bool:
    """Return whether a word rather names something to check than a command, a mistyped one even."""
    has_sign = any(sign in word for sign in "./:\\") or bool(_ENVIRONMENT_ID.search(word))
    # a mistyped name of a shipped model is one, too
    is_shipped = bool(difflib.get_close_matches(word, models.shipped(), cutoff=0.8))
    return has_sign or is_shipped or _exists(Path(word))


def recognized(name: str, arguments: tuple[str, ...], folder: Path) -> CheckedSource:
    """Return what a name stands for.

    Raises:
      InputError: it stands for nothing that can be checked, or for more than one thing.
    """
    if name == _MODULE:
        return _module(arguments, folder)
    source = _recognized(name, arguments, folder)
    if arguments and not isinstance(source, ProgramFile):
        raise InputError(
            f"one thing at a time: {shown(arguments[0])} follows {shown(name)}, and only a program"
            " has arguments"
        )
    return source


def _recognized(name: str, arguments: tuple[str, ...], folder: Path) -> CheckedSource:
    if not name:
        raise InputError(f"the name is empty; give {FORMS}")
    path = Path(name)
    if path.suffix == _PROGRAM:
        if not _exists(path):
            raise InputError(f"no such file: {shown(name)}")
        if not path.is_file():
            raise InputError(f"{shown(name)} is not a regular file")
        return ProgramFile((name, *arguments), path)
    if path.suffix.lower() in models.SUFFIXES or name in models.shipped():
        return models.resolve(name)
    if _exists(path):
        what = "is a folder" if path.is_dir() else "is no file of a known kind"
        what = _OTHER_FILES.get(path.suffix, what)
        raise InputError(f"{shown(name)} {what}; give {FORMS}")
    module, colon, attribute = name.partition(":")
    if _ENVIRONMENT_ID.search(name) or (module == "dm_control" and "-" in attribute):
        return environments.resolve(name, folder)
    if not colon or "://" in name:
        return models.resolve(name)
    return _model_or_function(name, module, folder)


def _module(words: tuple[str, ...], folder: Path) -> ProgramFile:
    if not words:
        raise InputError("-m needs the name of a module")
    path = folder.joinpath(*words[0].split("."))
    files = [path.with_suffix(_PROGRAM), path / f"__main__{_PROGRAM}"]
    return ProgramFile((_MODULE, *words), next(filter(_exists, files), None))


def _model_or_function(name: str, module: str, folder: Path) -> CheckedSource:
    """Return the model of a package, or the function of a module, that `NAME:NAME` stands for."""
    first = folder / module.partition(".")[0]
    is_own = _exists(first.with_suffix(_PROGRAM)) or _exists(first / "__init__.py")
    try:
        model = models.resolve(name)
    except InputError:
        if is_own or (module not in models.MODEL_PACKAGES and _is_importable(module)):
            return environments.resolve(name, folder)
        raise
    if is_own:
        raise InputError(
            f"{shown(name)} may be a model of a package or a function of {shown(module)} in this"
            f" folder: say `mjbench profile {name}` or `mjbench env {name}`"
        )
    return model


def _is_importable(module: str) -> bool:
    try:
        return importlib.util.find_spec(module.partition(".")[0]) is not None
    except (ImportError, ValueError):
        return False


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name that no file can have
        return False
