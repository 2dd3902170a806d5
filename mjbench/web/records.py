"""A model in WebAssembly builds and in C: what is stored, and the speeds that follow.

Frozen dataclasses. Raw times are of blocks; the same position is the same round for all paths. A
path that was left out of the last rounds has fewer.
"""

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from mjbench.bounds import (
    Int64,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    Version,
)
from mjbench.measuring import stats
from mjbench.measuring.stats import Estimate
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.status import Status
from mjbench.store.json_form import in_json
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

    @property
    def is_wasm(self) -> bool:
        """Whether it is a WebAssembly build, rather than C."""
        return self.path.startswith("wasm")


@in_json(
    *("path", "options", "status", "detail", "check", "step_ns", "steps_per_s", "ratio", "rounds"),
    *("start_up", "heap_bytes", "rss_bytes"),
)
@dataclass(frozen=True, kw_only=True)
class WebPath(WebPathRecord):
    """One path on one model, with its speed.

    Attributes:
      step_ns: of a step, the median block; None where it was not timed.
      ratio: its time over that of `rollout` on one thread, round by round; None likewise.
    """

    step_ns: float | None
    ratio: Estimate | None

    @property
    def steps_per_s(self) -> float | None:
        return 1e9 / self.step_ns if self.step_ns else None

    @property
    def rounds(self) -> int:
        return len(self.block_ns)

    @property
    def is_identical(self) -> bool | None:
        """Whether all its states were C's to the last bit; None where that was not checked."""
        return None if self.check is None else self.check.first is None

    @property
    def difference(self) -> float | None:
        """How far its last states are from C's; None where that was not checked."""
        return None if self.check is None else self.check.final.difference


@in_json(paths="path_results")
@dataclass(frozen=True, kw_only=True)
class WebRecord:
    """One model, in C and in the WebAssembly builds of the same release.

    Attributes:
      status: `ok`, or why it was not measured to the end.
      nbatch: simulations that were compared; it and what follows are None without a workload.
      block_nbatch: simulations of a timed block, the first ones.
      block_nstep: steps of each in a timed block, the first ones.
      c_compile_ms: time that C took to compile the model.
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
    seed: Int64 = 0
    workload_digest: str = ""
    starts: Starts | None = None
    work: Work | None = None
    c_compile_ms: NonNegativeFloat | None = None
    paths: Sequence[WebPathRecord] = ()

    def __post_init__(self) -> None:
        rounds = max((len(path.block_ns) for path in self.paths), default=0)
        of_c = (len(path.block_ns) for path in self.paths if path.path == C_PATH)
        if rounds > max(of_c, default=0):
            raise ValueError(f"a path has more rounds than {C_PATH}")
        if rounds and (self.block_nbatch is None or self.block_nstep is None):
            raise ValueError("paths were timed, but the size of a block is missing")

    @cached_property
    def path_results(self) -> Sequence[WebPath]:
        nstep = (self.block_nbatch or 1) * (self.block_nstep or 1)
        c_ns = next((path.block_ns for path in self.paths if path.path == C_PATH), ())
        results = []
        for path in self.paths:
            ns = path.block_ns
            step_ns = statistics.median(ns) / nstep if ns else None
            ratio = stats.speedup_in_common(ns, c_ns) if ns and c_ns else None
            results.append(WebPath(**vars(path), step_ns=step_ns, ratio=ratio))
        return results

    def statuses(self) -> Iterator[Status]:
        yield self.status
        yield from (path.status for path in self.paths)
