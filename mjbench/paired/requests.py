"""What a worker process can be asked, and what it answers.

A request is pickled over the worker's socket and answered by `Done` or by a `Failure`; requests are
answered in the order they were sent. A timed block is not a request: after `TimeBlocks` it is one
byte there and eight bytes back, so that the time between two blocks stays short.

This module is imported inside any release, before MuJoCo and NumPy are: it needs the standard
library alone.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from mjbench.paired.outcomes import Metric
from mjbench.releases.placement import Placement

if TYPE_CHECKING:
    import numpy as np

    from mjbench.simulation.rounding_reference import RoundingReference
    from mjbench.simulation.sampling import SampleRequest
    from mjbench.simulation.starts import StartPlan, Starts
    from mjbench.simulation.work import Work
    from mjbench.simulation.work_check import Followed
    from mjbench.simulation.workload import PortableWorkload, Product

Answer = TypeVar("Answer")

# The bytes that ask for one more block, and for no more; a block answers with its nanoseconds.
BLOCK, END = b"b", b"e"
NANOSECONDS = struct.Struct("<q")


@dataclass(frozen=True)
class Request(Generic[Answer]):
    """Something that a worker is asked to do; the type parameter is what it answers.

    Class attributes:
      activity: what the worker is doing meanwhile, for error messages.
    """

    activity: ClassVar[str]


@dataclass(frozen=True)
class Done(Generic[Answer]):
    """The answer to a request that did not fail."""

    value: Answer


@dataclass(frozen=True)
class Move:
    """How to move the libraries of a release.

    Attributes:
      movable_file: a pickled `MovableInstall`.
      others: the folder of what lies beside the package.
      folder: to create the moved install in.
      placement: how far.
    """

    movable_file: Path
    others: Path
    folder: Path
    placement: Placement


@dataclass(frozen=True)
class StartRelease(Request[None]):
    """Import MuJoCo, and make sure that it is the release meant, whole.

    Attributes:
      version: that it must be.
      check_files: whether to check the whole install, rather than the version that was imported.
      seed: of the places in memory that the worker draws (see `LaunchSeeds`).
      move: how to move its libraries first; None imports it as installed.
    """

    activity = "importing MuJoCo"
    version: str
    check_files: bool
    seed: int
    move: "Move | None" = None


@dataclass(frozen=True)
class LoadModel(Request[None]):
    """Compile a model, and set fields of its `opt`.

    Attributes:
      name: of the model, for error messages.
      file: that holds it.
      options: fields of `model.opt` to set, by name; a number, or the name of an enum's value.
    """

    activity = "loading the model"
    name: str
    file: Path
    options: Mapping[str, str]


@dataclass(frozen=True)
class SaveModel(Request[None]):
    """Save the loaded model to a file, so that launches need not compile it again."""

    activity = "saving the model"
    file: Path


@dataclass(frozen=True)
class MeasureStepCost(Request["StepCost"]):
    """Return about how long one step takes now, at the start, and the model's digest.

    Attributes:
      starts: where start states are to come from.
      nstart: different starts wanted.
      hold: steps per control.
    """

    activity = "measuring a step"
    starts: "StartPlan"
    nstart: int
    hold: int


@dataclass(frozen=True)
class MeasureSettledCost(Request[float]):
    """Return about how many seconds one step takes in the model's typical regime."""

    activity = "measuring a step"


@dataclass(frozen=True)
class MakeWorkload(Request["DrawnWorkload"]):
    """Draw a workload for the loaded model (see `sampling.draw`)."""

    activity = "making the workload"
    sample: "SampleRequest"


@dataclass(frozen=True)
class Observe(Request["Observed"]):
    """Read a workload, do it once the plain way, and return what it was.

    Attributes:
      workload_file: holds a pickled `PortableWorkload`.
      nsection: sections that all simulations of it together are to be divided into (see
        `loop_sections`); 1 for no division.
    """

    activity = "stepping the model"
    workload_file: Path
    nsection: int = 1


@dataclass(frozen=True)
class Trace(Request["Traced"]):
    """Read a workload, and return what C does with it, for an engine that only rounds otherwise.

    Attributes:
      workload_file: holds a pickled `PortableWorkload`.
      seed: of the shadow's moves.
    """

    activity = "stepping the model"
    workload_file: Path
    seed: int


@dataclass(frozen=True)
class ListFiles(Request[tuple[str, ...]]):
    """Return which files a model is compiled from: its own, and all that it names.

    Attributes:
      file: of the model.
    """

    activity = "listing the model's files"
    file: Path


@dataclass(frozen=True)
class Equip(Request[None]):
    """Read a saved model and a workload, and import what a run needs.

    Attributes:
      model_file: holds the model.
      workload_file: holds a pickled `PortableWorkload`.
      path: its name.
    """

    activity = "reading the workload"
    model_file: Path
    workload_file: Path
    path: str


@dataclass(frozen=True)
class Prepare(Request[int]):
    """Prepare a path's run in fresh memory, and check it.

    The answer is how many nanoseconds one block of each section takes, untimed warm-ups included.

    Attributes:
      path: its name.
      options: of the path.
      cores: to run on.
      simulations: rows of the workload to do.
      callback: function of the engine that steps call (see `engine_library`); empty for none.
      slowdown: share of its time by which each block lasts longer: the process spins meanwhile.
      returns: what the run returns; None for final states.
      metric: what blocks are to give: their time, or that of their slowest steps.
      nsection: sections of the run, which blocks time one after the other (see `loop_sections`); 1
        with any path but the plain loop.
      has_timer: whether steps read the timer of MuJoCo's Python package, as they do in a program.
    """

    activity = "preparing a run"
    path: str
    options: Mapping[str, Any]
    cores: Sequence[int]
    simulations: Sequence[int]
    callback: str = ""
    slowdown: float = 0.0
    returns: "Product | None" = None
    metric: Metric = Metric.TIME
    nsection: int = 1
    has_timer: bool = True


@dataclass(frozen=True)
class EquipRace(Request[None]):
    """Read a saved model and a workload for the paths of a race (see `race_blocks`).

    Attributes:
      model_file: holds the model.
      workload_file: holds a pickled `PortableWorkload`, with its final states.
      returns: what runs return.
      cores: to run on.
      import_from: a folder that paths of the user's own may be imported from; None for none.
    """

    activity = "reading the workload"
    model_file: Path
    workload_file: Path
    returns: "Product"
    cores: Sequence[int]
    import_from: str | None = None


@dataclass(frozen=True)
class PrepareEntrant(Request[None]):
    """Prepare one more path of a race, and check it.

    Attributes:
      path: its name.
      options: of the path.
    """

    activity = "preparing a run"
    path: str
    options: Mapping[str, Any]


@dataclass(frozen=True)
class TimeEntrant(Request["TimedEntrant"]):
    """Run one block of a path of a race.

    Attributes:
      number: of the path, in the order in which they were prepared.
      reorders: whether the simulations are reordered first, as they are before each round.
    """

    activity = "timing a block"
    number: int
    reorders: bool


@dataclass(frozen=True)
class PrepareOperation(Request["ReadyOperation"]):
    """Prepare an operation in fresh memory, do it, and return nanoseconds of a block.

    Attributes:
      name: of the operation (see `operations`).
      file: of its model; not read where it has none.
      cores: to run on.
    """

    activity = "preparing an operation"
    name: str
    file: Path
    cores: Sequence[int]


@dataclass(frozen=True)
class TimeBlocks(Request[None]):
    """Run a block for every BLOCK byte that follows, until an END byte.

    The first two blocks are of the first section of the run, the next two of the second, and so on;
    after the last section, the first is next. So the blocks of a quad are of one section.
    """

    activity = "running a block"


@dataclass(frozen=True)
class CountCores(Request[float]):
    """Return how many cores `nthread` threads get now (see `machine.Calibration`)."""

    activity = "counting cores"
    nthread: int


@dataclass(frozen=True)
class TimedEntrant:
    """A block of a path of a race.

    Attributes:
      ns: nanoseconds that it took.
      difference: where what it returned first differs from the plain loop; empty where it does not.
    """

    ns: int
    difference: str


@dataclass(frozen=True)
class StepCost:
    """What a step costs.

    Attributes:
      digest: of the model (see `model_digest`).
      step_s: seconds of a step at the start, as they are now.
      settling_nstep: steps of the run along which starts are to be sampled, if nothing bounds it.
      most_nstep: steps of a simulation that the user's files have controls for; None for any
        number.
      has_sleep: whether the model enables sleeping.
    """

    digest: str
    step_s: float
    settling_nstep: int
    most_nstep: int | None
    has_sleep: bool


@dataclass(frozen=True, eq=False)
class ReadyOperation:
    """An operation that is ready to be timed.

    Attributes:
      ns: nanoseconds of a warm block.
      result: what it computed, as a vector of floats.
    """

    ns: int
    result: "np.ndarray"


@dataclass(frozen=True, eq=False)
class DrawnWorkload:
    """A workload that was drawn, with states along it (see `work_check.probe`).

    Attributes:
      workload: what both targets do.
      starts: where its start states came from.
    """

    workload: "PortableWorkload"
    starts: "Starts"


@dataclass(frozen=True, eq=False)
class Observed:
    """What a target did with a workload, stepped the plain way.

    Attributes:
      work: contacts, constraints and solver iterations per step.
      healthy: (nbatch,) whether a simulation did not diverge.
      diagnosis: why others diverged, such as `BADQACC in 3`; empty without any.
      warnings: how many healthy simulations raised each other warning, by its name.
      final_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION after the last step.
      followed: what the target did from the states of the workload's probe.
      can_divide: whether its healthy simulations can be divided into the sections asked for.
      timestep_s: of the model.
    """

    work: "Work"
    healthy: "np.ndarray"
    diagnosis: str
    warnings: Mapping[str, int]
    final_state: "np.ndarray"
    followed: "Followed"
    can_divide: bool
    timestep_s: float


@dataclass(frozen=True, eq=False)
class Traced:
    """What C did with a workload, and from states along it."""

    reference: "RoundingReference"
