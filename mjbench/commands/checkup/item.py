"""One thing that a check-up advises: what to do, what it gains, and what it changes in results."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from mjbench import formats
from mjbench.commands.tune import notes as tuning_notes
from mjbench.commands.tune.settings import Setting
from mjbench.interval import Interval
from mjbench.paired.race_record import Loop
from mjbench.verification.plan import Variant


class ResultChange(StrEnum):
    """What an item does to results."""

    CORRECTED = "corrected"
    """They are wrong today."""
    NONE = "none"
    """Nothing, to the last bit; what `change_detail` says in runs other than those seen."""
    TOLERANCE = "tolerance"
    """No more than the solver's tolerance does."""
    STATED = "stated"
    """What `change_detail` says."""
    ERROR = "error"
    """An error, of which `error` has the size."""

    @property
    def keeps(self) -> bool:
        return self in (ResultChange.NONE, ResultChange.TOLERANCE)


class GainUnit(StrEnum):
    """What a gain is a multiple of; that of a loop is the share of its time that is saved."""

    PLAIN_LOOP = "× as fast as a plain Python loop"
    SIMULATED_SECOND = "× as fast as now, for a simulated second"
    LOOP_SHARE = "of the loop's time saved"
    ENV_STEP = "× as fast as env.step"
    ONE_ENVIRONMENT = "× the steps of one environment"


class GainGroup(StrEnum):
    """Items of one group do the same work in another way: of them, use one."""

    PATHS = "ways of stepping"
    TIMER = "timer"
    SETTINGS = "settings"
    LOOP = "loop"
    PHYSICS = "physics alone"
    VECTORS = "several environments"


@dataclass(frozen=True, kw_only=True)
class CheckupItem:
    """One thing to do.

    Attributes:
      action: what to do, and where, in a line.
      loop: of a way of stepping, the loop that it is best for; None for both, and of anything else.
      variant: the way of stepping that it advises; None of anything else.
      settings: that it advises.
      gain: None for a wrong result, and where the gain was not measured.
      is_certain: whether the gain is more than none, and no other way is better.
      counted: why it is known by count, and not certainly by time; empty where it is.
      is_halving: whether it halves the work or more by count, without a larger error that is known.
      is_bound: whether it is at most that: what comes instead takes time, too.
      change_detail: what else is given up, or may change in runs other than those seen, in a few
        words; empty for nothing.
      error: as a share of the motion; None unless results have one.
      command: that looks closer.
      snippet: code that does it; empty where `action` says all.
      slow_effects: what it prevents that runs of a second are too short to show, in sentences.
    """

    action: str
    loop: Loop | None = None
    variant: Variant | None = None
    settings: Sequence[Setting] = ()
    gain: Interval | None = None
    unit: GainUnit | None = None
    is_certain: bool = True
    counted: str = ""
    is_halving: bool = False
    is_bound: bool = False
    change: ResultChange
    change_detail: str = ""
    error: float | None = None
    group: GainGroup | None = None
    command: str
    snippet: str = ""
    slow_effects: Sequence[str] = ()

    @property
    def times(self) -> float:
        """How many times as fast, by estimate; 1 where that is not known."""
        if self.gain is None:
            return 1.0
        if self.unit == GainUnit.LOOP_SHARE:
            return 1 / max(1e-9, 1 - self.gain.estimate)
        return self.gain.estimate

    @property
    def gain_text(self) -> str:
        """The gain, as a sentence or a cell has it; empty where it is not known."""
        if self.gain is None:
            return ""
        at_most = "≤ " if self.is_bound else ""
        if self.unit == GainUnit.LOOP_SHARE:
            return f"{at_most}{formats.whole_percent(self.gain.estimate)}"
        if self.counted:
            return f"about {formats.plain(self.gain.estimate, 2)} ×"
        return f"{at_most}{formats.factor(self.gain.estimate)} ×"

    @property
    def sentence(self) -> str:
        """What to do, with the gain first: `1.93 × as fast (1.82–2.05) with Batch.step`."""
        interval = f" ({self.ends_text or self.counted})" if self.ends_text or self.counted else ""
        if self.unit == GainUnit.LOOP_SHARE:
            return f"{self.gain_text} of the loop's time{interval}: {self.action}"
        verb = "to" if self.action.startswith("step ") else "with"
        probably = "" if self.is_certain else "probably "
        return f"{probably}{self.gain_text} as fast{interval} {verb} {self.action}"

    @property
    def ends_text(self) -> str:
        """The ends of its interval; empty where they are not known."""
        form = formats.whole_percent if self.unit == GainUnit.LOOP_SHARE else formats.factor
        return formats.ends(self.gain, form)

    @property
    def change_text(self) -> str:
        match self.change:
            case ResultChange.CORRECTED:
                return "corrects them"
            case ResultChange.NONE:
                return "none seen" if self.change_detail else "none"
            case ResultChange.TOLERANCE:
                return "within tolerance"
            case ResultChange.ERROR:
                if self.error is None:
                    return "of unknown size"
                return f"{tuning_notes.percent(self.error)} of the motion"
        return self.change_detail
