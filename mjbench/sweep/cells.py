"""The cells of a sweep: everything that a plan asks for, each result once.

A cell is one section of the run set, which names it by the cell's key.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from enum import StrEnum

from mjbench.paired.metrics import Metric

# Hexadecimal digits of a key's digest.
_DIGEST_LENGTH = 10


class CellKind(StrEnum):
    """What a cell measures; the table of the plan that asks for it has the same name."""

    VERSIONS = "versions"
    """A release against another, on one model, by one path and metric."""
    COMPARE = "compare"
    """The paths of the installed release, on one model."""
    INSTRUCTIONS = "instructions"
    """Instructions of a step of one model in one release."""
    HISTORY = "history"
    """The time of a step of one model in one release, against the history's fixed release."""


@dataclass(frozen=True)
class Cell:
    """One result of a sweep. What does not apply to its kind is empty.

    Attributes:
      release: version that is measured, of `versions` the candidate.
      baseline: of `versions`, the version that `release` is compared with; of `instructions`, the
        one that draws start states and controls for all.
      installed: version that is meant as it is installed beside mjbench; empty where releases are
        all installed apart.
      content: a text that stands for all else on which the result depends: the model's files, the
        options of the command, versions of packages.
    """

    kind: CellKind
    model: str
    release: str = ""
    baseline: str = ""
    installed: str = ""
    path: str = ""
    metric: Metric | None = None
    machine: str = ""
    content: str = ""

    @property
    def name(self) -> str:
        """The cell as people read it, such as `versions humanoid 3.3.0 → 4.0.0 python_loop`."""
        releases = self.release
        if self.kind == CellKind.VERSIONS:
            releases = f"{self.baseline} → {self.release}"
        metric = "" if self.metric in (None, Metric.TIME) else self.metric
        machine = f"on {self.machine}" if self.machine else ""
        parts = (self.kind, self.model, releases, self.path, metric or "", machine)
        return " ".join(filter(None, parts))

    @property
    def key(self) -> str:
        """What the run set calls it: the name, and a digest of all of it."""
        digest = hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()
        return f"{self.name} #{digest[:_DIGEST_LENGTH]}"
