"""From a plan to its cells, and to the models that travel to nodes."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.paired.outcomes import Metric
from mjbench.paths import BASE
from mjbench.releases.installs import INSTALLED
from mjbench.simulation.models import ModelSource
from mjbench.sweep import model_files
from mjbench.sweep.cells import Cell, Kind
from mjbench.sweep.commands import COMMANDS, CommandLine
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.plan import Part, Plan
from mjbench.sweep.software import Software


@dataclass(frozen=True)
class Matrix:
    """All that a sweep measures.

    Attributes:
      cells: each once, in the order in which they are measured.
      carried: the user's own models, by name.
    """

    plan: Plan
    cells: tuple[Cell, ...]
    carried: Mapping[str, CarriedModel]

    @property
    def comparisons(self) -> int:
        """How many verdicts one machine's results hold, all of which are decided together."""
        count = sum(cell.kind == Kind.VERSIONS for cell in self.cells)
        return count // max(1, len(self.plan.machines))

    def command_line(self, cells: Sequence[Cell]) -> CommandLine:
        """Return the command line that measures cells which belong together."""
        kind = cells[0].kind
        line = COMMANDS[kind].line(cells)
        (part,) = (part for part in self.plan.parts if part.kind == kind)
        arguments = [*line.arguments, *part.options]
        if kind == Kind.VERSIONS:
            arguments += ["--family", str(self.comparisons)]
        return CommandLine(tuple(arguments), line.operands)

    def models_of(self, cells: Sequence[Cell]) -> list[CarriedModel]:
        """Return the models that must travel with cells."""
        names = dict.fromkeys(cell.model for cell in cells)
        return [self.carried[name] for name in names if name in self.carried]


def build(plan: Plan, software: Software) -> Matrix:
    """Return the cells of a plan; models of the user's own are read, with what they refer to.

    Args:
      software: that measures. Results with other versions are other cells.

    Raises:
      InputError: a model cannot be loaded, or not from a copy.
      MachineError: loading a model crashed or hung.
    """
    carried = {
        source.name: model_files.carry(source)
        for source in plan.models
        if not model_files.is_shipped(source)
    }
    digests = {
        source.name: carried[source.name].digest
        if source.name in carried
        else model_files.content_digest(source)
        for source in plan.models
    }
    cells = [
        cell
        for machine in plan.machines or ("",)
        for part in plan.parts
        for source in plan.models
        for cell in _cells(plan, part, source, machine, _content(part, software, digests, source))
    ]
    return Matrix(plan, tuple(cells), carried)


def _content(
    part: Part, software: Software, digests: Mapping[str, str], source: ModelSource
) -> str:
    """Return a text for what a result depends on, beside what the cell names."""
    versions = [software.python, software.numpy]
    if part.kind == Kind.COMPARE:
        versions.append(software.mujoco)
    return json.dumps([part.options, versions, digests[source.name]])


def _cells(
    plan: Plan, part: Part, source: ModelSource, machine: str, content: str
) -> Iterator[Cell]:
    """Yield the cells of one part of the plan on one model and machine."""
    name = source.name
    installed = "".join(spec.version for spec in plan.releases if spec.name == INSTALLED)
    match part.kind:
        case Kind.COMPARE:
            yield Cell(part.kind, name, machine=machine, content=content)
        case Kind.VERSIONS:
            for metric in plan.metrics:
                for path in plan.paths if metric == Metric.TIME else (BASE,):
                    for old, new in plan.pairs:
                        yield Cell(
                            part.kind,
                            name,
                            new.version,
                            old.version,
                            installed,
                            path,
                            metric,
                            machine,
                            content,
                        )
        case Kind.INSTRUCTIONS:
            first = plan.releases[0].version
            for spec in plan.releases:
                yield Cell(
                    part.kind,
                    name,
                    spec.version,
                    first,
                    installed,
                    machine=machine,
                    content=content,
                )
        case Kind.HISTORY:
            for spec in plan.releases:
                yield Cell(
                    part.kind,
                    name,
                    spec.version,
                    installed=installed,
                    machine=machine,
                    content=content,
                )
