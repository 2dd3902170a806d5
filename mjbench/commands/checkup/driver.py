"""Driver of the check-up: what to do about a simulation that is slow.

A check-up asks the commands that look closer, each for a short time, and stores their records.
"""

import contextlib
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from mjbench.commands.checkup import combination, targets
from mjbench.commands.checkup.options import CheckupOptions
from mjbench.commands.checkup.result import CheckedPart, CheckupPart
from mjbench.commands.checkup.targets import CheckedSource, ProgramFile
from mjbench.commands.compare import driver as model_comparison
from mjbench.commands.env import driver as environments
from mjbench.commands.env.child_process import EnvironmentPlan
from mjbench.commands.env.source import EnvironmentSource
from mjbench.commands.lint import check as lint
from mjbench.commands.profile import measure as profile
from mjbench.commands.run import launch
from mjbench.commands.run import measure as run_measure
from mjbench.commands.run.options import PROGRAM_S
from mjbench.commands.tune.c_search import SearchPlan
from mjbench.commands.tune.driver import tune
from mjbench.commands.tune.result import TuneRecord
from mjbench.errors import Failure, InputError, MjbenchError, describe_unforeseen
from mjbench.host import isolate, machine, platforms
from mjbench.limits import TIME_LIMIT_S
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, failure_of_model
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.status import Status
from mjbench.verification import selection
from mjbench.verification.plan import ComparisonPlan
from mjbench.verification.records import ModelRecord

TOTAL_S, QUICK_S = CheckupOptions.EACH_S, CheckupOptions.QUICK_S


@dataclass(frozen=True)
class _Times:
    """Seconds of the parts of a check-up.

    Attributes:
      end: from the beginning to when nothing begins any more.
      paths: of the race.
      together: of what is measured as a whole, once the models are loaded.
      program: of a program in all, unless --seconds alone says it.
      environment: in all.
    """

    end: float
    paths: float
    together: float
    program: float
    environment: float

    def scaled(self, factor: float) -> "_Times":
        """Return these times for a longer or shorter check-up."""
        return _Times(**{name: factor * seconds for name, seconds in vars(self).items()})


_FULL = _Times(end=TOTAL_S, paths=14.0, together=5.0, program=40.0, environment=20.0)
_QUICK = _Times(end=QUICK_S, paths=QUICK_S, together=0.0, program=9.0, environment=8.0)
# Seconds that a race, and measuring something as a whole, take beside their time limit: processes
# start, and end.
_STARTING_S = 4.0
# Seconds that tuning, and measuring something as a whole, need at least.
_LEAST_TUNING_S, _LEAST_TOGETHER_S = 5.0, 2.0
# Ways of stepping that race, beside the plain loop: others rarely win, and cost each of these time.
_PATHS, _OPTIONS = ("rollout", "batch_step", "batch_rollout"), ("pool=kept", "data=shared")
# Seconds after which a program should step.
_STARTING_PROGRAM_S = 20.0
# Changes that are measured together, at least: one alone has its figure.
_SEVERAL = 2

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class CheckupPlan:
    """How something is checked.

    Attributes:
      limit_s: a child process that is silent for longer is killed.
      budget_s: for all parts; None for the usual time.
      is_timed: whether a program is ended within that time, too.
      program_s: for which a program steps before it is ended; None to let it run.
      python: runs the program.
    """

    is_quick: bool = False
    starts: StartPlan = DEFAULT_STARTS
    limit_s: float = TIME_LIMIT_S
    budget_s: float | None = None
    is_timed: bool = False
    program_s: float | None = PROGRAM_S
    python: str = sys.executable

    @classmethod
    def of(cls, options: CheckupOptions) -> "CheckupPlan":
        """Return the plan; InputError if a file of start states is not there."""
        return cls(
            options.quick,
            options.starts,
            options.time_limit_s,
            options.budget.whole_s,
            options.quick or options.budget_s is not None,
            options.seconds,
            options.python or sys.executable,
        )

    @property
    def times(self) -> _Times:
        times = _QUICK if self.is_quick else _FULL
        return times if self.budget_s is None else times.scaled(self.budget_s / times.end)

    @property
    def most_program_s(self) -> float:
        """Seconds after which a program is ended, whether it has stepped for `program_s` or not."""
        if self.is_timed:
            return self.times.program
        return math.inf if self.program_s is None else _STARTING_PROGRAM_S + self.program_s


def measurement(source: CheckedSource, plan: CheckupPlan) -> Measurement:
    """Return the check-up of a model, a program or an environment.

    Raises:
      InputError: start states are given for what is no model.
    """
    is_model = isinstance(source, ModelSource)
    if not is_model and plan.starts != DEFAULT_STARTS:
        raise InputError(f"start states are of a model, and {source.name} is none")
    path = source.path if isinstance(source, ModelSource | ProgramFile) else None
    files = [] if path is None else [path]
    kind = targets.kind_of(source)

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        parts = _Parts(source, plan, observer)
        match source:
            case ModelSource():
                return _model_items(source, parts)
            case ProgramFile():
                return _program_items(source, parts)
        return _environment_items(source, parts)

    arguments = {"target": source.name, "kind": kind, "plan": plan}
    notes = platforms.pinning_notes() if is_model else []
    return Measurement("checkup", arguments, [*files, *plan.starts.files], measure, notes=notes)


@dataclass
class _Parts:
    source: CheckedSource
    plan: CheckupPlan
    observer: Observer
    clock: Callable[[], float] = time.monotonic
    records: list[Record] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._begin_s = self.clock()

    def left_s(self) -> float:
        return self.plan.times.end - (self.clock() - self._begin_s)

    def progress(self, text: str) -> None:
        share = 1 - max(0.0, self.left_s()) / self.plan.times.end
        self.observer(f"{self.source.name}: {text}", share)

    def measured(
        self,
        part: CheckupPart,
        doing: str,
        measure: Callable[[CheckedPart], tuple[CheckedPart, Sequence[Record]]],
    ) -> Item:
        """Return what a part comes to, or why it failed; what is unavailable is no failure."""
        name, begin_s = self.source.name, self.clock()
        self.observer.begin(f"{name}: {doing}")
        begun = CheckedPart(
            target=name, kind=targets.kind_of(self.source), part=part, is_quick=self.plan.is_quick
        )
        records: Sequence[Record] = ()
        try:
            ended, records = measure(begun)
        except MjbenchError as error:
            failure = failure_of_model(name, error)
            detail = failure.detail.removeprefix(f"{name}: ")
            ended = replace(begun, status=failure.status, detail=detail)
        except Exception as error:  # the other parts stay
            ended = replace(begun, status=Status.FAILED, detail=describe_unforeseen(error))
        ended = replace(ended, seconds=self.clock() - begin_s)
        self.records += [ended, *records]
        if ended.has_ended_well:
            return Item([ended, *records])
        return Item([ended, *records], Failure(ended.status, f"{name}: {ended.detail}"))

    @property
    def parts(self) -> list[CheckedPart]:
        return [each for each in self.records if isinstance(each, CheckedPart)]

    def of_type(self, kind: type[_Record]) -> _Record | None:
        return next((each for each in self.records if isinstance(each, kind)), None)


# -- a model ---------------------------------------------------------------------------------------


def _model_items(source: ModelSource, parts: _Parts) -> Items:
    """Yield the parts of a model's check-up; where it cannot be stepped, only that."""
    plan = parts.plan

    def profiled(part: CheckedPart) -> tuple[CheckedPart, list[Record]]:
        parts.progress("where a step's time goes")
        steps = isolate.call(
            profile.step,
            source,
            plan.starts,
            profile.STEP_SHARE * profile.BUDGET_S,
            limit_s=plan.limit_s,
        )
        return part, [profile.ProfileRow(source.name, steps=steps, frames=[])]

    first = parts.measured(CheckupPart.STEP, "where a step's time goes", profiled)
    yield first
    if first.failure is not None:
        return
    with WorkerPool(plan.limit_s) as pool:
        yield parts.measured(
            CheckupPart.PATHS,
            "racing ways of stepping",
            lambda part: _compared(part, pool, source, parts),
        )
        settings_s = parts.left_s() - plan.times.together - _STARTING_S
        if not plan.is_quick and settings_s > _LEAST_TUNING_S:
            yield parts.measured(
                CheckupPart.SETTINGS,
                f"trying settings, about {settings_s:.0f} s",
                lambda part: _tuned(part, pool, source, parts, settings_s),
            )
        yield from _together(pool, source, parts)


def _compared(
    part: CheckedPart, pool: WorkerPool, source: ModelSource, parts: _Parts
) -> tuple[CheckedPart, list[Record]]:
    plan, records = parts.plan, list[Record]()
    budget_s = max(1.0, min(plan.times.paths, parts.left_s() - _STARTING_S))
    comparison = ComparisonPlan((), starts=plan.starts, budget_s=budget_s, limit_s=plan.limit_s)
    threads = [machine.usable_cores()] if plan.is_quick else None
    plans = selection.plans(comparison, _PATHS, threads, option_words=_OPTIONS)
    end = 1 - parts.left_s() / plan.times.end
    shares = end, min(1.0, end + budget_s / plan.times.end)
    for item in model_comparison.measure_model(pool, source, plans, shares, (), parts.observer):
        records += item.records
    parts.observer.show(None)
    (model,) = (each for each in records if isinstance(each, ModelRecord))
    return replace(part, status=model.status, detail=model.detail), records


def _tuned(
    part: CheckedPart, pool: WorkerPool, source: ModelSource, parts: _Parts, budget_s: float
) -> tuple[CheckedPart, list[Record]]:
    plan = SearchPlan(starts=parts.plan.starts, budget_s=budget_s)
    record = tune(
        pool, source, plan, parts.plan.limit_s, lambda done, text, share: parts.progress(text)
    )
    return replace(part, status=record.status, detail=record.detail), [record]


def _together(pool: WorkerPool, source: ModelSource, parts: _Parts) -> Items:
    """Yield what several changes that change no result gain together, if there are several."""
    plan, model = parts.plan, parts.of_type(ModelRecord)
    race, tuned = parts.of_type(RaceRecord), parts.of_type(TuneRecord)
    combined = combination.combined(race, tuned)
    time_s = min(plan.times.together, parts.left_s() - _STARTING_S)
    if combined.count < _SEVERAL or model is None or time_s < _LEAST_TOGETHER_S:
        return
    sizes = Sizes(model.nbatch, model.nstep, starts=plan.starts)

    def measured(part: CheckedPart) -> tuple[CheckedPart, list[Record]]:
        parts.progress("all that changes nothing, together")
        verdict = combination.measure(pool, source, combined, sizes, time_s, plan.limit_s)
        return replace(part, combination=combined, verdict=verdict), []

    yield parts.measured(CheckupPart.TOGETHER, "all that changes nothing, together", measured)


# -- a program -------------------------------------------------------------------------------------


def _program_items(source: ProgramFile, parts: _Parts) -> Items:
    """Yield what lint finds, and where the program's time goes."""
    plan = parts.plan

    def read(part: CheckedPart) -> tuple[CheckedPart, list[Record]]:
        return replace(part, findings=lint.check(str(source.path))), []

    def ran(part: CheckedPart) -> tuple[CheckedPart, list[Record]]:
        program = launch.Program(source.words, plan.python)
        launch.check(program)
        seen = run_measure.observed(
            program, plan.program_s, most_s=plan.most_program_s, ends_on_signal=True
        )
        if not seen.was_interrupted:
            with contextlib.suppress(KeyboardInterrupt):
                return part, [run_measure.record(program.name, seen)]
        ended = replace(part, status=Status.INTERRUPTED)
        return ended, [run_measure.record(program.name, replace(seen, models=()))]

    if source.path is not None:
        yield parts.measured(CheckupPart.SOURCE, "reading it", read)
    if not any(part.status == Status.INPUT for part in parts.parts):
        most_s = plan.most_program_s
        doing = "running it" + (f" for {most_s:.0f} s at most" if most_s < math.inf else "")
        yield parts.measured(CheckupPart.PROGRAM, doing, ran)


# -- an environment --------------------------------------------------------------------------------


def _environment_items(source: EnvironmentSource, parts: _Parts) -> Items:
    plan, cores = parts.plan, machine.usable_cores()

    def measured(part: CheckedPart) -> tuple[CheckedPart, list[Record]]:
        parts.progress("where the time of env.step goes")
        threads = tuple(sorted({1, cores}))
        counts = () if plan.is_quick else tuple(sorted({2, cores}))
        record = environments.measure(
            source, EnvironmentPlan(None, 0, threads, counts, plan.times.environment, plan.limit_s)
        )
        is_stored = record.facts is not None or record.status == Status.INTERRUPTED
        records: list[Record] = [record] if is_stored else []
        return replace(part, status=record.status, detail=record.detail), records

    yield parts.measured(CheckupPart.ENVIRONMENT, "where the time of env.step goes", measured)
