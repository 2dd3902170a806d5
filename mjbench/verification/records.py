"""What a comparison stores in a run file: one record a model, one record a variant.

Field names are the keys of the format (docs/formats.md). None is what was not reached or does not
apply.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mjbench import paths
from mjbench.bounds import (
    AnyFloat,
    Int64,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.simulation.accelerated_judgement import EngineJudgement, Precision
from mjbench.simulation.reference_run import ModelFacts, Work
from mjbench.simulation.starts import Starts
from mjbench.simulation.workload import Product
from mjbench.status import Status
from mjbench.verification.plan import Variant


@dataclass(frozen=True, kw_only=True)
class ModelRecord:
    """One model at one size asked for.

    Attributes:
      status: how the child ended that measured it.
      nbatch: simulations that were measured.
      hold: steps per control.
      reduced: whether sizes were reduced to keep a block short.
      spread: factor on the spread of starts and controls; below 1 where more diverges.
      diverged: simulations left out because they diverged.
      divergence: the warnings they raised.
      warnings: how many of the simulations that did not diverge raised each other warning.
      workload_digest: names start states, controls and hold.
      start_contacts: contacts at the first simulation's start.
      nbatch_asked: simulations that the user asked for; None where mjbench chose.
      usable_cores: cores that this process may use.
      total_steps: steps that the user will take in all; None where they did not say.
    """

    record_type: ClassVar[str] = "model"
    model: str
    status: Status
    detail: str = ""
    facts: ModelFacts | None = None
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    hold: PositiveInt | None = None
    returns: Product | None = None
    seed: Int64 | None = None
    reduced: bool | None = None
    diverged: NonNegativeInt | None = None
    divergence: str | None = None
    warnings: Mapping[str, NonNegativeInt] | None = None
    spread: AnyFloat | None = None
    starts: Starts | None = None
    workload_digest: str | None = None
    start_contacts: NonNegativeInt | None = None
    work: Work | None = None
    nbatch_asked: PositiveInt | None = None
    usable_cores: PositiveInt = 1
    total_steps: PositiveInt | None = None

    @property
    def size(self) -> tuple[str, int | None]:
        """Which model it is, and at which size asked for."""
        return self.model, self.nbatch_asked

    @property
    def block_steps(self) -> int | None:
        """The steps of one block, all simulations together; None before its size is known."""
        return self.nbatch * self.nstep if self.nbatch and self.nstep else None


@dataclass(frozen=True, kw_only=True)
class VariantRecord:
    """One variant on one model at one size, which a `ModelRecord` describes.

    Attributes:
      agrees: whether it does what the reference does; None where that was not compared or judged.
      judgement: of an accelerated path.
      versions: of the packages that compute on an accelerated path, by name.
      agreement: the rule that was held, or the first difference.
      precision: of an accelerated path; None for paths that run C.
      cached_compile_s: seconds of the compiler where its cache holds the program.
      gpu_memory_bytes: most memory of the GPU; None on a CPU.
      buffer_sizes: sizes of an accelerated engine's buffers, by its names for them.
      samples_s: seconds of each block of an accelerated path.
    """

    record_type: ClassVar[str] = "variant"
    model: str
    path: str
    options: Mapping[str, Any]
    status: Status
    detail: str = ""
    agrees: bool | None = None
    agreement: str = ""
    closed_loop: bool = False
    snippet: str = ""
    nbatch_asked: PositiveInt | None = None
    precision: Precision | None = None
    device: str | None = None
    trace_s: NonNegativeFloat | None = None
    compile_s: NonNegativeFloat | None = None
    cached_compile_s: NonNegativeFloat | None = None
    memory_bytes: NonNegativeInt | None = None
    gpu_memory_bytes: NonNegativeInt | None = None
    judgement: EngineJudgement | None = None
    versions: Mapping[str, str] | None = None
    buffer_sizes: Mapping[str, PositiveInt] | None = None
    samples_s: Sequence[PositiveFloat] = field(default=())

    @property
    def is_accelerated(self) -> bool:
        return self.precision is not None

    @classmethod
    def of(
        cls, model: str, variant: Variant, status: Status = Status.OK, detail: str = ""
    ) -> "VariantRecord":
        path = paths.find(variant.path)
        return cls(
            model=model,
            path=variant.path,
            options=variant.options,
            status=status,
            detail=detail,
            closed_loop=path.closed_loop,
            precision=path.precision if isinstance(path, AcceleratedPath) else None,
        )
