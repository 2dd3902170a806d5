"""What searches for settings of C, MJX and Warp share: a plan, a record, and how they end."""

import abc
import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mjbench.errors import MjbenchError, failure_of
from mjbench.measuring.ratio import Ratio
from mjbench.paired.records import LaunchRow
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.tuning.accuracy import Distance
from mjbench.tuning.records import Attempt, Effect, Recommendation, TuneRecord, Withdrawal
from mjbench.tuning.reference import HOLD, REFERENCE_S, TrialPlan
from mjbench.tuning.settings import Setting, label

# A setting that saves less than this, by its first launches, is not looked at again.
LEAST_GAIN = 0.01
# Share of the budget that computing the reference may take.
REFERENCE_SHARE = 0.1
# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds of the whole search, about; with less than a minute, some settings may have
        no error, and nothing may be confirmed by a second look.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
      engine: `c`, `mjx` or `warp`; the latter two allow all effects, and skip nothing.
      nbatch: simulations of a batched step of those two.
    """

    seed: int = 0
    starts: StartPlan = field(default_factory=StartPlan)
    budget_s: float = 300.0
    max_error: float | None = None
    only: Effect = Effect.APPROXIMATE
    hold: int = HOLD
    skip: tuple[str, ...] = ()
    engine: str = "c"
    nbatch: int = 1

    def trials(
        self, look: int, ncontrol: int | None = None, horizon_ncontrol: int | None = None
    ) -> TrialPlan:
        """Return the starts and controls of a look: 0 for the search, 1 for the second look."""
        reference_s = min(REFERENCE_S, REFERENCE_SHARE * self.budget_s)
        return TrialPlan(
            self.seed + look, self.starts, self.hold, ncontrol, horizon_ncontrol, reference_s
        )


class Search(abc.ABC):
    """One search for settings of one model."""

    def __init__(
        self,
        record: TuneRecord,
        plan: SearchPlan,
        measurements: Any,
        advance: Advance = lambda done, text, share: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._measure = measurements
        self._record = replace(record, seed=plan.seed, max_error=plan.max_error, only=plan.only)
        self._plan, self._advance, self._clock = plan, advance, clock
        self._begin_s = clock()

    def result(self) -> TuneRecord:
        try:
            self._measure_present()
            if attempts := self._try_settings():
                self._second_look(attempts)
        except MjbenchError as error:
            self._set(status=failure_of(error).status, detail=self._detail_of(error))
        except KeyboardInterrupt:
            self._set(status=Status.INTERRUPTED)
        return replace(self._record, seconds=self._spent_s())

    def _detail_of(self, error: MjbenchError) -> str:
        return failure_of(error).detail.removeprefix(f"{self._record.model}: ")

    @abc.abstractmethod
    def _measure_present(self) -> None:
        """See what there is to try, and measure the present settings."""

    @abc.abstractmethod
    def _try_settings(self) -> Sequence[Attempt]:
        """Try settings alone and together; return those that are worth a second look."""

    @abc.abstractmethod
    def _second_look(self, attempts: Sequence[Attempt]) -> None:
        """Recommend settings that further starts confirm; withdraw the others."""

    def _spent_s(self) -> float:
        return self._clock() - self._begin_s

    def _set(self, **changes: Any) -> None:
        self._record = replace(self._record, **changes)

    def _note(self, attempt: Attempt) -> None:
        name = label(attempt.settings)
        others = [each for each in self._record.attempts if label(each.settings) != name]
        self._set(attempts=[*others, attempt])

    def _recommend(
        self,
        first: Attempt,
        second: Attempt,
        ratio: Ratio,
        samples: Sequence[LaunchRow],
        is_allowed: bool = True,
    ) -> None:
        both = [each.error for each in (first, second) if each.error is not None]
        effects = [each.accuracy.effect for each in (first, second) if each.accuracy]
        accuracy = second.accuracy
        if accuracy is not None and first.accuracy is not None:
            sensor_share = max(accuracy.sensor_share, first.accuracy.sensor_share)
            accuracy = replace(accuracy, sensor_share=sensor_share)
        recommendation = Recommendation(
            first.settings,
            ratio,
            functools.reduce(Distance.larger, both) if len(both) == 2 else None,
            samples,
            max(effects, key=lambda effect: effect.rank, default=Effect.APPROXIMATE),
            accuracy,
            second.program,
            is_allowed,
        )
        self._set(front=[*self._record.front, recommendation])

    def _withdraw(self, settings: Sequence[Setting], reason: str) -> None:
        self._set(withdrawn=[*self._record.withdrawn, Withdrawal(settings, reason)])


def too_far(error: float, limit: float) -> str:
    return (
        f"error of {100 * error:.2g} % of the motion from new starts, where"
        f" {100 * limit:.2g} % is allowed"
    )
