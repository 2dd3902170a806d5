"""What a comparison comes to: results of paths, what disturbed them, and advice.

A speed is derived only for a measurement whose final states agree.
"""

import functools
import math
import statistics
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mjbench.commands.compare.advice import (
    Advice,
    ClockAdvice,
    ThreadAdvice,
    advise,
    advise_clock,
    advise_threads,
)
from mjbench.host import conditions, disturbance
from mjbench.interval import Interval
from mjbench.paired.race_record import Loop, RaceRecord, undisturbed
from mjbench.paths import BASE
from mjbench.results.json_form import in_json
from mjbench.results.runs import Record
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status
from mjbench.verification.plan import Variant
from mjbench.verification.records import ModelRecord, VariantRecord

# A model on whose free bodies gravity acts falls where it has fewer contacts than this in a step.
_FALLING_CONTACTS = 0.05
_FALLING = (
    "Warning: a free body falls, and touches nothing: these are the speeds of free fall. Let it"
    " settle (--settle 3s), or give states of your own (--states)."
)


# Facts of the model that the JSON form of each of its results has.
_OF_MODEL = (
    *("nbatch", "nstep", "hold", "returns", "seed", "starts", "diverged", "warnings"),
    *("workload_digest", "work"),
)


@in_json(
    *("model", "path", "options", "status", "detail", "agrees", "agreement", "closed_loop"),
    *_OF_MODEL,
    *("steps_per_s", "step_ns", "realtime_factor", "speedup", "launches", "snippet"),
    *("nbatch_asked", "precision", "device", "trace_s", "compile_s", "cached_compile_s"),
    *("memory_bytes", "gpu_memory_bytes", "judgement", "versions", "buffer_sizes"),
    *("overtakes_after_steps", "disturbances"),
    **{name: f"model_record.{name}" for name in _OF_MODEL},
)
@dataclass(frozen=True, kw_only=True)
class PathResult(VariantRecord):
    """What a comparison says of one variant; None is what cannot be said.

    Attributes:
      model_record: what is known of the model, such as the size of the work.
      steps_per_s: steps of all simulations per second.
      step_ns: nanoseconds of one step of one simulation: that of the plain loop over `speedup`; of
        a path that compiles, the median of its own blocks.
      realtime_factor: simulated seconds per second, all simulations together.
      speedup: over the plain Python loop, with its 95 % interval from launch to launch; without
        ends where it is from one process, or from too few launches.
      launches: fresh processes in which it was timed.
      overtakes_after_steps: break-even: steps of the plain loop that take as long as compiling and
        running the same number; None where the plain loop is faster.
      disturbances: what disturbed its race, a clause each; empty where nothing did.
    """

    model_record: ModelRecord
    steps_per_s: float | None = None
    step_ns: float | None = None
    realtime_factor: float | None = None
    speedup: Interval | None = None
    launches: int = 0
    overtakes_after_steps: float | None = None
    disturbances: Sequence[str] = ()

    @property
    def is_judged(self) -> bool:
        """Whether what it computes could be compared with C."""
        return self.judgement is None or self.judgement.answer != EngineAnswer.NOT_JUDGED

    @property
    def difference(self) -> str:
        """What differs from C where it is close; empty otherwise."""
        is_close = self.judgement is not None and self.judgement.answer == EngineAnswer.CLOSE
        return self.judgement.reason if self.judgement is not None and is_close else ""

    @property
    def nbatch(self) -> int | None:
        """Simulations that were measured."""
        return self.model_record.nbatch

    @property
    def variant(self) -> Variant:
        return Variant(self.path, self.options)

    @property
    def interval(self) -> Interval | None:
        """The speed-up with its interval; None of the plain loop, whose speed-up is 1."""
        return None if self.variant == Variant(BASE, {}) else self.speedup

    @property
    def loop(self) -> Loop:
        """The loop that it is for: a path for closed loop serves open loop, too."""
        return Loop.CLOSED if self.closed_loop else Loop.OPEN

    @property
    def is_timed(self) -> bool:
        return self.steps_per_s is not None

    def serves(self, loop: Loop) -> bool:
        return loop == Loop.OPEN or self.closed_loop

    def rate_over(self, other: "PathResult") -> float:
        """Return this path's steps per second over another's; both must be timed."""
        assert self.steps_per_s and other.steps_per_s, "only timed results have a rate"
        return self.steps_per_s / other.steps_per_s

    def pays_after_steps(self, other_ns: float) -> float:
        """Return how many steps take another path as long as compiling and they take this one.

        It is infinity where the other path is faster, or nothing is compiled.
        """
        if self.step_ns is None or self.compile_s is None or self.step_ns >= other_ns:
            return math.inf
        return 1e9 * ((self.trace_s or 0.0) + self.compile_s) / (other_ns - self.step_ns)


@dataclass(frozen=True)
class Cores:
    """How many cores threads had, of those that they can use."""

    had: float
    wanted: int

    @property
    def share(self) -> float:
        return self.had / self.wanted

    def __str__(self) -> str:
        return f"{self.had:.2f} of {self.wanted} cores"


@dataclass(frozen=True)
class ModelResults:
    """The records of one model at one size, and what follows from them.

    Attributes:
      measurements: one a variant.
      race: of the paths that run C and agree; None before it, and where there was none.
    """

    model: ModelRecord
    measurements: Sequence[VariantRecord]
    race: RaceRecord | None = None

    @property
    def records(self) -> list[ModelRecord | VariantRecord | RaceRecord]:
        return [self.model, *self.measurements, *([self.race] if self.race else [])]

    @functools.cached_property
    def results(self) -> tuple[PathResult, ...]:
        return tuple(_result(self, each) for each in self.measurements)

    @property
    def statuses(self) -> list[Status]:
        race = [self.race.status] if self.race else []
        return [self.model.status, *(result.status for result in self.results), *race]

    @property
    def cores(self) -> Cores | None:
        """The cores that threads had: of the launch with the median share; None without threads.

        Each launch is judged by the most threads of the paths that it timed.
        """
        if self.race is None:
            return None
        cores = [
            Cores(each.cores, min(self.model.usable_cores, max(self.race.threads(each), default=1)))
            for each in undisturbed(self.race.launches)
            if each.cores is not None
        ]
        cores.sort(key=lambda each: each.share)
        return cores[(len(cores) - 1) // 2] if cores else None

    @property
    def disturbances(self) -> list[str]:
        if self.race is None:
            return []
        clauses, others = self.race.disturbance.clauses, self.race.other_cores
        if self.cores is not None and self.cores.share < conditions.ENOUGH_CORES:
            by_others = f" (other programs used {others:.1f})" if self.race.is_busy else ""
            clauses.append(f"threads had {self.cores}{by_others}")
        return clauses

    @property
    def cautions(self) -> list[str]:
        sentences = []
        if self.disturbances:
            sentences.append(disturbance.sentence(self.disturbances))
        model = self.model
        if model.facts is None or model.work is None or not model.facts.can_fall:
            return sentences
        if not model.start_contacts and model.work.contacts < _FALLING_CONTACTS:
            sentences.append(_FALLING)
        return sentences

    @property
    def base(self) -> PathResult | None:
        return self.timed(Variant(BASE, {}))

    def timed(self, variant: Variant) -> PathResult | None:
        """Return the result of a variant; None where it was not timed."""
        return next((r for r in self.results if r.variant == variant and r.is_timed), None)

    @functools.cached_property
    def advice(self) -> list[Advice]:
        return advise(self)

    @functools.cached_property
    def clock_advice(self) -> ClockAdvice | None:
        return advise_clock(self)

    @functools.cached_property
    def thread_advice(self) -> list[ThreadAdvice]:
        return advise_threads(self)

    @property
    def total_steps(self) -> int | None:
        """The steps that the user will take: those asked for, or one block; None if unknown."""
        return self.model.total_steps or self.model.block_steps


def derive_all(records: Sequence[Record]) -> list[ModelResults]:
    """Return the results of a run by model and size, in the order they were measured."""
    by_size = defaultdict[tuple[str, int | None], list[Record]](list)
    for record in records:
        if isinstance(record, ModelRecord | VariantRecord | RaceRecord):
            by_size[record.model, record.nbatch_asked].append(record)
    return [
        ModelResults(
            model,
            tuple(record for record in same if isinstance(record, VariantRecord)),
            next((record for record in same if isinstance(record, RaceRecord)), None),
        )
        for same in by_size.values()
        for model in same
        if isinstance(model, ModelRecord)
    ]


def path_results(records: Sequence[Record]) -> list[PathResult]:
    """Return the results of a whole run, one a variant; see `derive_all`."""
    return [result for each in derive_all(records) for result in each.results]


def _result(derived: ModelResults, record: VariantRecord) -> PathResult:
    """Return the result of a variant; an accelerated path is timed alone, in one process."""
    model, race = derived.model, derived.race
    base_ns = race.base_step_ns if race is not None else None
    result = PathResult(**vars(record), model_record=model, disturbances=derived.disturbances)
    speedup, launches = None, 1
    if not record.agrees or record.status != Status.OK:
        return result
    if record.samples_s and model.block_steps:
        step_ns = 1e9 * statistics.median(record.samples_s) / model.block_steps
        speedup = Interval(base_ns / step_ns, None, None) if base_ns is not None else None
    elif race is not None and base_ns is not None and (own := race.speedup(result.variant)):
        speedup, launches = own, race.launch_count(result.variant)
        step_ns = base_ns / own.estimate
    else:
        return result
    timestep = model.facts.timestep if model.facts else 0.0
    timed = replace(
        result,
        steps_per_s=1e9 / step_ns,
        step_ns=step_ns,
        # a stored timestep may be one by which no time passes
        realtime_factor=1e9 * timestep / step_ns if 0 < timestep < math.inf else None,
        speedup=speedup,
        launches=launches,
    )
    break_even = math.inf if base_ns is None else timed.pays_after_steps(base_ns)
    return replace(timed, overtakes_after_steps=break_even if math.isfinite(break_even) else None)
