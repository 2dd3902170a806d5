"""What the run file of a check-up has beside the records of the commands that it is made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from mjbench.bounds import NonNegativeFloat
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.lint.check import Finding
from mjbench.commands.tune.settings import Setting
from mjbench.paired.records import VerdictRecord
from mjbench.status import Status
from mjbench.verification.plan import Variant


class CheckupPart(StrEnum):
    """One part of a check-up, by the command that looks closer."""

    STEP = "profile"
    """Where a step's time goes."""
    PATHS = "compare"
    """Which way of stepping is fastest."""
    SETTINGS = "tune"
    """Which settings make a step faster."""
    TOGETHER = "ab"
    """What all that changes no result gains together."""
    PROGRAM = "run"
    """Where the time of a program goes."""
    SOURCE = "lint"
    """What its source shows."""
    ENVIRONMENT = "env"
    """Where the time of env.step goes."""


@dataclass(frozen=True)
class Combination:
    """A way of stepping, without the package's timer or with it, and settings of the model.

    Attributes:
      settings: that changed no state; those of the loop are in `has_timer`.
      has_timer: whether steps read the timer of MuJoCo's Python package.
    """

    variant: Variant
    settings: Sequence[Setting]
    has_timer: bool

    @property
    def count(self) -> int:
        return (self.variant.path != "python_loop") + len(self.settings) + (not self.has_timer)


@dataclass(frozen=True, kw_only=True)
class CheckedPart:
    """How one part of a check-up ended; what it measured are the records that follow it.

    Attributes:
      target: as the user named it.
      detail: why it is not ok, in one line.
      is_quick: whether it had to end soon.
      findings: of lint.
      combination: that `verdict` compares with the plain loop.
    """

    record_type: ClassVar[str] = "checkup"
    target: str
    kind: TargetKind
    part: CheckupPart
    status: Status = Status.OK
    detail: str = ""
    is_quick: bool = False
    seconds: NonNegativeFloat = 0.0
    findings: Sequence[Finding] = ()
    combination: Combination | None = None
    verdict: VerdictRecord | None = None

    @property
    def has_ended_well(self) -> bool:
        """Whether nothing failed; what is not installed is no failure."""
        return self.status in (Status.OK, Status.UNAVAILABLE, Status.INTERRUPTED)
