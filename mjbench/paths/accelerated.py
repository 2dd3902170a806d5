"""What a way of stepping promises that compiles the step first, for an accelerator or for this CPU.

Such a path works in a process of its own (see `apart`): its engine takes all cores, may never
return, and must not run beside another's timing. It computes in its own precision and order, so it
is held to tolerances and not to the last bit (see `agreement.judge`).
"""

import importlib.util
import pathlib
import pickle
import sys
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mjbench.errors import InputError, MachineError, one_line
from mjbench.paths.base import Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation import compat, work
from mjbench.simulation.trajectory import Contacts
from mjbench.simulation.work import Peaks
from mjbench.simulation.workload import Workload, fields, portable, restore

# Room for contacts and constraints in Warp's buffers, as a multiple of the reference run's peak.
_ROOM = 2
# They hold pairs that are merely near, too: no fewer for each world than MuJoCo Warp's own guess
# for a model of plain geoms (make_data without nconmax).
_LEAST_CONTACTS = 48
# Of MuJoCo Warp's overflow flags, those of iterations are no lack of room.
_ITERATIONS = ("ITERATIONS", "LS_ITERATIONS")


@dataclass(frozen=True, eq=False)
class StepOutcome:
    """Where some steps led.

    Attributes:
      fields: (nbatch, size) float64 arrays by MjData field, those that the engine keeps, and the
        last controls under `ctrl`.
      contacts: of the last step; None where the engine does not tell.
    """

    fields: Mapping[str, np.ndarray]
    contacts: Contacts | None


@dataclass(eq=False)
class Compiled(Prepared):
    """A run that was compiled for one size of batch and number of controls.

    Attributes:
      device: what it runs on, such as `cpu` or `NVIDIA H200`.
      trace_s: seconds from Python to what the compiler takes; None where there is no such stage.
      compile_s: seconds of the compiler.
      exact: whether a timed run repeats the checked one to the last bit: one program, on a CPU. A
        GPU adds in any order.
      room: sizes of buffers, by the engine's names for them.
      gpu_memory_bytes: () → the most memory of the GPU that was taken; None on a CPU, or where the
        engine does not tell.
      advance: (fields by name, each (nbatch, size); control (nbatch, ncontrol, nu); nstep) →
        StepOutcome: the very program that is timed, from other states and for as many steps as one likes.
    """

    device: str = ""
    trace_s: float | None = None
    compile_s: float = 0.0
    exact: bool = True
    room: Mapping[str, int] = field(default_factory=dict)
    gpu_memory_bytes: Callable[[], int | None] = lambda: None
    advance: Callable[[Mapping[str, np.ndarray], np.ndarray, int], StepOutcome] = field(
        default=None  # type: ignore[assignment]
    )


class AcceleratedPath(SteppingPath):
    """A path that compiles first.

    Class attributes:
      precision: `float32` or `float64`.
      extra: of mjbench that installs what it needs.
      packages: modules that it needs.
      engine: what people call it.
      usual: whether `--paths usual` has it.
    """

    closed_loop = True
    usual: ClassVar[bool] = False
    precision: ClassVar[str]
    extra: ClassVar[str]
    packages: ClassVar[tuple[str, ...]]
    engine: ClassVar[str] = "the engine"

    def unavailable(self) -> str | None:
        """Return which extra to install where a package is missing."""
        missing = [name for name in self.packages if not _installed(name)]
        if missing:
            return f"needs {', '.join(missing)}: pip install 'mjbench[{self.extra}]'"
        return None

    @abstractmethod
    def device_kind(self) -> str:
        """Return the kind of device that it would run on, `cpu` or not.

        Raises:
          MachineError: there is none.
        """

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Return the engine's own reason for not taking the model or its start states."""
        try:
            taken(start_fields(workload), self.fields(workload.model), self.engine)
        except Exception as error:  # whatever an engine says of a model that it does not take
            if _of_machine(error):
                raise
            said = one_line(error) or type(error).__name__
            return f"{self.engine} does not take this model: {said}"
        return None

    @abstractmethod
    def fields(self, model: Any) -> Mapping[str, Any]:
        """Return the engine's Data of a model by field.

        An error that is not the machine's says that it does not take the model.
        """

    def environment(self) -> dict[str, str | None]:
        """Return environment variables for its process, set before it starts; None removes one."""
        return {}

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Compiled:
        """Return a compiled run, with buffers for what the reference run needs."""
        return self.compiled(workload, options, peaks(workload, resources))

    @abstractmethod
    def compiled(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Return a compiled run."""


def start_fields(workload: Workload) -> dict[str, np.ndarray]:
    """Return the start states by MjData field, each (nbatch, size), without controls."""
    found = fields(workload.model, workload.initial_state)
    found.pop("ctrl", None)
    return found


def taken(found: Mapping[str, np.ndarray], known: Mapping[str, Any], engine: str) -> dict[str, Any]:
    """Return the fields that an engine keeps; whatever else is there must be zero.

    Raises:
      InputError: a field that it does not keep says something.
    """
    kept = {}
    for name, values in found.items():
        if name in known:
            kept[name] = values
        elif values.any():
            raise InputError(f"{engine} keeps no {name}, which the start states have")
    return kept


def save_workload(workload: Workload, peaks: Peaks, file: pathlib.Path) -> None:
    """Leave a workload, and the most that a step of its reference run did, for another process."""
    file.write_bytes(pickle.dumps({"workload": portable(workload), "peaks": peaks}))


def load_workload(model: Any, file: pathlib.Path) -> tuple[Workload, Resources]:
    """Return the workload that `save_workload` wrote, and resources that hold its peaks."""
    given = pickle.loads(file.read_bytes())
    made = restore(model, given["workload"])
    resources = Resources(made)
    resources.get_or_create("peaks", lambda: given["peaks"])
    return made, resources


def peaks(workload: Workload, resources: Resources) -> Peaks:
    """Return the most that a step of the reference run did, which is made where none was yet."""
    made = resources.get_or_create("peaks", lambda: work.observe(workload).peaks)
    assert isinstance(made, Peaks)
    return made


def room_for(peaks: Peaks, nbatch: int) -> dict[str, int]:
    """Return sizes of Warp's buffers by make_data's names: contacts of all, constraints of each."""
    return {
        "naconmax": nbatch * max(_LEAST_CONTACTS, _ROOM * peaks.contacts),
        "njmax": max(1, _ROOM * peaks.constraints),
    }


def keywords(sizes: Mapping[str, int]) -> str:
    """Return sizes as they follow other arguments in a call, for a snippet."""
    return "".join(f", {name}={size}" for name, size in sizes.items())


def listed_contacts(
    count: Any, world: Any, geom: Any, frame: Any, distance: Any, margin: Any
) -> Contacts:
    """Return those of Warp's contacts that are close enough to count.

    Args:
      count: how many of the rows below there are.
      world: (n,) whose they are.
      geom: (n, 2) ids of geoms.
      frame: (n, 3, 3) the normal first.
      distance: (n,) between the geoms, in m.
      margin: (n,) below which they count, in m.
    """
    filled = slice(min(int(np.ravel(count)[0]), len(distance)))
    near = np.asarray(distance)[filled] < np.asarray(margin)[filled]
    frames = np.asarray(frame)[filled].reshape(-1, 9)
    return Contacts.of(
        np.asarray(world)[filled][near], np.asarray(geom)[filled][near], frames[near, :3]
    )


def final(workload: Workload, found: Mapping[str, np.ndarray]) -> States:
    """Return final states, and which of their entries the engine keeps.

    Args:
      workload: that was run.
      found: (nbatch, size) arrays by MjData field.
    """
    columns = compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
    values = np.full_like(workload.initial_state, np.nan)
    held = np.zeros(values.shape, dtype=bool)
    for name, place in columns.items():
        if name in found:
            values[:, place] = found[name]
            held[:, place] = True
    return States(values, held)


def check_overflow(flags: np.ndarray) -> None:
    """Refuse a result of MuJoCo Warp's for which a buffer was too small.

    Args:
      flags: of each world, bits of its OverflowType.

    Raises:
      MachineError: one was; told which.
    """
    from mujoco_warp import OverflowType

    single = [flag for flag in OverflowType if flag.value and not flag.value & (flag.value - 1)]
    small = [f for f in single if f.name not in _ITERATIONS and (flags & f.value).any()]
    if small:
        worlds = int(np.count_nonzero(flags & sum(f.value for f in small)))
        names = ", ".join(str(f.name) for f in small)
        raise MachineError(f"buffers of Warp overflowed in {worlds} worlds: {names}")


def _of_machine(error: Exception) -> bool:
    """Return whether an error is the machine's or the installation's rather than a model's."""
    if isinstance(error, NotImplementedError):  # a RuntimeError, too
        return False
    return isinstance(error, RuntimeError | MemoryError | OSError)


def _installed(name: str) -> bool:
    if name in sys.modules:
        return True
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        return False
