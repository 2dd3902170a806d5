"""What a search for the first slower commit or release comes to, as a run file stores it.

Field names are the keys of the JSON format.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import fmean
from typing import ClassVar

from mjbench.bounds import LogRatio, NonNegativeFloat, NonNegativeInt, PositiveInt
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.status import FINISHED, Status
from mjbench.store.json_form import in_json


class VersionKind(StrEnum):
    """What a search goes through."""

    COMMIT = "commit"
    """Of the user's code."""
    RELEASE = "release"
    """Of MuJoCo."""


@dataclass(frozen=True)
class VersionRow:
    """A commit, or a release.

    Attributes:
      number: after the baseline, from 1.
      name: the full hash of a commit, or a release such as 3.3.0.
      subject: the first line of a commit's message; empty for a release.
    """

    number: PositiveInt
    name: str
    subject: str = ""


@in_json("version", "detail", "ratio", "first", "log_ratios", "seconds")
@dataclass(frozen=True)
class BisectTrial:
    """A version that was measured against the first one of a range that is searched.

    Attributes:
      detail: why it could not be measured; empty otherwise.
      first: the number of the first one; 0 is the baseline.
      log_ratios: of its time over the first one's, of each launch; none where it was not measured.
    """

    record_type: ClassVar[str] = "bisect_trial"
    version: VersionRow
    detail: str = ""
    first: NonNegativeInt = 0
    log_ratios: Sequence[LogRatio] = ()
    seconds: NonNegativeFloat = 0.0

    @property
    def ratio(self) -> float | None:
        """Of its time over the first one's, the mean over launches; None where there is none."""
        return math.exp(fmean(self.log_ratios)) if self.log_ratios else None


@dataclass(frozen=True)
class BisectComparison:
    """A comparison of two versions, until its verdict is certain.

    Attributes:
      first: the number of the baseline of this comparison; `last` is the candidate.
    """

    record_type: ClassVar[str] = "bisect_comparison"
    first: NonNegativeInt
    last: PositiveInt
    verdict: VerdictRecord
    seconds: NonNegativeFloat = 0.0


@dataclass(frozen=True)
class BisectChange:
    """A version that is slower, or faster, than the one before it, in a comparison of its own.

    Attributes:
      skipped: versions right before it that could not be measured: the change may be theirs.
      known_causes: what is known to have changed in this release, in a sentence each.
    """

    version: VersionRow
    verdict: VerdictRow
    skipped: Sequence[VersionRow] = ()
    known_causes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class BisectRecord:
    """A search for the commits or releases that changed how long something takes.

    Attributes:
      target: the function or the model, as the user named it.
      old: the baseline, as the user named it; `new` is the last version.
      versions: how many there are after the baseline, the last one included.
      ends: the verdict on the last version against the baseline; None without one.
      changes: those that were found, in the order of their versions.
      detail: one line; empty when ok.
      seconds: of all comparisons and trials, also of those before it was continued.
      kind: what was searched.
    """

    record_type: ClassVar[str] = "bisect"
    target: str
    old: str
    new: str
    versions: NonNegativeInt
    status: Status
    detail: str = ""
    ends: VerdictRow | None = None
    trials: Sequence[BisectTrial] = ()
    changes: Sequence[BisectChange] = ()
    seconds: NonNegativeFloat = 0.0
    kind: VersionKind = VersionKind.COMMIT


BisectMeasured = BisectTrial | BisectComparison | BisectRecord


def finished(records: Sequence[object]) -> list[BisectMeasured]:
    """Return the records of a run file that need not be measured again when it is continued.

    A version that could not be measured is tried again, unless the search has ended.
    """
    measured = [record for record in records if isinstance(record, BisectMeasured)]
    if any(isinstance(r, BisectRecord) and r.status in FINISHED for r in measured):
        return measured
    return [
        record
        for record in measured
        if (isinstance(record, BisectTrial) and record.ratio is not None)
        or (isinstance(record, BisectComparison) and record.verdict.status in FINISHED)
    ]
