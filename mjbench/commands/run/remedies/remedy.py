"""One thing to do about a program."""

import enum
import math
from dataclasses import dataclass

from mjbench.bounds import AnyFloat, NonNegativeInt
from mjbench.commands.run.activities import Activity, Place
from mjbench.interval import Interval

# Smaller gains are not worth a line.
LEAST_GAIN = 0.03


class RemedyKind(enum.StrEnum):
    """What a remedy changes."""

    RESULT = "wrong result"
    """The program computes or stores what it does not mean."""
    CALL = "call"
    """A call of MuJoCo or JAX."""
    LINE = "line"
    CLOCK = "package's timer"
    """A step reads the timer of MuJoCo's Python package."""
    COLLECTION = "garbage collection"
    THREADS = "threads"
    """A library computes on more threads than cores can run."""
    ACTIVITY = "activity"


# Kinds of which only a share is known, and half of it is likely to be saved.
_OF_SAMPLES = (RemedyKind.LINE, RemedyKind.ACTIVITY)


class Basis(enum.StrEnum):
    """Where a gain comes from."""

    TIMED = "timed"
    """The calls were timed one by one, and would not be made any more."""
    PAIRED = "paired"
    """Both ways were timed in turns on the program's own model and states."""
    RERUN = "run again"
    """The program ran a second time, for a short while, with the change."""
    BOUND = "at most"
    """It is the share of what would change; what replaces it takes time, too."""


@dataclass(frozen=True)
class Remedy:
    """One thing to do.

    Attributes:
      kind: what it changes.
      activity: whose time it saves; None for a wrong result.
      place: where; None for the whole loop.
      text: what to do.
      gain: share of the loop's time that it saves; None for a wrong result.
      gain_error: standard error of that share.
      code: of the lint rule that it follows; "" for none.
      basis: where the gain comes from.
      share: of the loop's time that the calls or lines take now; None for a wrong result.
      effect: what it changes in results.
      last_line: of a remedy for several lines; None for one line.
    """

    kind: RemedyKind
    activity: Activity | None
    place: Place | None
    text: str
    gain: AnyFloat | None
    gain_error: AnyFloat | None
    code: str = ""
    basis: Basis = Basis.BOUND
    share: AnyFloat | None = None
    effect: str = ""
    last_line: NonNegativeInt | None = None

    def is_at(self, place: Place) -> bool:
        """Whether a line is one of those that it is about."""
        if self.place is None or self.place.file != place.file:
            return False
        return self.place.line <= place.line <= (self.last_line or self.place.line)

    @property
    def where(self) -> str:
        """Its lines; empty for the whole loop."""
        last = f"–{self.last_line}" if self.last_line else ""
        return f"{self.place}{last}" if self.place is not None else ""

    @property
    def is_certain(self) -> bool:
        """Whether it is more than chance."""
        return self.gain is None or self.gain > 2 * (self.gain_error or 0.0)

    @property
    def share_saved(self) -> Interval | None:
        """The share of the loop's time that it saves, of at most 1; None where it is not known."""
        if self.gain is None or self.gain <= 0:
            return None
        gain = Interval.around(
            self.gain, math.inf if self.gain_error is None else 2 * self.gain_error
        )
        low, high = (
            None if end is None else min(1.0, max(0.0, end)) for end in (gain.low, gain.high)
        )
        return Interval(min(1.0, gain.estimate), low, high)

    @property
    def rank(self) -> tuple[int, float]:
        """Where it stands: wrong results, then by gain."""
        if self.gain is None:
            return 0, 0.0
        is_vague = self.basis == Basis.BOUND and self.kind in _OF_SAMPLES
        return 1, -self.gain / 2 if is_vague else -self.gain
