"""What a run file stores of a search for settings, and what `mjbench tune --json` writes."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from mjbench.bounds import AnyFloat, Int64, NonNegativeFloat, NonNegativeInt, PositiveFloat
from mjbench.commands.profile.model_costs import Cost
from mjbench.commands.tune.accuracy import Distance
from mjbench.commands.tune.reference import CurrentSettings
from mjbench.commands.tune.settings import Setting
from mjbench.interval import Interval
from mjbench.measuring import launch_stats, stats
from mjbench.paired.records import LaunchRow
from mjbench.status import Status

# Errors that differ by this share of theirs count as the same,
SAME_ERROR = 0.05
# and an error of this share of the motion counts as none.
NO_ERROR = 0.005
# What a stage saves of the present time is left out below this share.
LEAST_SAVED = 0.01
# Smallest gain that counts, and the confidence of an interval of times.
MIN_EFFECT, CONFIDENCE = 0.01, 0.95


class Effect(enum.StrEnum):
    """What settings do to the motion, from none at all to an error of some size."""

    FREE = "free"
    """Every state is the same, to the last bit."""
    EQUIVALENT = "equivalent"
    """States differ as rounding or a converged solver's tolerance makes them differ."""
    APPROXIMATE = "approximate"
    """States or sensor data differ by more; the error says by how much."""

    @property
    def rank(self) -> int:
        """0 for the effect that changes least."""
        return list(Effect).index(self)


@dataclass(frozen=True)
class Limits:
    """How far settings may take the motion from others, as shares of it; None where unset.

    Attributes:
      max_error: from the reference.
      max_change: from the motion with the present settings.
    """

    max_error: PositiveFloat | None = None
    max_change: PositiveFloat | None = None

    @property
    def are_set(self) -> bool:
        return (self.max_error, self.max_change) != (None, None)

    @property
    def allowed_change(self) -> float:
        return self.max_change or math.inf

    def allowed_error(self, present_error: float) -> float:
        """Return the largest error allowed, unless it is set by that of the present settings."""
        if self.are_set:
            return self.max_error or math.inf
        return max((1 + SAME_ERROR) * present_error, NO_ERROR)


@dataclass(frozen=True)
class Accuracy:
    """What settings do to the motion.

    Attributes:
      error: distance from the reference, within the horizon; None without a reference.
      distance: from the runs with present settings, within the horizon.
      run_errors: of each run from the reference, as a share of the motion.
      changed_sensors: how many sensors have other data although the motion is the same.
      sensor_share: by how much the data of the other sensors differ then at most, as a share of the
        largest magnitude of each.
    """

    effect: Effect
    error: Distance | None
    distance: Distance
    run_errors: Sequence[AnyFloat]
    changed_sensors: NonNegativeInt = 0
    sensor_share: NonNegativeFloat = 0.0


@dataclass(frozen=True)
class Attempt:
    """How settings did in the search; None is what was not measured, or failed.

    Attributes:
      accuracy: what they do to the motion.
      time_ratio: their time for a simulated second over that of the present settings, within one
        process.
      ratio: the same in fresh processes, with its 95 % interval.
      launches: raw times of blocks in each fresh process that gave `ratio`, or else `time_ratio`; A
        is the present settings.
      stages: share of a step by stage with them; empty where that was not measured.
    """

    settings: tuple[Setting, ...]
    status: Status
    detail: str = ""
    accuracy: Accuracy | None = None
    time_ratio: PositiveFloat | None = None
    ratio: Interval | None = None
    launches: Sequence[LaunchRow] = ()
    stages: Mapping[str, AnyFloat] = field(default_factory=dict)

    @property
    def gives_up(self) -> bool:
        """Whether the user loses more by them than the motion shows, such as sensor data."""
        is_lost = any(each.loses for each in self.settings)
        return is_lost or bool(self.accuracy and self.accuracy.changed_sensors)

    @property
    def error(self) -> Distance | None:
        """How far runs are from those of the reference."""
        return self.accuracy.error if self.accuracy else None


@dataclass(frozen=True)
class Recommendation:
    """Settings that two looks confirm; the second, if any, had starts and controls of its own.

    Attributes:
      ratio: their time over that of the present settings, in fresh processes from further starts,
        with its 95 % interval.
      error: as of an attempt; the larger of both looks; None without a reference.
      effect: on the motion; the larger of both looks.
      accuracy: of the second look, with the larger change of both.
      is_allowed: whether error and change are no larger than allowed, in both looks; if not, the
        user may still choose them.
    """

    settings: Sequence[Setting]
    ratio: Interval
    error: Distance | None
    samples: Sequence[LaunchRow] = ()
    effect: Effect = Effect.APPROXIMATE
    accuracy: Accuracy | None = None
    is_allowed: bool = True


@dataclass(frozen=True)
class Withdrawal:
    """Settings that the second look did not confirm, and why not, in one sentence."""

    settings: Sequence[Setting]
    reason: str


@dataclass(frozen=True, kw_only=True)
class TuneRecord:
    """A search for settings of one model; None is what was not reached.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      present: what the present settings do, on the starts of the second look; its error is the
        larger of both looks.
      no_reference: why settings that need an error were left out: the reference failed, or there
        was no time for it; empty where it was run, or not needed.
      no_second_look: why there were no runs from new starts; empty where there were, or nothing to
        recommend.
      untried: settings for which there was no time, alone.
      untried_combinations: for which there was no time.
      untried_halving: of `untried`, those that save half of a step or more by count.
      front: recommendations, the smallest effect first and the slowest first within it.
      stages: share of a step by stage.
      collision: the costliest collisions of height fields or meshes; None where they cost little.
    """

    record_type: ClassVar[str] = "tune"
    model: str
    status: Status = Status.OK
    detail: str = ""
    seed: Int64 = 0
    limits: Limits = Limits()
    allow: Effect = Effect.APPROXIMATE
    present: CurrentSettings | None = None
    attempts: Sequence[Attempt] = ()
    no_reference: str = ""
    no_second_look: str = ""
    untried: NonNegativeInt = 0
    untried_combinations: NonNegativeInt = 0
    untried_halving: Sequence[Setting] = ()
    front: Sequence[Recommendation] = ()
    withdrawn: Sequence[Withdrawal] = ()
    stages: Mapping[str, AnyFloat] | None = None
    collision: Cost | None = None
    seconds: NonNegativeFloat = 0.0

    @property
    def has_errors(self) -> bool:
        """Whether a reference was run; that of the second look may have failed."""
        return self.present is not None and self.present.error is not None

    def best(self) -> Recommendation | None:
        allowed = [each for each in self.front if each.is_allowed]
        return min(allowed, key=lambda each: each.ratio.estimate, default=None)

    def saved(self, attempt: Attempt) -> dict[str, float]:
        """Return what settings save by stage, as shares of the present time, the largest first.

        Times are of a simulated second. Stages of little difference are left out; nothing without
        the stages of both.
        """
        present, changed = self.stages or {}, attempt.stages
        time_ratio = attempt.ratio.estimate if attempt.ratio else attempt.time_ratio
        if not present or not changed or time_ratio is None:
            return {}
        by_stage = {
            stage: present.get(stage, 0.0) - time_ratio * changed.get(stage, 0.0)
            for stage in {*present, *changed}
        }
        ordered = sorted(by_stage.items(), key=lambda item: -item[1])
        return {stage: share for stage, share in ordered if abs(share) >= LEAST_SAVED}


def fresh_ratio(samples: Sequence[LaunchRow], count: int = 1) -> Interval:
    """Return the ratio of times over fresh processes, with Student's interval of their mean.

    How many there are must not depend on what they say. Disturbed ones are left out.

    Args:
      count: ratios whose intervals all hold together with CONFIDENCE (Bonferroni).
    """
    logs = [log_ratio(row) for row in samples]
    return launch_stats.student_interval(logs, 1 - (1 - CONFIDENCE) / count).exponential


def saves_time(ratio: Interval) -> bool:
    """Return whether settings certainly save time, MIN_EFFECT / 2 at least by estimate."""
    return ratio.high is not None and ratio.high < 1 and ratio.estimate <= 1 - MIN_EFFECT / 2


def log_ratio(samples: LaunchRow) -> float:
    return stats.paired_log_ratio(samples.orders, np.array(samples.ns))
