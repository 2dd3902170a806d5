"""What a search for the first slower commit or release comes to, as a run file stores it.

Field names are the keys of the JSON format.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt
from mjbench.paired.records import VerdictRow
from mjbench.status import Status


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


@dataclass(frozen=True)
class BisectTrial:
    """A version that was measured against the baseline of its search.

    Attributes:
      detail: why it could not be measured; empty otherwise.
      ratio: of its time over the baseline's; None where it could not be measured.
    """

    version: VersionRow
    detail: str = ""
    ratio: PositiveFloat | None = None
    launches: NonNegativeInt = 0


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
