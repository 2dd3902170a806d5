"""What every path promises that compiles the step first, for an accelerator or for this CPU.

Such a path runs in a process of its own (`compare.accelerated_measurement`): its engine
uses all cores, may never return, and must not run while another path is timed. It computes in its
own precision and order, so its results are judged part by part, not to the last bit
(`simulation.accelerated_judgement`).
"""

import pathlib
import pickle
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from mjbench import extras, paths
from mjbench.errors import InputError, one_line
from mjbench.measuring import timing
from mjbench.paths.base import Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation import compat, reference_run
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.workload import (
    PortableWorkload,
    Product,
    Workload,
    fields,
    portable,
    restore,
)

# JAX's and Warp's name of the processor, as a kind of device and as a device.
CPU = "cpu"


@dataclass(frozen=True, eq=False)
class StepOutcome:
    """The states that some steps led to.

    Attributes:
      fields: (nbatch, size) float64 by MjData field: the fields that the engine keeps, and the last
        controls as `ctrl`.
      contacts: of the last step; None where the engine does not report them.
      qacc: (nbatch, nv) accelerations that the last step's solver found, before integration.
      qfrc_constraint: (nbatch, nv) forces of constraints that it found.
    """

    fields: Mapping[str, np.ndarray]
    contacts: Contacts | None
    qacc: np.ndarray
    qfrc_constraint: np.ndarray


# (fields by name, each (nbatch, size); control (nbatch, ncontrol, nu); nstep)
Advance = Callable[[Mapping[str, np.ndarray], np.ndarray, int], StepOutcome]


@dataclass(frozen=True, eq=False, kw_only=True)
class Compiled(Prepared):
    """A workload's run, compiled for its batch size and number of controls.

    MJX and Warp are warmed up, timed and checked by this.

    Attributes:
      advance: the same program as `run`, called with any states, controls and number of steps.
      reload: puts the workload's start states and controls on the device again, after its
        simulations were reordered; not timed.
      trace_s: seconds from Python to the compiler's input; None without such a stage.
      is_deterministic: whether a timed run repeats the checked one to the last bit: where both are
        one program on a CPU. A GPU adds in any order.
      gpu_memory_bytes: peak GPU memory so far; None on a CPU, or where the engine does not report
        it.
      cached_compile_s: seconds that the compiler takes in a process which finds the program in the
        engine's cache; None where unknown. It compiles once more to fill a cache.
    """

    workload: Workload
    advance: Advance
    reload: Callable[[], None]
    device: str
    trace_s: float | None
    compile_s: float
    is_deterministic: bool
    buffer_sizes: Mapping[str, int]
    gpu_memory_bytes: Callable[[], int | None]
    cached_compile_s: Callable[[], float | None] = lambda: None

    def block_s(self) -> float:
        """Return the seconds of one run; the first run warms up."""
        return timing.block_s(timing.Contender(self.run, before=self.clear))

    def lost(self) -> int:
        """Return how many simulations of the last run do not end in finite numbers."""
        states = self.final_states()
        is_known = True if states.mask is None else states.mask
        return int((~np.isfinite(states.values) & is_known).any(axis=1).sum())


class AcceleratedPath(SteppingPath):
    """A path that compiles the step first.

    Class attributes:
      extra: extra of mjbench that installs the packages.
      distributions: names by which package indexes know what computes.
    """

    closed_loop = True
    compiles = True
    usual = False
    precision: ClassVar[Precision]
    extra: ClassVar[str]
    packages: ClassVar[tuple[str, ...]]
    distributions: ClassVar[tuple[str, ...]] = ("mujoco",)
    engine: ClassVar[str] = "the engine"

    def unavailable(self) -> str | None:
        """Return which extra to install where a package is missing."""
        if missing := extras.missing(self.packages):
            return f"needs {', '.join(missing)}: {extras.install_command(self.extra)}"
        return None

    @abstractmethod
    def device_kind(self) -> str:
        """Return the kind of the device that it would run on: `cpu`, or the engine's name of it."""

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Return the engine's own reason for rejecting the model or its start states."""
        try:
            supported_fields(start_fields(workload), self.data_fields(workload.model), self.engine)
        except Exception as error:  # engines reject models with exceptions of any type
            if _is_machine_error(error):
                raise
            reason = one_line(error) or type(error).__name__
            return f"{self.engine} does not take this model: {reason}"
        return None

    @abstractmethod
    def data_fields(self, model: mujoco.MjModel) -> Mapping[str, Any]:
        """Return the fields of the engine's Data by name; it raises for a model that it rejects."""

    def environment(self) -> dict[str, str | None]:
        """Return environment variables to set before its process starts; None removes one."""
        return {}

    @abstractmethod
    def use_cache(self, folder: pathlib.Path) -> None:
        """Have this process take compiled programs from a folder, and keep all of its own there."""

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Compiled:
        """Return a compiled run, with buffers for what the reference run needs."""
        return self.compile(workload, options, reference_peaks(workload, resources))

    @abstractmethod
    def compile(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Return a compiled run, with buffers for steps of up to `peaks`."""


def accelerated_path(name: str) -> AcceleratedPath:
    path = paths.find(name)
    if not isinstance(path, AcceleratedPath):
        raise InputError(f"path {name} does not compile")
    return path


def start_fields(workload: Workload) -> dict[str, np.ndarray]:
    """Return the start states by MjData field, each (nbatch, size), without controls."""
    start = fields(workload.model, workload.initial_state)
    start.pop("ctrl", None)
    return start


def supported_fields(
    start: Mapping[str, np.ndarray], engine_fields: Mapping[str, Any], engine: str
) -> dict[str, np.ndarray]:
    """Return the fields of a start that an engine has; InputError if another is not zero."""
    supported = {}
    for name, values in start.items():
        if name in engine_fields:
            supported[name] = values
        elif values.any():
            raise InputError(f"{engine} has no {name}, which is not zero in the start states")
    return supported


def save_workload(workload: Workload, peaks: Peaks, file: pathlib.Path) -> None:
    """Write a workload and the peaks of its reference run to a file, for another process."""
    file.write_bytes(pickle.dumps((portable(workload), workload.returns, peaks)))


def load_workload(model: mujoco.MjModel, file: pathlib.Path) -> tuple[Workload, Resources]:
    """Return the workload that `save_workload` wrote, and resources that hold its peaks."""
    saved: tuple[PortableWorkload, Product, Peaks] = pickle.loads(file.read_bytes())
    own, returns, peaks = saved
    workload = restore(model, own).returning(returns)
    resources = Resources(workload)
    resources.get_or_create("peaks", lambda: peaks)
    return workload, resources


def reference_peaks(workload: Workload, resources: Resources) -> Peaks:
    """Return the peaks of the reference run, which runs here unless `resources` hold its peaks."""
    peaks: Peaks = resources.get_or_create("peaks", lambda: reference_run.observe(workload).peaks)
    return peaks


def keyword_arguments(sizes: Mapping[str, int]) -> str:
    """Return sizes as keyword arguments that follow others in the text of a call."""
    return "".join(f", {name}={size}" for name, size in sizes.items())


def states_of_fields(workload: Workload, fields: Mapping[str, np.ndarray]) -> States:
    """Return states made of the fields that an engine has, with a mask of their entries."""
    columns = compat.state_columns(workload.model)
    values = np.full_like(workload.initial_state, np.nan)
    mask = np.zeros(values.shape, dtype=bool)
    for name, place in columns.items():
        if name in fields:
            values[:, place] = fields[name]
            mask[:, place] = True
    return States(values, mask)


def _is_machine_error(error: Exception) -> bool:
    """Return whether an error comes from the machine or installation rather than from a model."""
    if isinstance(error, NotImplementedError):  # a subclass of RuntimeError
        return False
    return isinstance(error, RuntimeError | MemoryError | OSError)
