"""What the children of a comparison are asked, and the messages that they send back.

Frozen dataclasses, pickled from process to process (see `mjbench.host.isolate`). A variant is
named by its index in the plan.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.simulation.accelerated_limits import AcceleratedCheck
from mjbench.simulation.models import ModelSource
from mjbench.status import Status


@dataclass(frozen=True)
class ListRequest:
    """The models to describe (see `listing`)."""

    sources: tuple[ModelSource, ...]


@dataclass(frozen=True)
class ModelFiles:
    """Where a model and its workload are saved, so that other processes do the same work.

    Attributes:
      model: compiled.
      workload: a pickled `PortableWorkload`, with its final states, for the launches of a race.
      accelerated: the workload for paths that compile (see `accelerated.save_workload`).
    """

    model: Path
    workload: Path
    accelerated: Path

    @classmethod
    def in_folder(cls, folder: Path) -> "ModelFiles":
        """Return the files of one model in a folder of its own."""
        names = ("model.mjb", "workload.pickle", "accelerated.pickle")
        return cls(*(folder / name for name in names))


@dataclass(frozen=True)
class MeasureRequest:
    """One model and the paths to verify on it (see `measure`).

    Attributes:
      exclude: variants not to touch: those that killed a child before, and accelerated ones.
      files: to write.
    """

    source: ModelSource
    plan: ComparisonPlan
    exclude: frozenset[int]
    files: ModelFiles


@dataclass(frozen=True)
class AcceleratedRequest:
    """One model and one path that compiles, measured alone (see `accelerated_run`).

    Attributes:
      workload_file: that `save_workload` wrote.
      is_named: whether the user asked for this path by name.
      limit_s: seconds of silence after which the child is killed.
    """

    source: ModelSource
    variant: Variant
    workload_file: Path
    is_named: bool
    limit_s: float


@dataclass(frozen=True)
class AgreementReport:
    """Whether a variant does what the reference run does, so that it may be timed.

    Attributes:
      index: of the variant, or of a vectorised form; 0 from a child that measures one variant
        alone.
      status: `ok`, or why it is not timed.
      agrees: None where it was not compared.
      agreement: the rule that was held, or the first difference.
      check: of an accelerated path; None for others.
    """

    index: int
    status: Status
    detail: str = ""
    agrees: bool | None = None
    agreement: str = ""
    snippet: str = ""
    check: AcceleratedCheck | None = None


@dataclass(frozen=True)
class CompileReport:
    """What compiling a path took.

    Attributes:
      trace_s: seconds of tracing; None where there is no such stage.
      workload_digest: of the workload that the child received.
    """

    device: str
    trace_s: float | None
    compile_s: float
    workload_digest: str
    buffer_sizes: Mapping[str, int]


@dataclass(frozen=True)
class CachedCompile:
    """Seconds of the compiler where the engine's cache holds the program; None where unknown."""

    seconds: float | None


@dataclass(frozen=True)
class BlockTime:
    """Seconds of one steady block of an accelerated path."""

    seconds: float


@dataclass(frozen=True)
class PeakMemory:
    """The most memory that the process, and the GPU, had; None where that is not known."""

    memory_bytes: int
    gpu_memory_bytes: int | None
