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
      import_ms: to import its module.
      instantiate_ms: to compile and instantiate its WebAssembly, workers included.
      heap_bytes: of the module.
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
      heap_bytes: of the module.
      rss_bytes: resident, of the whole process.
    """

    heap_bytes: NonNegativeInt
    rss_bytes: NonNegativeInt


@dataclass(frozen=True)
class HeapGrowth:
    """What became of a stored view of `data.qpos` when the heap grew.

    Attributes:
      created: further MjData that made the heap grow.
      heap_bytes: of the heap before.
      grown_bytes: of the heap after.
      length: of the view before.
      grown_length: of the same view after.
      is_live: whether it still shows what `data.qpos` has.
      new_length: of a view that was taken after.
    """

    created: PositiveInt
    heap_bytes: PositiveInt
    grown_bytes: PositiveInt
    length: PositiveInt
    grown_length: NonNegativeInt
    is_live: bool
    new_length: NonNegativeInt


@dataclass(frozen=True)
class StoredViews:
    """What a log of the falling cart-pole shows of the tip's x.

    Attributes:
      nstep: steps.
      views_range_m: where views of `data.site_xpos` were stored.
      copies_range_m: where copies were.
    """

    nstep: PositiveInt
    views_range_m: NonNegativeFloat
    copies_range_m: NonNegativeFloat


@dataclass(frozen=True)
class ObjectMemory:
    """By how much the heap grew while objects were created one after the other.

    Attributes:
      count: of objects, each time.
      deleted_bytes: where each was deleted.
      undeleted_bytes: where none was, and nothing referred to them.
      again_bytes: where none was, after a garbage collection.
      ncon: contacts in each; 0 where they are not contacts.
    """

    count: PositiveInt
    deleted_bytes: NonNegativeInt
    undeleted_bytes: NonNegativeInt
    again_bytes: NonNegativeInt
    ncon: NonNegativeInt = 0


@dataclass(frozen=True)
class StateTarget:
    """Whether `mj_getState` writes to an array of JavaScript, and to one on the heap.

    Attributes:
      is_array_written: to a Float64Array.
      is_buffer_written: to a DoubleBuffer.
      error: that the first raised; empty without one.
    """

    is_array_written: bool
    is_buffer_written: bool
    error: str


@dataclass(frozen=True)
class HeapLimit:
    """How many MjData of a box on a plane fit into the heap.

    Attributes:
      size: MJCF that says how large an MjData is; empty for the default.
      count: of MjData.
      heap_bytes: of the heap then.
      error: that the next one raised.
    """

    size: str
    count: PositiveInt
    heap_bytes: PositiveInt
    error: str


@dataclass(frozen=True)
class FilledHeap:
    """How many MjData fill the heap: of the default size, and of a smaller one."""

    limits: Sequence[HeapLimit]


@dataclass(frozen=True)
class Examined:
    """What experiments with a build showed (see experiments.mjs).

    Attributes:
      growth: of the heap, and a stored view.
      snapshot: a log of stored views, and one of copies.
      data: what MjData take.
      contact: what copies of contacts take.
      state: what `mj_getState` writes to.
    """

    growth: HeapGrowth
    snapshot: StoredViews
    data: ObjectMemory
    contact: ObjectMemory
    state: StateTarget


@dataclass(frozen=True)
class Rotated:
    """Rotations by some angles.

    Attributes:
      quaternions: of each: w, x, y, z.
    """

    quaternions: Sequence[tuple[float, float, float, float]]


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
      script: the module's file.
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
      nbatch: simulations.
      ncontrol: controls of each.
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


@dataclass(frozen=True)
class Examine(Request[Examined]):
    """Try what goes wrong with the memory of a module.

    Attributes:
      cartpole_file: MJCF of the model whose pole falls from keyframe 0.
    """

    action, answer, activity = "examine", Examined, "trying the module's memory"
    cartpole_file: str


@dataclass(frozen=True)
class FillHeap(Request[FilledHeap]):
    """Fill the heap of a module that did nothing before."""

    action, answer, activity = "fill", FilledHeap, "filling the heap"


@dataclass(frozen=True)
class Rotate(Request[Rotated]):
    """Rotate about the z axis: the engine computes a sine and a cosine for each.

    Attributes:
      angles: in rad.
    """

    action, answer, activity = "rotate", Rotated, "computing sines and cosines"
    angles: Sequence[float]
