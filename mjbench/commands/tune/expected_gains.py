"""What may be gained beyond what a search for settings has judged: by count, by first launches."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mjbench import formats
from mjbench.commands.profile import step_parts
from mjbench.commands.profile.step_parts import Stage
from mjbench.commands.tune import knobs
from mjbench.commands.tune.result import Attempt, Effect, TuneRecord, log_ratio, saves_time
from mjbench.commands.tune.settings import Setting
from mjbench.formats import short_percent
from mjbench.status import Status

# A setting that is so many times as fast by count, or in each of so many launches, is worth naming.
_TWICE, _LEAST_LAUNCHES = 2.0, 2
# A stage that takes this share of a step decides how long it takes, unless a setting that shortens
# it leaves no more than this of the time.
_MOST_OF_STEP, _SHORTENED = 2 / 3, 0.9
# What shortens each stage. Of the first ones, a model often has more than its motion needs.
_NEEDLESS = (Stage.COLLISION, Stage.TENDONS, Stage.SENSORS)
_HELPS: Mapping[str, str] = {
    Stage.COLLISION: "simpler or fewer geoms",
    Stage.CONSTRAINT_MAKING: "fewer contacts and constraints",
    Stage.CONSTRAINT_PROJECTION: "fewer contacts and constraints",
    Stage.SOLVER: "fewer contacts and constraints",
    Stage.KINEMATICS: "fewer bodies and geoms",
    Stage.INERTIA: "fewer bodies and joints",
    Stage.TENDONS: "fewer tendons",
    Stage.SENSORS: "fewer sensors",
}


@dataclass(frozen=True)
class ExpectedGain:
    """A setting that seems to halve the time of a step or more, and is not recommended yet.

    Attributes:
      factor: times as fast, by count or by its first launches.
      effect: on the motion, as far as it is known.
      reason: that it is not recommended.
    """

    setting: Setting
    factor: float
    effect: Effect
    reason: str

    @property
    def text(self) -> str:
        return f"about {formats.plain(self.factor, 2)} × as fast ({self.reason})"


def unjudged(record: TuneRecord) -> list[ExpectedGain]:
    """Return what seems to save half or more, and is neither judged nor seen to be no gain.

    It is one setting of each knob, the one that saves most.
    """
    tried = {each.settings[0]: each for each in record.attempts if len(each.settings) == 1}
    judged = {one for each in record.front for one in each.settings}
    judged |= {one for each in record.withdrawn for one in each.settings}
    gains: dict[str, ExpectedGain] = {}
    for setting in sorted({*record.untried_halving, *tried} - judged, key=lambda each: each.label):
        attempt = tried.get(setting)
        factor = max(_counted_factor(setting, record), _timed_factor(attempt, record))
        if factor < _TWICE or not _may_be(attempt, record):
            continue
        is_timed = attempt is not None and attempt.ratio is not None and saves_time(attempt.ratio)
        reason = "its error was not measured" if is_timed else "not timed certainly"
        known = gains.get(setting.knob)
        if known is None or factor > known.factor:
            gains[setting.knob] = ExpectedGain(setting, factor, _effect(attempt), reason)
    return sorted(gains.values(), key=lambda each: -each.factor)


def _counted_factor(setting: Setting, record: TuneRecord) -> float:
    if not setting.evidence:
        return 1.0
    return 1 / max(1e-9, 1 - knobs.counted_gain(setting, record.stages or {}))


def _timed_factor(attempt: Attempt | None, record: TuneRecord) -> float:
    """Return how many times as fast a setting that keeps the motion was in its slowest launch.

    It is no more than its stages allow, and 1 where it is certain.
    """
    if attempt is None or len(attempt.launches) < _LEAST_LAUNCHES or attempt.gives_up:
        return 1.0
    is_certain = attempt.ratio is not None and saves_time(attempt.ratio)
    if is_certain or _effect(attempt) == Effect.APPROXIMATE:
        return 1.0
    stages = knobs.find(attempt.settings[0].knob).stages
    others = 1 - sum((record.stages or {}).get(stage, 0.0) for stage in stages) if stages else 0.0
    return 1 / max(1e-9, others, *(math.exp(log_ratio(row)) for row in attempt.launches))


def _effect(attempt: Attempt | None) -> Effect:
    accuracy = attempt.accuracy if attempt is not None else None
    return accuracy.effect if accuracy is not None else Effect.APPROXIMATE


def _may_be(attempt: Attempt | None, record: TuneRecord) -> bool:
    """Return whether a setting may yet turn out to be faster without a larger error."""
    if attempt is None:
        return record.allow == Effect.APPROXIMATE
    is_unjudged = attempt.status == Status.OK and attempt.error is None
    ratio = attempt.ratio
    is_slower = ratio is not None and ratio.low is not None and ratio.low >= 1
    return is_unjudged and _effect(attempt).rank <= record.allow.rank and not is_slower


@dataclass(frozen=True)
class UntouchedStage:
    """A stage that takes most of a step, and that no allowed setting shortens much.

    Attributes:
      text: what would, in a sentence.
      most_gain: how many times as fast a step without it is; 1 where the motion needs all of it.
    """

    text: str
    most_gain: float


def untouched_stage(record: TuneRecord) -> UntouchedStage | None:
    stage, share = step_parts.longest(record.stages or {})
    if share < _MOST_OF_STEP or stage not in _HELPS:
        return None
    stages = step_parts.COLLISION if stage == Stage.COLLISION else (stage,)
    shorten = [each for each in record.front if each.is_allowed]
    shorten = [each for each in shorten if each.ratio.estimate <= _SHORTENED]
    settings = {one for each in shorten for one in each.settings}
    for one in settings.union(each.setting for each in unjudged(record)):
        if not {*stages}.isdisjoint([*one.stages, *knobs.find(one.knob).stages]):
            return None
    text = f"{short_percent(share)} of a step is {stage}: {_HELPS[stage]} would help most"
    return UntouchedStage(text, 1 / max(1e-9, 1 - share) if stage in _NEEDLESS else 1.0)
