"""What the name of an environment stands for, such as `Humanoid-v5` or `module:factory`.

Nothing is imported here: environments are created in child processes (see `construction.py`).
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mjbench.errors import InputError, one_line, shown
from mjbench.simulation import models

# What an environment can be called, for messages.
FORMS = (
    "a Gymnasium id such as Humanoid-v5, dm_control:DOMAIN-TASK such as dm_control:humanoid-walk,"
    " or MODULE:FACTORY, a function of yours that returns an environment"
)
_VERSION = re.compile(r"-v\d+$")
_DM_CONTROL = "dm_control"
_FILES = {
    ".py": "give MODULE:FACTORY, such as my_env:make",
    **dict.fromkeys(models.SUFFIXES, "that is a model; `mjbench profile` takes models"),
}


class Origin(StrEnum):
    """Where an environment comes from."""

    GYMNASIUM = "gymnasium"
    DM_CONTROL = "dm_control"
    FACTORY = "factory"
    """A function of the user's returns it."""


@dataclass(frozen=True)
class EnvironmentSource:
    """Where an environment comes from.

    Attributes:
      module: of the factory; the domain of dm_control; empty for a Gymnasium id.
      attribute: the factory's name, with its class; the task of dm_control; the id of Gymnasium.
      folder: that the user's modules are imported from, and that a factory runs in.
    """

    name: str
    origin: Origin
    module: str
    attribute: str
    folder: Path


def resolve(name: str, folder: Path) -> EnvironmentSource:
    """Return where the environment called `name` comes from; InputError for another name."""
    for suffix, advice in _FILES.items():
        if name.endswith(suffix):
            raise InputError(f"{shown(name)} is no environment: {advice}")
    if not name.strip() or not name.isprintable() or any(map(str.isspace, name)):
        raise InputError(f"{one_line(repr(name), 100)} is no environment; give {FORMS}")
    module, colon, attribute = name.partition(":")
    if not colon or (_VERSION.search(attribute) and module != _DM_CONTROL):
        # `module:Id-v0` is also Gymnasium's form for a module that registers the id
        return EnvironmentSource(name, Origin.GYMNASIUM, "", name, folder)
    if module == _DM_CONTROL:
        domain, dash, task = attribute.partition("-")
        if not (domain and dash and task):
            raise InputError(
                f"{shown(name)}: give dm_control:DOMAIN-TASK, such as dm_control:humanoid-walk"
            )
        return EnvironmentSource(name, Origin.DM_CONTROL, domain, task, folder)
    parts = [*module.split("."), *attribute.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise InputError(f"{shown(name)} is no environment; give {FORMS}")
    return EnvironmentSource(name, Origin.FACTORY, module, attribute, folder)
