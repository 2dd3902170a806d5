"""Search settings that make a batched step of MJX or Warp faster, and transfer to C as well.

1. Every setting is tried alone, beside the present ones, in one process.
2. Those that are faster, and err no more than allowed, are tried together: the fastest of each
   knob, two, then three, and so on.
3. The fastest of all are measured again, in fresh processes, from starts and with controls that
   the search has not seen. What that does not confirm is withdrawn.
"""

import time
from collections.abc import Callable, Iterator, Sequence

from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.tuning.accelerated_measurements import (
    EngineMeasurements,
    EngineOnThisMachine,
    Settings,
)
from mjbench.tuning.accelerated_records import (
    EngineAttempt,
    EngineFacts,
    EngineProgram,
    EngineRecommendation,
    EngineTuneRecord,
    EngineWithdrawal,
    error_limit,
    log_ratios,
    mean_ratio,
)
from mjbench.tuning.accelerated_settings import EngineSetting
from mjbench.tuning.measurements import MIN_EFFECT
from mjbench.tuning.reference import TrialPlan
from mjbench.tuning.search import LEAST_GAIN, Advance, SearchPlan, ended
from mjbench.tuning.settings import label

# Shares of the budget after which no setting is tried alone, and none together.
ALONE_SHARE, TOGETHER_SHARE = 0.5, 0.65
# Settings that are looked at again, and fresh processes for them: as many as there is time for.
FINALISTS, LEAST_PROCESSES, PROCESSES = 2, 4, 8
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


class EngineSearch:
    """One search for settings of an engine; `record` says what came of it, at any time."""

    def __init__(
        self,
        model: str,
        engine: str,
        nbatch: int,
        plan: SearchPlan,
        measurements: EngineMeasurements,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Measure nothing yet.

        Args:
          plan: of the search; all effects are allowed.
        """
        self._model, self._engine, self._nbatch, self._plan = model, engine, nbatch, plan
        self._measure, self._advance, self._clock = measurements, advance, clock
        self._begin_s = clock()
        self._facts: EngineFacts | None = None
        self._present: EngineProgram | None = None
        self._attempts: list[EngineAttempt] = []
        self._untried = 0
        self._front: list[EngineRecommendation] = []
        self._withdrawn: list[EngineWithdrawal] = []

    def run(self) -> None:
        """Search.

        Raises:
          InputError: the model cannot be stepped, or is not for this engine.
          MachineError: the process of the present settings crashed or hung.
          KeyboardInterrupt: the user ended it; `record` has what was measured.
        """
        plan = self._plan
        self._advance(0, "the present settings in C", 0.0)
        self._facts = self._measure.baseline(plan.trials(0))
        alone = [(setting,) for setting in self._facts.settings]
        self._try(1, alone, ALONE_SHARE)
        self._untried = len(alone) - len(self._attempts)
        limit = error_limit(plan.max_error, self._present, self._facts)
        together = combinations(_helpful(self._attempts, limit))
        if together and self._left_s(TOGETHER_SHARE) > 0:
            self._try(2, together, TOGETHER_SHARE)
        finalists = _helpful(self._attempts, limit)[:FINALISTS]
        if finalists:
            self._second_look(finalists, self._facts)

    def record(self, status: Status = Status.OK, detail: str = "") -> EngineTuneRecord:
        """Return what was measured so far."""
        return EngineTuneRecord(
            model=self._model,
            engine=self._engine,
            status=status,
            detail=detail,
            seed=self._plan.seed,
            nbatch=self._nbatch,
            max_error=self._plan.max_error,
            facts=self._facts,
            present=self._present,
            attempts=self._attempts,
            untried=self._untried,
            front=self._front,
            withdrawn=self._withdrawn,
            seconds=self._clock() - self._begin_s,
        )

    def _try(self, part: int, settings: Sequence[Settings], share: float) -> None:
        """Try settings in one process, until a share of the budget is spent."""
        count = 0

        def note(attempt: EngineAttempt) -> None:
            nonlocal count
            count += 1
            self._attempts.append(attempt)
            self._advance(part, label(attempt.settings), count / len(settings))

        self._advance(part, label(settings[0]) if settings else "", 0.0)
        program = self._measure.launch(settings, note, self._left_s(share))
        self._present = self._present or program

    def _second_look(self, finalists: Sequence[EngineAttempt], facts: EngineFacts) -> None:
        """Measure the fastest settings again, from new starts, in fresh processes."""
        plan, settings = self._plan, [tuple(each.settings) for each in finalists]
        self._advance(3, "C from new starts", 0.0)
        ncontrol = facts.horizon_ncontrol
        new = self._measure.baseline(
            TrialPlan(plan.seed + 1, plan.starts, plan.hold, ncontrol, ncontrol)
        )
        launches: list[list[EngineAttempt]] = []
        begin_s = self._clock()
        present = self._launched(settings, launches, has_errors=True)
        limit = error_limit(plan.max_error, present, new)
        left_s = plan.budget_s - (self._clock() - self._begin_s)
        affordable = int(left_s / max(self._clock() - begin_s, 1e-9))
        more = min(max(affordable, LEAST_PROCESSES - 1), PROCESSES - 1)
        for number in range(more):
            self._advance(3, "fresh processes", (number + 1) / (more + 1))
            self._launched(settings, launches, has_errors=False)
        for i, first in enumerate(finalists):
            self._judge(first, [launch[i] for launch in launches], limit)
        self._front.sort(key=lambda each: len(each.settings))
        self._front = sorted(self._simplest(self._front), key=lambda each: each.ratio.estimate)

    def _launched(
        self, settings: Sequence[Settings], launches: list[list[EngineAttempt]], has_errors: bool
    ) -> EngineProgram:
        """Try settings in a fresh process; add what comes of it to the launches."""
        attempts: list[EngineAttempt] = []
        program = self._measure.launch(settings, attempts.append, has_errors=has_errors)
        launches.append(attempts)
        return program

    def _judge(self, first: EngineAttempt, launches: Sequence[EngineAttempt], limit: float) -> None:
        """Recommend settings, or withdraw them.

        Args:
          first: how they did in the search.
          launches: how they did in the second look, in each process; the first has errors.
          limit: of the transfer error in the second look.
        """
        settings, second = first.settings, launches[0]
        failed = next((each.detail for each in launches if each.samples is None), None)
        if failed is not None:
            self._withdrawn.append(EngineWithdrawal(settings, failed))
            return
        assert first.program and first.program.error, "it was measured"
        assert second.program and second.program.error, "likewise"
        error, samples = second.program.error, [each.samples for each in launches if each.samples]
        ratio = mean_ratio(log_ratios(samples))
        reason = ""
        if error.share > limit:
            reason = (
                f"transfer error of {100 * error.share:.2g} % of the motion from new starts, where"
                f" {100 * limit:.2g} % is allowed"
            )
        elif ratio.high is None or ratio.high >= 1 or ratio.estimate > 1 - MIN_EFFECT / 2:
            reason = "not certainly faster in fresh processes"
        if reason:
            self._withdrawn.append(EngineWithdrawal(settings, reason))
            return
        self._front.append(
            EngineRecommendation(
                settings, ratio, first.program.error.larger(error), second.program, samples
            )
        )

    def _simplest(self, front: Sequence[EngineRecommendation]) -> Iterator[EngineRecommendation]:
        """Yield recommendations, without those that only add settings of no certain gain.

        Args:
          front: recommendations, those of fewer settings first.
        """
        for number, each in enumerate(front):
            labels = {setting.label for setting in each.settings}
            simpler = [
                other
                for other in front[:number]
                if {setting.label for setting in other.settings} < labels
            ]
            slower = [other for other in simpler if not is_faster(each, other)]
            if slower:
                reason = f"not certainly faster than {label(slower[0].settings)} alone"
                self._withdrawn.append(EngineWithdrawal(each.settings, reason))
            else:
                yield each

    def _left_s(self, share: float) -> float:
        """Return the seconds that are left of a share of the budget."""
        return share * self._plan.budget_s - (self._clock() - self._begin_s)


def combinations(helpful: Sequence[EngineAttempt]) -> list[Settings]:
    """Return the fastest setting of each knob, two of them together, then three, and so on.

    Args:
      helpful: attempts of settings alone, the fastest first.
    """
    by_knob: dict[str, EngineSetting] = {}
    for attempt in helpful:
        (setting,) = attempt.settings
        by_knob.setdefault(setting.knob, setting)
    fastest = tuple(by_knob.values())
    return [fastest[:count] for count in range(2, len(fastest) + 1)]


def is_faster(one: EngineRecommendation, other: EngineRecommendation) -> bool:
    """Return whether settings are certainly faster than others in the same processes."""
    pairs = zip(log_ratios(one.samples), log_ratios(other.samples), strict=True)
    ratio = mean_ratio([mine - theirs for mine, theirs in pairs])
    return ratio.high is not None and ratio.high < 1


def tune_engine(
    pool: WorkerPool,
    source: ModelSource,
    engine: str,
    nbatch: int,
    plan: SearchPlan,
    limit_s: float,
    advance: Advance = lambda done, text, share: None,
) -> EngineTuneRecord:
    """Return what a search for faster settings of an engine came to.

    A model that the engine does not take, and Ctrl-C, are the record's status; it holds what was
    measured.

    Args:
      engine: path that steps it, such as `mjx`.
      limit_s: seconds of silence after which a process is killed; compilers get more.
    """
    measurements = EngineOnThisMachine(pool, source, engine, nbatch, limit_s)
    search = EngineSearch(source.name, engine, nbatch, plan, measurements, advance)
    return ended(search.run, search.record)


def _helpful(attempts: Sequence[EngineAttempt], limit: float) -> list[EngineAttempt]:
    """Return the attempts that seem faster and err no more than allowed, the fastest first."""
    helpful = [
        each
        for each in attempts
        if each.error_share is not None
        and each.error_share <= limit
        and _time_ratio(each) <= 1 - LEAST_GAIN
    ]
    return sorted(helpful, key=_time_ratio)


def _time_ratio(attempt: EngineAttempt) -> float:
    assert attempt.time_ratio is not None, "it was timed"
    return attempt.time_ratio
