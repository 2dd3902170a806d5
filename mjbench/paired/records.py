"""The rows and records of paired comparisons: what `--json` gives, and what a run file stores.

Field names are the keys of the JSON format (docs/formats.md); there the baseline is `old` and the
candidate `new`, as on the command line.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from mjbench.bounds import (
    AnyFloat,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TwoOf,
)
from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.measuring import stats
from mjbench.measuring.calls import Compilation
from mjbench.paired.call_results import ResultsDifference
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Cause, ResultsOutcome, Verdict
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.simulation import changed_work
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.simulation.state_drift import RunDrift, StateDrift
from mjbench.status import Status

_Value = TypeVar("_Value")
# Larger e-values are stored as this.
MAX_E_VALUE = 1e12


@dataclass(frozen=True)
class TargetRow:
    """One of the two targets.

    Attributes:
      model_options: fields of `model.opt` that were set, by name.
      build: tells builds of one version apart; empty where it is unknown.
      has_timer: whether steps read the timer of MuJoCo's Python package.
      revision: of the user's code, as it was named; empty where releases are compared.
      commit: its full hash; empty where it is not committed.
      tree: the hash of its files.
      packages: that the user named, such as `jax==0.7.0`; empty where releases are compared.
    """

    release: str
    model: str
    path: str
    options: Mapping[str, Any]
    model_options: Mapping[str, str]
    build: str = ""
    has_timer: bool = True
    revision: str = ""
    commit: str = ""
    tree: str = ""
    packages: str = ""

    @property
    def label(self) -> str:
        """What the side is called beside the other one."""
        return self.revision or self.packages or self.release


@dataclass(frozen=True)
class ControlRow:
    """The baseline against itself, in launches beside those of a verdict.

    Attributes:
      ratio: of time; 1 but for noise.
      covers: whether the interval holds 1, as it should.
    """

    ratio: Interval
    launches: NonNegativeInt
    covers: bool


@dataclass(frozen=True)
class Pair(Generic[_Value]):
    """A value of the baseline, and the same of the candidate."""

    old: _Value
    new: _Value


@dataclass(frozen=True)
class PackageVersions:
    """The versions of a package in two environments; empty where it is not installed."""

    name: str
    old: str
    new: str


@dataclass(frozen=True)
class CompilationFigures:
    """What the processes of one side took, as medians over them.

    A median has no interval where there are fewer than six processes. Where launches read the
    compiler's cache, `compile_s` is of the process before them.

    Attributes:
      trace_s: from Python to the compiler's input; None without such a stage.
      compile_s: of the compiler without a cache; None where no process did without.
      first_run_s: of the first run after that.
      steady_run_s: of a run that is timed; None where compiling is what is compared.
      programs: how many the compiler was asked for, single operations included; None where it does
        not tell.
      processes: that traced, and made a first run.
      compiling_processes: that compiled without a cache.
    """

    trace_s: Interval | None
    compile_s: Interval | None
    first_run_s: Interval
    steady_run_s: Interval | None
    programs: NonNegativeInt | None
    processes: NonNegativeInt
    compiling_processes: NonNegativeInt

    @classmethod
    def of(
        cls, compilations: Sequence[Compilation], steady_run_s: Sequence[float]
    ) -> "CompilationFigures":
        """Return the figures of one side.

        Args:
          compilations: of each of its processes, one or more.
          steady_run_s: of each launch; none where compiling is what is compared.
        """
        fresh = [c for c in compilations if not c.is_cached]
        return cls(
            _median(c.trace_s for c in compilations if c.trace_s is not None),
            _median(c.compile_s for c in fresh),
            stats.median_of([c.first_run_s for c in compilations]),
            _median(steady_run_s),
            max((c.programs for c in compilations if c.programs is not None), default=None),
            len(compilations),
            len(fresh),
        )


def _median(samples: Iterable[float]) -> Interval | None:
    values = [*samples]
    return stats.median_of(values) if values else None


@dataclass(frozen=True)
class WorkDifference:
    """What both targets do, and how it differs.

    Attributes:
      baseline: None where it is not known.
      drift: how far qpos, qvel and act differ; None where the models differ in size.
      diverged: simulations that diverged in the baseline, and in the candidate; none of those is
        timed.
      warnings: how many other simulations raised each warning, in the baseline, and in the
        candidate.
      nbatch: simulations that are timed; 0 where none is.
      candidate_starts: where those of the candidate came from; None where both start alike.
    """

    baseline: Work | None
    candidate: Work | None
    drift: StateDrift | None
    diverged: tuple[int, int]
    warnings: tuple[Mapping[str, int], Mapping[str, int]]
    nbatch: int = 0
    nstep: int = 0
    starts: Starts | None = None
    candidate_starts: Starts | None = None
    timesteps_s: tuple[float, float] = (1.0, 1.0)

    @property
    def log_scale(self) -> float:
        """What to add to the log ratio of a step's time for that of a simulated second's."""
        return math.log(self.timesteps_s[0] / self.timesteps_s[1])

    @property
    def changes(self) -> list[str]:
        """How the work changed, in a few words each; empty where it is the same."""
        one_step = self.drift.one_step if self.drift else None
        return changed_work.work_changes(self.baseline, self.candidate, one_step, self.diverged)

    @property
    def works(self) -> Pair[Work] | None:
        if self.baseline is None or self.candidate is None:
            return None
        return Pair(self.baseline, self.candidate)


@dataclass(frozen=True)
class Judgement:
    """What launches show about the ratio of candidate time to baseline time.

    Attributes:
      enough: whether more launches are unnecessary for the verdict and precision asked for.
      e_slower: e-value against "not slower" (see `launch_stats.Fit.e_values`); 1 is no evidence,
        and None that none is needed.
    """

    verdict: Verdict
    ratio: Interval
    launches: int
    enough: bool
    e_slower: float | None = 1.0
    e_faster: float | None = 1.0


@dataclass(frozen=True)
class PlacementEffect:
    """What the placement of code has to do with a ratio of times.

    Attributes:
      averaged: whether `VerdictRow.ratio` is an average over placements of both sides; it compares
        the builds as they are shipped otherwise.
      problem: why it is not, although it was to be; empty otherwise.
      as_shipped: the ratio of the builds as they are shipped; None where it was not measured.
      effect: that ratio over the averaged one.
    """

    averaged: bool
    problem: str = ""
    as_shipped: Interval | None = None
    effect: Interval | None = None


@dataclass(frozen=True, kw_only=True)
class VerdictRow:
    """One paired comparison, as people and programs read it; None is what cannot be said.

    Attributes:
      model: or the function of the user's code, such as `bench.py::step`.
      path: of stepping; empty for a function.
      metric: what `ratio` compares.
      detail: one line; empty when ok.
      verdict: None where nothing was measured.
      ratio: of time, or of instructions; of the time of a simulated second where timesteps differ.
      e_slower: evidence that it is slower, as an e-value (see `launch_stats.Fit.e_values`), and at
        most MAX_E_VALUE; None for instructions.
      cause: why the times of two builds differ; None where they do not, or the targets differ in
        more than the build.
      placement: of machine code; None for instructions.
      work: contacts, constraints, solver iterations per step.
      drift: largest difference of qpos, qvel and act one step after the same states, at several
        points of the run, relative to each field.
      run_drift: the same for runs from the same starts, at several points.
      diverged: simulations that diverged; none of them is timed.
      warnings: how many of the others raised each warning of MuJoCo.
      starts: where start states came from; those of the baseline where `candidate_starts` is given.
      candidate_starts: where those of the candidate came from, where each model settled by itself.
      timesteps_s: where the two differ; None elsewhere.
      launches: in all, those as shipped included.
      pairs: of blocks, over all launches.
      seconds: from start to verdict.
      results: how what a function returned compares; None for models.
      results_detail: where it first differs, or why it was not compared; empty otherwise.
      control: None where nothing of the kind was measured.
      calls_s: seconds of a call of a function; None for models.
      slowing: the time of a block at the end of a launch over that at its beginning, the median;
        None for models.
      packages: of both environments, where the user named packages; else none.
      compiling: of both sides; None for what is not compiled first.
    """

    model: str
    path: str
    old: str
    new: str
    sides: TwoOf[TargetRow]
    metric: Metric = Metric.TIME
    status: Status
    detail: str = ""
    verdict: Verdict | None = None
    ratio: Interval | None = None
    e_slower: NonNegativeFloat | None = None
    e_faster: NonNegativeFloat | None = None
    cause: Cause | None = None
    placement: PlacementEffect | None = None
    changed_work: bool | None = None
    work: Pair[Work] | None = None
    drift: AnyFloat | None = None
    run_drift: Sequence[RunDrift] = ()
    diverged: Pair[NonNegativeInt] | None = None
    warnings: Pair[Mapping[str, NonNegativeInt]] | None = None
    nbatch: PositiveInt | None = None
    nstep: PositiveInt | None = None
    starts: Starts | None = None
    candidate_starts: Starts | None = None
    timesteps_s: Pair[PositiveFloat] | None = None
    launches: NonNegativeInt = 0
    pairs: NonNegativeInt = 0
    seconds: NonNegativeFloat = 0.0
    results: ResultsOutcome | None = None
    results_detail: str = ""
    control: ControlRow | None = None
    calls_s: Pair[PositiveFloat] | None = None
    slowing: PositiveFloat | None = None
    packages: Sequence[PackageVersions] = ()
    compiling: Pair[CompilationFigures] | None = None


@dataclass(frozen=True)
class LaunchRow:
    """Raw times of one launch.

    Where the run is divided into sections, all layouts do the same run; otherwise each draws anew.

    Attributes:
      core: that both targets ran on; None where they used all.
      cores: that as many threads as the targets have got just before; None for one thread.
      orders: of each quad, `ABBA` or `BAAB`; A is the baseline.
      ns: (quads, 4) nanoseconds of each block, in the order they ran.
      layouts: how many quads each layout of memory has, in the order they ran.
      nsection: sections of a run, which the quads of a layout take in turn; a block is one section.
      compilations: of both sides' processes; None for work that is not compiled first.
    """

    core: NonNegativeInt | None
    cores: PositiveFloat | None
    orders: Sequence[str]
    ns: Sequence[Sequence[PositiveInt]]
    placements: PlacementPair = AS_SHIPPED
    layouts: Sequence[PositiveInt] = ()
    nsection: PositiveInt = 1
    compilations: Pair[Compilation] | None = None

    def __post_init__(self) -> None:
        if len(self.orders) != len(self.ns) or any(len(quad) != 4 for quad in self.ns):
            raise ValueError("ns has four times for each order")
        if not set(self.orders) <= {"ABBA", "BAAB"}:
            raise ValueError("an order is ABBA or BAAB")

    @property
    def block_s(self) -> Pair[float]:
        """Median seconds of a block of the baseline, and of the candidate."""
        both = stats.blocks_by_target(self.orders, np.asarray(self.ns, dtype=float))
        return Pair(*(1e-9 * float(np.median(blocks)) for blocks in both))

    @property
    def slowing(self) -> float:
        """Time of the last quarter of the blocks over that of the first; medians."""
        ns = np.ravel(self.ns)
        count = -(-len(ns) // 4)
        return float(np.median(ns[-count:]) / np.median(ns[:count]))

    @cached_property
    def log_ratio(self) -> float:
        """The log ratio of all that was timed (see `stats.total_log_ratio`).

        Its parts are the sections of each run.
        """
        layouts = self.layouts or [len(self.orders)]  # without any, all quads have the same
        runs = range(len(layouts)) if self.nsection == 1 else [0] * len(layouts)
        parts = section_numbers(layouts, runs, self.nsection)
        return stats.total_log_ratio(self.orders, np.asarray(self.ns, dtype=float), parts)


def section_numbers(layouts: Sequence[int], runs: Sequence[int], nsection: int) -> np.ndarray:
    """Return (quads,) numbers that are equal where quads timed the same section of a run.

    Args:
      layouts: quads of each layout, which take the sections in turn.
      runs: which run each layout did: numbers that are equal where the simulations are.
    """
    return np.concatenate(
        [
            run * nsection + np.arange(count) % nsection
            for run, count in zip(runs, layouts, strict=True)
        ]
    )


@dataclass(frozen=True, kw_only=True)
class VerdictRecord(VerdictRow):
    """A verdict as a run file stores it, with the raw times of every launch."""

    record_type: ClassVar[str] = "verdict"
    samples: Sequence[LaunchRow] = ()

    @classmethod
    def of(
        cls,
        sides: tuple[TargetRow, TargetRow],
        metric: Metric,
        ending: Failure,
        judgement: Judgement | None = None,
        work: WorkDifference | None = None,
        results: ResultsDifference | None = None,
        launches: Sequence[LaunchRow] = (),
        seconds: float = 0.0,
    ) -> "VerdictRecord":
        """Return the verdict on two sides.

        Args:
          ending: how the launches ended; `OK` also where time ran out.
          judgement: of the launches; None without any.
        """
        baseline, candidate = sides
        undecided = Verdict.INCONCLUSIVE if ending.status == Status.OK else None
        works = work.works if work else None
        drift = work.drift if work else None
        is_changed = bool(work.changes) if work and works else None
        return cls(
            model=candidate.model,
            path=candidate.path,
            old=baseline.label,
            new=candidate.label,
            sides=sides,
            metric=metric,
            status=ending.status,
            detail=ending.detail,
            verdict=judgement.verdict if judgement else undecided,
            ratio=judgement.ratio if judgement else None,
            e_slower=_bounded(judgement.e_slower) if judgement else None,
            e_faster=_bounded(judgement.e_faster) if judgement else None,
            changed_work=results.is_changed if results else is_changed,
            work=works,
            drift=drift.one_step if drift else None,
            run_drift=drift.runs if drift else (),
            diverged=Pair(*work.diverged) if work else None,
            warnings=Pair(*work.warnings) if work else None,
            nbatch=(work and work.nbatch) or None,
            nstep=(work and work.nstep) or None,
            starts=work.starts if work else None,
            candidate_starts=work.candidate_starts if work else None,
            timesteps_s=Pair(*work.timesteps_s) if work and work.log_scale else None,
            launches=len(launches),
            pairs=2 * sum(len(launch.orders) for launch in launches),
            seconds=seconds,
            results=results.outcome if results else None,
            results_detail=results.detail if results else "",
            samples=launches,
        )

    def uninterrupted(self) -> "VerdictRecord":
        """Return the record; KeyboardInterrupt if the user stopped what it is of."""
        if self.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        return self

    def row(self) -> VerdictRow:
        """Return the verdict without its samples."""
        return VerdictRow(**{f.name: getattr(self, f.name) for f in fields(VerdictRow)})


def _bounded(e_value: float | None) -> float | None:
    return None if e_value is None else min(e_value, MAX_E_VALUE)
