"""Read the two sides of `mjbench ab` from words such as `path=rollout,threads=2`."""

import re
from typing import Any

from mjbench import paths
from mjbench.errors import InputError
from mjbench.paired.protocol import Target
from mjbench.releases import installs
from mjbench.simulation import models

_DEFAULTS = {"model": "cartpole", "path": "python_loop", "release": installs.INSTALLED}
# Fields of MjOption that a side may set by name (a number, or an enum's value such as `cg`).
OPTION_FIELDS = (
    "timestep",
    "integrator",
    "solver",
    "cone",
    "jacobian",
    "iterations",
    "tolerance",
    "ls_iterations",
    "ls_tolerance",
    "noslip_iterations",
    "noslip_tolerance",
    "ccd_iterations",
    "ccd_tolerance",
    "impratio",
    "density",
    "viscosity",
    "disableflags",
    "enableflags",
)


def parse(old: str, new: str) -> tuple[Target, Target]:
    """Return the sides that two words name; a model, path or release left out is the other's.

    Raises:
      InputError: a key or value that means nothing.
    """
    first, second = _words(old), _words(new)
    common = {**_DEFAULTS}
    for key in _DEFAULTS:
        for words in (second, first):
            if key in words:
                common[key] = words[key]
    return _side(old, {**common, **first}), _side(new, {**common, **second})


def _words(text: str) -> dict[str, str]:
    found = {}
    for word in filter(None, text.split(",")):
        key, equals, value = (part.strip() for part in word.partition("="))
        if key == "option":  # option=solver:cg is solver=cg
            key, equals, value = (part.strip() for part in re.sub("[:]", "=", value).partition("="))
        if not equals or not key or not value:
            raise InputError(f"{text!r}: {word!r} is not KEY=VALUE")
        found[key] = value
    return found


def way(name: str) -> paths.SteppingPath:
    """Return a path that a side can step by.

    Raises:
      InputError: no such path, or one that compiles and is not the same to the last bit.
    """
    path = paths.find(name)
    if path.compiles:
        raise InputError(
            f"path {name} compiles first and rounds its own way, so it cannot take turns with C:"
            f" `mjbench compare --paths {name}` compares it"
        )
    return path


def _value(text: str, option: paths.Option, word: str) -> Any:
    try:
        return option.value(word)
    except InputError as error:
        raise InputError(f"{text!r}: {error}") from None


def _side(text: str, words: dict[str, str]) -> Target:
    path = way(words["path"])
    known = {option.name: option for option in path.options}
    options: dict[str, Any] = {}
    fields: dict[str, str] = {}
    for key, value in words.items():
        if key in _DEFAULTS:
            continue
        if key in known:
            options[key] = _value(text, known[key], value)
        elif key in OPTION_FIELDS:
            fields[key] = value
        else:
            raise InputError(
                f"{text!r}: no {key!r}; path {path.name} has {', '.join(known) or 'no options'};"
                f" there are {', '.join(_DEFAULTS)}, and MjOption's {', '.join(OPTION_FIELDS)}"
            )
    return Target(
        installs.parse_release(words["release"]),
        models.resolve(words["model"]),
        path.name,
        path.complete(options),
        fields,
    )
