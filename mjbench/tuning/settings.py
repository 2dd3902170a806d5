"""A setting: edits of a model's MJCF, or options of the loop, that may make steps faster."""

import enum
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

# The option of `python_loop` without the engine's clock (see `engine_clock`).
CLOCK_OFF: Mapping[str, str] = {"clock": "off"}


class Part(enum.StrEnum):
    """What an edit changes in MJCF."""

    OPTION = "option"
    """An attribute of `<option>`."""
    FLAG = "flag"
    """An attribute of `<option><flag>`: `enable` or `disable`."""
    COMPILER = "compiler"
    """An attribute of `<compiler>`."""
    EXCLUDE = "exclude"
    """An `<exclude>` of `<contact>` more, between two bodies."""


@dataclass(frozen=True)
class Edit:
    """One change of a model's MJCF.

    Attributes:
      part: what it changes.
      name: of the attribute; of the first body, where a pair is excluded.
      value: of the attribute, as MJCF has it; the second body's name, where a pair is excluded.
    """

    part: Part
    name: str
    value: str


@dataclass(frozen=True)
class Setting:
    """One value of a knob.

    Attributes:
      knob: name of the knob.
      label: what people read, such as `solver=CG`.
      edits: of the model.
      path_options: options of `python_loop`, where the setting is of the loop.
      loses: what else the user gives up, in a few words, such as `sensor data`; empty for nothing.
      evidence: what was observed that makes it possible, in one sentence; empty for nothing.
    """

    knob: str
    label: str
    edits: tuple[Edit, ...] = ()
    path_options: Mapping[str, str | int] = field(default_factory=dict)
    loses: str = ""
    evidence: str = ""


def edits_of(settings: Iterable[Setting]) -> list[Edit]:
    """Return the edits of some settings, in their order."""
    return [edit for setting in settings for edit in setting.edits]


def path_options_of(settings: Iterable[Setting]) -> dict[str, str | int]:
    """Return the options of `python_loop` that some settings have."""
    options: dict[str, str | int] = {}
    for setting in settings:
        options.update(setting.path_options)
    return options


def label(settings: Sequence[Setting]) -> str:
    """Return what people read for some settings together."""
    return ", ".join(setting.label for setting in settings) or "present settings"
