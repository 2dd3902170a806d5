"""The rows of `mjbench profile --instructions --json` and `mjbench versions --explain --json`.

Field names are the keys of the JSON format (docs/formats.md); there the baseline is `old` and the
candidate `new`, as on the command line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.bounds import AnyFloat, NonNegativeFloat, NonNegativeInt, PositiveFloat, Version
from mjbench.paired.records import Pair, VerdictRow
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import Starts
from mjbench.status import Status


@dataclass(frozen=True)
class FunctionCount:
    """Instructions of one function, per step.

    Attributes:
      self: executed by the function itself.
      inclusive: the same with all that it called.
    """

    name: str
    self: NonNegativeFloat
    inclusive: NonNegativeFloat


@dataclass(frozen=True, kw_only=True)
class InstructionsRecord:
    """What one model's steps cost in one release, in instructions; None where it is unknown.

    Attributes:
      instructions_per_step: of the engine: `mj_step` with all that it called.
      outside_per_step: of everything else: the bindings, and Python.
      functions: of the engine, costliest first.
      stages: instructions per step, by stage of the pipeline; their sum is the engine's.
      work: contacts, constraints, solver iterations per step.
      repeats: how much a second pass over the same work differed, as a share.
      warnings: how many of the others raised each warning of MuJoCo; None where it was not counted.
      seconds: of counting; the start of a process counts to its first model.
      build: tells builds of one version apart; empty where it is unknown.
      starts: where start states came from; None where another release drew them.
    """

    record_type: ClassVar[str] = "instructions"
    model: str
    release: Version
    status: Status = Status.OK
    detail: str = ""
    instructions_per_step: NonNegativeFloat | None = None
    outside_per_step: NonNegativeFloat | None = None
    functions: Sequence[FunctionCount] = ()
    stages: Mapping[str, AnyFloat] | None = None
    steps: NonNegativeInt = 0
    work: Work | None = None
    repeats: NonNegativeFloat | None = None
    diverged: NonNegativeInt = 0
    warnings: Mapping[str, NonNegativeInt] | None = None
    seconds: NonNegativeFloat = 0.0
    build: str = ""
    starts: Starts | None = None


@dataclass(frozen=True, kw_only=True)
class FunctionDifference:
    """Instructions per step that a function executes itself in both releases.

    Attributes:
      old: in the baseline; None where it does not execute.
      new: in the candidate; None where it does not execute.
      difference: candidate minus baseline.
      moved_with: functions to which cost moved from this one, or from which it came.
    """

    name: str
    old: NonNegativeFloat | None
    new: NonNegativeFloat | None
    difference: AnyFloat
    moved_with: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class ExplainRecord:
    """What changed from one release to another on one model, or in an operation around the step.

    Of an operation, instructions are those of doing it once, bindings and Python included.

    Attributes:
      model: its name; empty for an operation that builds its own.
      status: how counting ended; the baseline's, if both failed.
      detail: which release failed, and why; empty when ok.
      instructions_per_step: of the engine.
      outside_per_step: of everything else: the bindings, and Python.
      functions: that differ in instructions executed, the largest difference first; a run file has
        those that changed most.
      time: the paired comparison of time; None where time was not compared.
      changes: how the work of the two differs, in a few words each; empty where it is the same.
      warnings: how many simulations that did not diverge raised each warning of MuJoCo.
      operation: name of the operation (see `paired.operations`); empty for a step.
    """

    record_type: ClassVar[str] = "explain"
    model: str
    old: Version
    new: Version
    status: Status
    instructions_per_step: Pair[PositiveFloat | None]
    outside_per_step: Pair[NonNegativeFloat | None]
    work: Pair[Work | None]
    stages: Mapping[str, Pair[AnyFloat | None]]
    functions: Sequence[FunctionDifference]
    time: VerdictRow | None
    detail: str = ""
    changes: Sequence[str] = ()
    warnings: Pair[Mapping[str, NonNegativeInt]] | None = None
    operation: str = ""

    @property
    def series(self) -> str:
        """Which rows are of the same thing, in other releases; its name for people."""
        return self.operation or self.model
