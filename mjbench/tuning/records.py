"""What a run file stores of a search for settings, and what `mjbench tune --json` writes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.instrument.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat
from mjbench.paired.records import LaunchRow, Ratio
from mjbench.status import Status
from mjbench.tuning.attempts import Accuracy, Effect
from mjbench.tuning.distance import Distance
from mjbench.tuning.mesh_notes import MeshNote
from mjbench.tuning.reference import Present
from mjbench.tuning.settings import Setting

# Errors that differ by this share of theirs count as the same,
SAME_ERROR = 0.05
# and an error of this share of the motion counts as none.
NO_ERROR = 0.005


@dataclass(frozen=True)
class AttemptRow:
    """Settings that were tried during the search.

    Attributes:
      accuracy: what they do to the motion; None where they failed.
      time_ratio: time of a simulated second over that of the present settings, measured within one
        process; None where they failed.
      ratio: the same in fresh processes, with its 95 % interval; None where it was not measured.
    """

    settings: Sequence[Setting]
    status: Status
    detail: str = ""
    accuracy: Accuracy | None = None
    time_ratio: PositiveFloat | None = None
    ratio: Ratio | None = None


@dataclass(frozen=True)
class Recommendation:
    """Settings that two looks confirm; the second had starts and controls of its own.

    Attributes:
      effect: on the motion; the larger of both looks.
      ratio: time of a simulated second over that of the present settings, in fresh processes from
        further starts, with its 95 % interval.
      error: the larger of both looks.
      is_allowed: whether the error is no larger than allowed, in both looks; if not, the user may
        still choose them.
      samples: raw times of each launch.
    """

    settings: Sequence[Setting]
    effect: Effect
    ratio: Ratio
    error: Distance
    accuracy: Accuracy
    is_allowed: bool
    samples: Sequence[LaunchRow] = ()


@dataclass(frozen=True)
class Withdrawal:
    """Settings that the second look did not confirm.

    Attributes:
      reason: why not, in one sentence.
    """

    settings: Sequence[Setting]
    reason: str


@dataclass(frozen=True, kw_only=True)
class TuneRecord:
    """A search for settings of one model; None is what was not reached.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      max_error: the largest error allowed, as a share of the motion; None for that of the present
        settings, as `allowed_error` has it.
      present: what the present settings do, on the starts of the second look; its error is the
        larger of both looks.
      attempts: settings that were tried, alone and together.
      untried: settings for which there was no time.
      front: recommendations, the smallest effect first and the slowest first within it.
      withdrawn: what the second look did not confirm.
      meshes: that collide, and that nearly fill a primitive.
      stages: share of a step by stage.
    """

    record_type: ClassVar[str] = "tune"
    model: str
    status: Status = Status.OK
    detail: str = ""
    seed: int = 0
    max_error: PositiveFloat | None = None
    only: Effect = Effect.APPROXIMATE
    present: Present | None = None
    attempts: Sequence[AttemptRow] = ()
    untried: NonNegativeInt = 0
    front: Sequence[Recommendation] = ()
    withdrawn: Sequence[Withdrawal] = ()
    meshes: Sequence[MeshNote] = ()
    stages: Mapping[str, float] | None = None
    seconds: NonNegativeFloat = 0.0

    def best(self) -> Recommendation | None:
        """Return the fastest recommendation whose error is allowed; None without one."""
        allowed = [each for each in self.front if each.is_allowed]
        return min(allowed, key=lambda each: each.ratio.estimate, default=None)


def allowed_error(max_error: float | None, present_error: float) -> float:
    """Return the largest error of settings that are recommended, as a share of the motion.

    Args:
      max_error: that the user allows; None for that of the present settings.
    """
    return max_error or max((1 + SAME_ERROR) * present_error, NO_ERROR)
