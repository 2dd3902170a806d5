"""The document that `mjbench show --json` writes of a run set."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import Run
from mjbench.paired.across_machines import AcrossMachines
from mjbench.report.across_machines import SideBySide
from mjbench.report.advice_across import AdviceAcross


@dataclass(frozen=True)
class SetRun:
    """A run of a set: its machine, by the name it has in the set, and what it ran."""

    name: str
    command: str
    began: str
    machine: Machine


@dataclass(frozen=True, kw_only=True)
class RunSetDocument:
    """What `mjbench show --json` writes of a run set: what machines show side by side."""

    schema: int = 2
    runs: Sequence[SetRun]
    verdicts: AcrossMachines
    advice: Sequence[AdviceAcross]

    @classmethod
    def of(cls, runs: Sequence[Run], results: SideBySide) -> "RunSetDocument":
        """Return the document of a set's runs."""
        named = zip(runs, results.machines, strict=True)
        return cls(
            runs=[
                SetRun(machine.name, run.header.command, run.header.began, run.header.machine)
                for run, machine in named
            ],
            verdicts=results.verdicts,
            advice=results.advice,
        )
