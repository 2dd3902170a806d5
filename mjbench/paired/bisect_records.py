"""What a search for the first slower revision comes to, as a run file stores it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt
from mjbench.paired.records import VerdictRow
from mjbench.status import Status


@dataclass(frozen=True)
class CommitRow:
    """A commit.

    Attributes:
      number: after the baseline, from 1.
      subject: the first line of its message.
    """

    number: PositiveInt
    commit: str
    subject: str


@dataclass(frozen=True)
class BisectTrial:
    """A commit that was measured against the baseline of its search.

    Attributes:
      detail: why it could not be measured; empty otherwise.
      ratio: of its time over the baseline's; None where it could not be measured.
    """

    commit: CommitRow
    detail: str = ""
    ratio: PositiveFloat | None = None
    launches: NonNegativeInt = 0


@dataclass(frozen=True)
class BisectChange:
    """A commit that is slower, or faster, than the one before it, in a comparison of its own.

    Attributes:
      skipped: commits right before it that could not be measured: the change may be theirs.
    """

    commit: CommitRow
    verdict: VerdictRow
    skipped: Sequence[CommitRow] = ()


@dataclass(frozen=True, kw_only=True)
class BisectRecord:
    """A search for the commits that changed how long a function takes.

    Attributes:
      function: as the user named it.
      old: the baseline, as the user named it; `new` is the last commit.
      commits: after the baseline, the last one included.
      ends: the verdict on the last commit against the baseline; None without one.
      changes: those that were found, in the order of their commits.
      detail: one line; empty when ok.
    """

    record_type: ClassVar[str] = "bisect"
    function: str
    old: str
    new: str
    commits: NonNegativeInt
    status: Status
    detail: str = ""
    ends: VerdictRow | None = None
    trials: Sequence[BisectTrial] = ()
    changes: Sequence[BisectChange] = ()
    seconds: NonNegativeFloat = 0.0
