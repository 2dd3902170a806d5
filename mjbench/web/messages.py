"""What the Node program is asked, and what it answers: lines of JSON (see runner.mjs).

A request is a frozen dataclass with the name of its action and the type of its answer. Arrays are
in files, as float64 of this processor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from mjbench.instrument.bounds import NonNegativeFloat, NonNegativeInt, PositiveInt

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Nothing:
    """The answer to a request that is done once it is answered."""


@dataclass(frozen=True)
class Instantiated:
    """A build that is ready.

    Attributes:
      version: of the engine.
      instantiate_ms: to compile and instantiate its WebAssembly, workers included.
      has_threadpool: whether the engine can have a thread pool of its own.
    """

    version: str
    import_ms: NonNegativeFloat
    instantiate_ms: NonNegativeFloat
    heap_bytes: NonNegativeInt
    has_threadpool: bool


@dataclass(frozen=True)
class LoadedModel:
    """A model that the build compiled, and an MjData of it.

    Attributes:
      compile_ms: to compile the model, or to read it from an .mjb file.
    """

    compile_ms: NonNegativeFloat


@dataclass(frozen=True)
class BlockTime:
    """How long a block took, in nanoseconds."""

    ns: PositiveInt


@dataclass(frozen=True)
class Memory:
    """Memory of a Node process.

    Attributes:
      rss_bytes: resident, of the whole process.
    """

    heap_bytes: NonNegativeInt
    rss_bytes: NonNegativeInt


@dataclass(frozen=True)
class Request(Generic[Answer]):
    """Something that the Node program is asked to do; the type parameter is what it answers.

    Class attributes:
      action: its name there.
      answer: the type of the answer.
      activity: what the process is doing meanwhile, for error messages.
    """

    action: ClassVar[str]
    answer: ClassVar[type]
    activity: ClassVar[str]


@dataclass(frozen=True)
class Instantiate(Request[Instantiated]):
    """Import a build's module, and instantiate its WebAssembly.

    Attributes:
      nthread: workers of a build with threads.
    """

    action, answer, activity = "instantiate", Instantiated, "instantiating the module"
    script: str
    nthread: int


@dataclass(frozen=True)
class LoadModel(Request[LoadedModel]):
    """Put files into the module's own file system, and compile a model from them.

    Attributes:
      files: pairs of a path there, and a file here.
      model: path of the model there.
      engine_threads: of the engine's own thread pool; 0 for none.
    """

    action, answer, activity = "load", LoadedModel, "loading the model"
    files: Sequence[tuple[str, str]]
    model: str
    engine_threads: int = 0


@dataclass(frozen=True)
class Steps:
    """A workload in files.

    Attributes:
      starts_file: (nbatch, nstate) rows of mjSTATE_INTEGRATION.
      control_file: (nbatch, ncontrol, nu) controls.
      hold: steps for which each control is held.
      has_reset: whether an MjData must be reset between simulations.
    """

    starts_file: str
    control_file: str
    nbatch: int
    ncontrol: int
    hold: int
    has_reset: bool


@dataclass(frozen=True)
class Record(Steps, Request[Nothing]):
    """Step a workload, and write the states after some numbers of steps.

    Attributes:
      points: numbers of steps.
      states_file: to be written: (npoint, nbatch, nstate).
    """

    action, answer, activity = "record", Nothing, "stepping the model"
    points: Sequence[int]
    states_file: str


@dataclass(frozen=True)
class Prepare(Steps, Request[Nothing]):
    """Prepare blocks that step a workload."""

    action, answer, activity = "prepare", Nothing, "preparing a run"


@dataclass(frozen=True)
class Block(Request[BlockTime]):
    """Step the prepared workload once."""

    action, answer, activity = "block", BlockTime, "running a block"


@dataclass(frozen=True)
class SaveStates(Request[Nothing]):
    """Write the final states of the last block: (nbatch, nstate)."""

    action, answer, activity = "save", Nothing, "saving states"
    states_file: str


@dataclass(frozen=True)
class MeasureMemory(Request[Memory]):
    """Say how much memory is in use."""

    action, answer, activity = "memory", Memory, "measuring memory"
