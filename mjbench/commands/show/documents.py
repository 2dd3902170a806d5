"""The documents that `--json` writes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.commands.compare.advice import Advice, ClockAdvice, ThreadAdvice
from mjbench.commands.compare.crossovers import Crossover, crossovers
from mjbench.commands.compare.results import ModelResults, PathResult
from mjbench.commands.doctor.detectable_change import Noise
from mjbench.commands.show.machine_comparison import MachineAnswer, Machines
from mjbench.commands.sweep.ray_cluster import Cell, CellResult
from mjbench.host.conditions import Condition
from mjbench.host.machine import Machine
from mjbench.results.runs import SCHEMA, Run
from mjbench.status import Status


@dataclass(frozen=True, kw_only=True)
class CompareDocument:
    """What `mjbench compare --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    results: Sequence[PathResult]
    advice: Sequence[Advice]
    clock: Sequence[ClockAdvice]
    crossovers: Sequence[Crossover]
    threads: Sequence[ThreadAdvice] = ()

    @classmethod
    def of(cls, machine: Machine, models: Sequence[ModelResults]) -> "CompareDocument":
        results = [result for model in models for result in model.results]
        return cls(
            machine=machine,
            results=results,
            advice=[advice for model in models for advice in model.advice],
            clock=[model.clock_advice for model in models if model.clock_advice is not None],
            crossovers=crossovers(results),
            threads=[advice for model in models for advice in model.thread_advice],
        )


@dataclass(frozen=True, kw_only=True)
class DoctorDocument:
    """What `mjbench doctor --json` writes."""

    schema: int = SCHEMA
    machine: Machine
    conditions: Sequence[Condition]
    noise: Noise


@dataclass(frozen=True)
class SweepRow:
    """A result that a plan asks for.

    Attributes:
      machine: label of the nodes that may measure it; empty for any.
      file: its run file; None where there is none.
      status: how it ended; None where it was not measured now.
    """

    command: str
    machine: str
    file: str | None
    status: Status | None
    detail: str

    @classmethod
    def of(cls, cell: Cell, file: Path, result: CellResult | None) -> "SweepRow":
        stored = str(file) if file.is_file() else None
        ended = (None, "") if result is None else (result.status, result.detail)
        return cls(cell.command, cell.machine, stored, *ended)


@dataclass(frozen=True)
class MachineRun:
    """A run of several: its machine, by the name that tells it from the others, and what it ran."""

    name: str
    command: str
    began: str
    machine: Machine


@dataclass(frozen=True, kw_only=True)
class MachinesDocument:
    """What `mjbench show --json` writes of several runs: what machines answer."""

    schema: int = SCHEMA
    runs: Sequence[MachineRun]
    results: Sequence[MachineAnswer]

    @classmethod
    def of(cls, runs: Sequence[Run], machines: Machines) -> "MachinesDocument":
        named = zip(runs, machines.identities, strict=True)
        return cls(
            runs=[
                MachineRun(each.name, run.header.command, run.header.began, run.header.machine)
                for run, each in named
            ],
            results=machines.answers,
        )
