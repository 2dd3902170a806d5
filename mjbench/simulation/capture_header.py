"""The origin of captured states, as their file stores it, and the models that they fit.

Positions and controls mean something only to a model with the same joints and actuators. So states
of another layout are refused. Whether the masses, the geometry or the options are those of the
captured model does not matter to that: it is noted, because a replay then does something else.
"""

import json
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError, one_line, printable
from mjbench.simulation import compat
from mjbench.simulation.model_digest import model_digest

# The name of the array in the file that holds the header, and the version of the format.
ARRAY, FORMAT = "mjbench_capture", 1
# The name of the array with the number of each row's segment, which is one of consecutive steps.
SEGMENT_ARRAY = "mjbench_segment"


@dataclass(frozen=True)
class ModelLayout:
    """What decides which numbers a state of a model, and a control, hold."""

    nq: int
    nv: int
    nu: int
    na: int
    joints: tuple[str, ...]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "ModelLayout":
        types = model.jnt_type
        joints = tuple(compat.enum_name(mujoco.mjtJoint, each, "mjJNT_") for each in types)
        return cls(int(model.nq), int(model.nv), int(model.nu), int(model.na), joints)

    @property
    def sizes(self) -> str:
        return f"nq {self.nq}, nv {self.nv}, nu {self.nu}, na {self.na}"


@dataclass(frozen=True)
class CaptureHeader:
    """Where captured states come from.

    Attributes:
      digests: of the models that were stepped (see `model_digest`); several where the program
        changes its model.
      changed_inputs: MjData fields, other than the controls, that the program sets between steps.
    """

    format: int
    model: str
    layout: ModelLayout
    digests: tuple[str, ...]
    mujoco_version: str
    timestep_s: float
    steps: int
    changed_inputs: tuple[str, ...] = ()

    def array(self) -> np.ndarray:
        return np.array(json.dumps(asdict(self)))

    @classmethod
    def of_array(cls, array: np.ndarray, file_name: str) -> "CaptureHeader":
        """Return the header that a file holds; InputError for none, or a later format."""
        try:
            values = json.loads(str(array))
            version = int(values["format"])
            if version > FORMAT:
                raise InputError(
                    f"{file_name} has format {version} of captured states, and this mjbench reads"
                    f" up to {FORMAT}: upgrade mjbench"
                )
            return _header(values)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            raise InputError(
                f"{file_name}: {ARRAY} does not say where its states come from: {one_line(error)}"
            ) from error

    def check(self, model: mujoco.MjModel, file_name: str) -> None:
        own = ModelLayout.of(model)
        if own == self.layout:
            return
        captured = f"{file_name} holds states of another model, {self.model}"
        if own.sizes != self.layout.sizes:
            raise InputError(f"{captured}: {self.layout.sizes}; this one has {own.sizes}")
        raise InputError(f"{captured}: its joints are of other types than this one's")

    def is_of(self, model: mujoco.MjModel) -> bool:
        return model_digest(model) in self.digests


def model_name(model: mujoco.MjModel) -> str:
    return printable(bytes(model.names).split(b"\0", 1)[0].decode(errors="replace"))


def _header(values: dict[str, Any]) -> CaptureHeader:
    layout = values["layout"]
    return CaptureHeader(
        format=int(values["format"]),
        model=one_line(values["model"], 60),
        layout=ModelLayout(
            **{size: int(layout[size]) for size in ("nq", "nv", "nu", "na")},
            joints=_texts(layout["joints"]),
        ),
        digests=_texts(values["digests"]),
        mujoco_version=one_line(values["mujoco_version"], 60),
        timestep_s=float(values["timestep_s"]),
        steps=int(values["steps"]),
        changed_inputs=_texts(values["changed_inputs"]),
    )


def _texts(values: list[Any]) -> tuple[str, ...]:
    return tuple(one_line(value, 60) for value in values)
