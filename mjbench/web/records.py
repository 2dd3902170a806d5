"""What is stored of a model in WebAssembly builds and in C.

Frozen dataclasses. Raw times are of blocks; the same position is the same round for all paths. A
path that was left out of the last rounds has fewer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from mjbench.instrument.bounds import (
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    Version,
)
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.status import Status
from mjbench.web.rounding_check import RoundingCheck

# The path of C that others are compared with: between its steps there is no Python.
C_PATH = "rollout"


@dataclass(frozen=True)
class StartUp:
    """What a build takes before its first step, in a fresh process.

    Attributes:
      instantiate_ms: to compile and instantiate its WebAssembly, workers included.
      first_ns: per step of the first block.
      warm_up_s: seconds of blocks before the first that was about as fast as the last ones.
      heap_bytes: of the module once it is instantiated.
    """

    import_ms: NonNegativeFloat
    instantiate_ms: NonNegativeFloat
    compile_ms: NonNegativeFloat
    first_ns: PositiveFloat
    warm_up_s: NonNegativeFloat
    heap_bytes: NonNegativeInt


@dataclass(frozen=True, kw_only=True)
class WebPathRecord:
    """One path on one model.

    Attributes:
      path: its name: `wasm`, `wasm_mt`, or one of C's.
      status: `ok`, or why it has no speed.
      check: how far it is from C; None for paths of C, and where it did not run.
      start_up: what it took before it was steady; None likewise.
      block_ns: nanoseconds of each block.
      heap_bytes: of the module after all blocks; None for paths of C.
      rss_bytes: resident memory of its process after all blocks; None where it is not known.
    """

    path: str
    options: Mapping[str, Any]
    status: Status = Status.OK
    detail: str = ""
    check: RoundingCheck | None = None
    start_up: StartUp | None = None
    block_ns: Sequence[PositiveInt] = ()
    heap_bytes: NonNegativeInt | None = None
    rss_bytes: NonNegativeInt | None = None


@dataclass(frozen=True, kw_only=True)
class WebRecord:
    """One model, in C and in the WebAssembly builds of the same release.

    Attributes:
      status: `ok`, or why it was not measured to the end.
      nbatch: simulations that were compared; None where there was no workload.
      nstep: steps of each; None likewise.
      block_nbatch: simulations of a timed block, the first ones; None likewise.
      block_nstep: steps of each in a timed block, the first ones; None likewise.
      hold: steps for which each control is held.
      seed: of start states and controls.
      workload_digest: of start states and controls; empty likewise.
      starts: where start states came from; None likewise.
      work: of a step; None likewise.
      c_compile_ms: for which the process of C compiled the model; None likewise.
      paths: the base path of C first.
    """

    record_type: ClassVar[str] = "web"
    model: str
    release: Version
    node: str
    status: Status = Status.OK
    detail: str = ""
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    block_nbatch: PositiveInt | None = None
    block_nstep: PositiveInt | None = None
    hold: PositiveInt = 1
    seed: NonNegativeInt = 0
    workload_digest: str = ""
    starts: Starts | None = None
    work: Work | None = None
    c_compile_ms: NonNegativeFloat | None = None
    paths: Sequence[WebPathRecord] = ()

    def __post_init__(self) -> None:
        """Check that what was timed is described, and that rounds have all their times.

        Raises:
          ValueError: it is not.
        """
        rounds = max((len(path.block_ns) for path in self.paths), default=0)
        of_c = (len(path.block_ns) for path in self.paths if path.path == C_PATH)
        if rounds > max(of_c, default=0):
            raise ValueError(f"a path has more rounds than {C_PATH}")
        if rounds and (self.block_nbatch is None or self.block_nstep is None):
            raise ValueError("paths were timed, but the size of a block is missing")
