"""Measure the cells of a sweep that are missing, and store each result as it comes."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.errors import InputError, MachineError, suggestion
from mjbench.host.machine import Machine
from mjbench.sweep import commands, results, software
from mjbench.sweep.cells import Cell
from mjbench.sweep.commands import COMMANDS
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.node import NodeMeasurement, Request
from mjbench.sweep.ray_cluster import Event, Failed, LeftOut, RayCluster, Refused
from mjbench.sweep.results import CellOutcome, CellResult


@dataclass(frozen=True)
class NodeRecord:
    """What a node did; `busy_s` are seconds for which it was not quiet before."""

    name: str
    label: str
    cells: int = 0
    measured_s: float = 0.0
    busy_s: float = 0.0
    objection: str = ""


@dataclass(frozen=True)
class Summary:
    """What a sweep came to."""

    outcomes: Mapping[Cell, CellOutcome]
    nodes: tuple[NodeRecord, ...]
    left_out: tuple[LeftOut, ...]
    missing: tuple[Cell, ...]
    reasons: tuple[str, ...] = ()
    is_interrupted: bool = False


class Sweep:
    """Has the missing cells of a matrix measured."""

    def __init__(
        self,
        matrix: Matrix,
        done: Sequence[Cell],
        cluster: RayCluster,
        on_result: Callable[[CellResult, str, int], None],
        *,
        clock: Callable[[], float] = time.monotonic,
        program: tuple[str, ...] = (),
    ):
        """Prepare; `on_result` takes each result, its node, and the number of cells that have one.

        It is to store the result at once.
        """
        self._matrix, self._cluster = matrix, cluster
        self._on_result, self._program = on_result, program
        self._clock, self._patience_s = clock, matrix.plan.rules.patience_s
        self._active_s = clock()
        earlier = set(done)
        self._missing = {cell: None for cell in matrix.cells if cell not in earlier}
        self._outcomes: dict[Cell, CellOutcome] = {}
        self._records = {one.name: NodeRecord(one.name, one.label) for one in cluster.nodes}
        self._reasons: dict[str, None] = {}
        self._check_nodes()

    def _check_nodes(self) -> None:
        if not self._cluster.nodes:
            left_out = self._cluster.left_out
            reasons = "; ".join(f"{one.name}: {one.reason}" for one in left_out)
            none = "none declares the resource: ray start --resources '{\"mjbench\": 1}'"
            raise MachineError(f"no node of the cluster can measure ({reasons or none})")
        labels = sorted({one.label for one in self._cluster.nodes if one.label})
        for label in dict.fromkeys(cell.machine for cell in self._missing if cell.machine):
            if label not in labels:
                known = f"there are {', '.join(labels)}" if labels else "no node has one"
                raise InputError(
                    f"no node has the label {label!r}{suggestion(label, labels)}: {known}; give it"
                    f" by `ray start --labels mjbench-machine={label}`"
                )

    def measure(self) -> Summary:
        """Measure until all has been tried, no node is left, or the user stops it."""
        try:
            self._submit(list(self._missing))
            for event in self._cluster.events(self._patience_s):
                self._handle(event)
                if isinstance(event, Refused) and not self._is_active():
                    break
        except KeyboardInterrupt:
            return self._summary(is_interrupted=True)
        if self._missing and not self._reasons:
            self._reasons["there is no node that could measure"] = None
        return self._summary()

    def _is_active(self) -> bool:
        return self._clock() - self._active_s < self._patience_s

    def _submit(self, missing: Sequence[Cell]) -> None:
        nodes = Counter(one.label for one in self._cluster.nodes if one.label)
        nodes[""] = len(self._cluster.nodes)
        rules, here = self._matrix.plan.rules, software.installed()
        for cells in commands.batches(missing, nodes):
            is_timed = COMMANDS[cells[0].kind].needs_quiet
            line, quiet = self._matrix.command_line(cells), rules if is_timed else None
            request = Request(cells, line, here, quiet, self._program)
            self._cluster.submit(request, self._matrix.models_of(cells))

    def _handle(self, event: Event) -> None:
        match event:
            case NodeMeasurement():
                self._active_s = self._clock()
                self._keep(event.result, event.node)
                self._note(event)
            case Refused(request, reason):
                self._reasons[reason] = None
                self._submit([cell for cell in request.cells if cell in self._missing])
            case Failed(request, failure, machine):
                machine = machine or self._machine(request.cells[0].machine)
                for cell in [cell for cell in request.cells if cell in self._missing]:
                    self._keep(results.failed(cell, failure, machine))

    def _machine(self, label: str) -> Machine:
        return next(one.machine for one in self._cluster.nodes if label in ("", one.label))

    def _keep(self, result: CellResult, node: str = "no node") -> None:
        ndone = len(self._matrix.cells) - len(self._missing) + 1
        self._on_result(result, node, ndone)
        self._outcomes[result.cell] = result.outcome
        del self._missing[result.cell]

    def _note(self, measured: NodeMeasurement) -> None:
        name = measured.node
        record = self._records.get(name, NodeRecord(name, measured.label))
        self._records[name] = replace(
            record,
            cells=record.cells + 1,
            measured_s=record.measured_s + measured.wall_s,
            busy_s=record.busy_s + measured.busy_s,
            objection=measured.objection or record.objection,
        )

    def _summary(self, is_interrupted: bool = False) -> Summary:
        return Summary(
            outcomes=dict(self._outcomes),
            nodes=tuple(self._records.values()),
            left_out=self._cluster.left_out,
            missing=tuple(self._missing),
            reasons=tuple(self._reasons),
            is_interrupted=is_interrupted,
        )
