"""From a plan to its cells, and to the models that travel to nodes."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.paired.metrics import METRICS
from mjbench.paths import BASE
from mjbench.releases.release_names import INSTALLED
from mjbench.sweep import model_files
from mjbench.sweep.cells import Cell, CellKind
from mjbench.sweep.commands import COMMANDS, CommandLine
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.plan import Plan
from mjbench.sweep.software import Software


@dataclass(frozen=True)
class Matrix:
    """All that a sweep measures."""

    plan: Plan
    cells: tuple[Cell, ...]
    carried: Mapping[str, CarriedModel]

    @property
    def comparisons(self) -> int:
        """How many verdicts one machine's results hold, all of which are decided together."""
        count = sum(cell.kind == CellKind.VERSIONS for cell in self.cells)
        return count // max(1, len(self.plan.machines))

    def command_line(self, cells: Sequence[Cell]) -> CommandLine:
        kind = cells[0].kind
        line = COMMANDS[kind].line(cells)
        arguments = [*line.arguments, *self.plan.options[kind]]
        if kind == CellKind.VERSIONS:
            arguments += ["--family", str(self.comparisons)]
        return CommandLine(tuple(arguments), line.operands)

    def models_of(self, cells: Sequence[Cell]) -> list[CarriedModel]:
        names = dict.fromkeys(cell.model for cell in cells)
        return [self.carried[name] for name in names if name in self.carried]


def build(plan: Plan, software: Software) -> Matrix:
    """Return the cells of a plan for some software; the user's models are read."""
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
        for kind in plan.options
        for model, digest in digests.items()
        for cell in _cells(plan, kind, model, machine, _content(plan, kind, software, digest))
    ]
    return Matrix(plan, tuple(cells), carried)


def _content(plan: Plan, kind: CellKind, software: Software, digest: str) -> str:
    versions = [software.python, software.numpy]
    if kind == CellKind.COMPARE:
        versions.append(software.mujoco)
    return json.dumps([plan.options[kind], versions, digest])


def _cells(plan: Plan, kind: CellKind, model: str, machine: str, content: str) -> Iterator[Cell]:
    cell = Cell(kind, model, machine=machine, content=content)
    if kind == CellKind.COMPARE:
        yield cell
        return
    installed = "".join(spec.version for spec in plan.releases if spec.name == INSTALLED)
    cell = replace(cell, installed=installed)
    if kind == CellKind.VERSIONS:
        for metric in plan.metrics:
            for path in (BASE,) if METRICS[metric].refusal else plan.paths:
                compared = replace(cell, path=path, metric=metric)
                for old, new in plan.pairs:
                    yield replace(compared, release=new.version, baseline=old.version)
        return
    first = plan.releases[0].version if kind == CellKind.INSTRUCTIONS else ""
    for spec in plan.releases:
        yield replace(cell, release=spec.version, baseline=first)
