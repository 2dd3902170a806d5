"""A setting: edits of a model's MJCF, or options of the loop, that may make steps faster."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mjbench.bounds import AnyFloat, NonNegativeInt


@dataclass(frozen=True)
class LoopChange:
    """What a setting changes in the loop that steps a model; one of the two, as no path has both.

    Attributes:
      is_clock_off: whether the timer of MuJoCo's Python package is off (see `engine_clock`).
      engine_threads: of the engine's own pool within one simulation; 0 for none.
    """

    is_clock_off: bool = False
    engine_threads: NonNegativeInt = 0

    @property
    def path(self) -> str:
        return "python_loop_hold" if self.engine_threads else "python_loop"

    @property
    def options(self) -> dict[str, str | int]:
        if self.engine_threads:
            return {"engine_threads": self.engine_threads}
        return {"clock": "off"} if self.is_clock_off else {}


NO_CHANGE = LoopChange()


class Part(enum.StrEnum):
    """What an edit changes in MJCF."""

    OPTION = "option"
    """An attribute of `<option>`."""
    FLAG = "flag"
    """An attribute of `<option><flag>`: `enable` or `disable`."""
    COMPILER = "compiler"
    """An attribute of `<compiler>` that is true or false."""
    MESHES = "meshes"
    """An attribute of every `<mesh>`, as its default has it."""
    TENDON = "tendon"
    """A tendon less."""
    EXCLUDE = "exclude"
    """An `<exclude>` of `<contact>` more, between two bodies."""


@dataclass(frozen=True)
class Edit:
    """One change of a model's MJCF.

    Attributes:
      name: of the attribute or the tendon; of the first body, where a pair is excluded.
      value: of the attribute, as MJCF has it; the second body's name, where a pair is excluded;
        empty for a tendon.
    """

    part: Part
    name: str
    value: str

    @property
    def is_of_options(self) -> bool:
        return self.part in (Part.OPTION, Part.FLAG)


@dataclass(frozen=True)
class Setting:
    """One value of a knob.

    Attributes:
      loop: what it changes in the loop.
      loses: what else the user gives up, in a few words, such as `sensor data`; empty for nothing.
      evidence: what was observed that makes it possible, in one sentence; empty for nothing.
      saves: share of the work in a simulated second that it saves by count, such as a half by a
        timestep that is twice as long; 0 where that is not counted.
      stages: of a step, whose work that is; empty for the whole step.
    """

    knob: str
    label: str
    edits: tuple[Edit, ...] = ()
    loop: LoopChange = NO_CHANGE
    loses: str = ""
    evidence: str = ""
    saves: AnyFloat = 0.0
    stages: tuple[str, ...] = ()


Settings = tuple[Setting, ...]


def option(name: str, value: str, evidence: str = "", saves: float = 0.0) -> Setting:
    edit = Edit(Part.OPTION, name, value)
    return Setting(name, f"{name}={value}", (edit,), evidence=evidence, saves=saves)


def edits_of(settings: Iterable[Setting]) -> list[Edit]:
    return [edit for setting in settings for edit in setting.edits]


def loop_change(settings: Iterable[Setting]) -> LoopChange:
    changes = [setting.loop for setting in settings if setting.loop != NO_CHANGE]
    return changes[0] if changes else NO_CHANGE


def label(settings: Sequence[Setting]) -> str:
    return ", ".join(setting.label for setting in settings) or "present settings"
