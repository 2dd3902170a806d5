"""The rows of `mjbench instructions --json` and `mjbench explain --json`.

Field names are the keys of the JSON format (docs/formats.md); there the baseline is `old` and the
candidate `new`, as on the command line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mjbench.paired.records import VerdictRow
from mjbench.simulation.work import Work
from mjbench.status import Status


@dataclass(frozen=True)
class FunctionCount:
    """Instructions of one function, per step.

    Attributes:
      name: of the function.
      self: executed by the function itself.
      inclusive: the same with all that it called.
    """

    name: str
    self: float
    inclusive: float


@dataclass(frozen=True, kw_only=True)
class InstructionsRow:
    """What one model's steps cost in one release, in instructions; None where it is unknown.

    Attributes:
      model: its name.
      release: of MuJoCo.
      status: how counting ended.
      detail: one line; empty when ok.
      instructions_per_step: of the engine: `mj_step` with all that it called.
      outside_per_step: of everything else: the bindings, and Python.
      functions: of the engine, costliest first.
      stages: instructions per step, by stage of the pipeline; their sum is the engine's.
      steps: number of steps counted.
      work: contacts, constraints, solver iterations per step.
      repeats: how much a second pass over the same work differed, as a share.
      diverged: number of simulations that diverged.
      warnings: how many of the others raised each warning of MuJoCo; None where it was not counted.
      seconds: time of counting, divided equally among the models counted together.
      build: tells builds of one version apart; empty where it is unknown.
    """

    model: str
    release: str
    status: Status = Status.OK
    detail: str = ""
    instructions_per_step: float | None = None
    outside_per_step: float | None = None
    functions: Sequence[FunctionCount] = ()
    stages: Mapping[str, float] | None = None
    steps: int = 0
    work: Work | None = None
    repeats: float | None = None
    diverged: int = 0
    warnings: Mapping[str, int] | None = None
    seconds: float = 0.0
    build: str = ""


@dataclass(frozen=True)
class CountPair:
    """Instructions per step in both releases; None where they were not counted."""

    old: float | None
    new: float | None


@dataclass(frozen=True)
class CountedWorkPair:
    """Work per step in both releases; None where it was not counted."""

    old: Work | None
    new: Work | None


class Occurrence(StrEnum):
    """In which of two releases a function occurs."""

    BOTH = ""
    NEW = "new"
    """Only in the candidate."""
    GONE = "gone"
    """Only in the baseline."""


@dataclass(frozen=True)
class FunctionDifference:
    """Instructions per step that a function executes itself, in both releases.

    Attributes:
      name: of the function.
      old: in the baseline; None where it does not occur.
      new: in the candidate; None where it does not occur.
      difference: candidate minus baseline.
    """

    name: str
    old: float | None
    new: float | None
    difference: float

    @classmethod
    def of(cls, name: str, old: float | None, new: float | None) -> "FunctionDifference":
        """Return the difference of a function that occurs in at least one of the releases."""
        return cls(name, old, new, (new or 0.0) - (old or 0.0))

    @property
    def occurrence(self) -> Occurrence:
        """In which of the releases it occurs."""
        if self.old is None:
            return Occurrence.NEW
        return Occurrence.GONE if self.new is None else Occurrence.BOTH


@dataclass(frozen=True, kw_only=True)
class ExplainRow:
    """What changed from one release to another on one model.

    Attributes:
      model: its name.
      old: MuJoCo release of the baseline.
      new: MuJoCo release of the candidate.
      status: how counting ended; the baseline's, if both failed.
      instructions_per_step: of the engine.
      outside_per_step: of everything else: the bindings, and Python.
      work: contacts, constraints, solver iterations per step.
      stages: instructions per step, by stage of the pipeline.
      functions: that differ, the largest difference first.
      time: the paired comparison of time; None where time was not compared.
    """

    model: str
    old: str
    new: str
    status: Status
    instructions_per_step: CountPair
    outside_per_step: CountPair
    work: CountedWorkPair
    stages: Mapping[str, CountPair]
    functions: Sequence[FunctionDifference]
    time: VerdictRow | None
