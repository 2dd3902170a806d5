"""Which node measures which cells next, and what becomes of cells whose node fails.

Every cell is in one place: missing, on a node, or done; a result counts once. The scheduler starts
nothing, knows no Ray, and reads no clock: its caller says what happened, and when.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from mjbench.sweep.cells import Cell
from mjbench.sweep.commands import COMMANDS, Command
from mjbench.sweep.waiting import Waiting

# Seconds for which a node that refused or failed is left alone; twice as long each further time.
_REST_S, _LONGEST_REST_S = 15.0, 300.0
# Each host is to get so many more turns, so that none waits long for the last ones.
_TURNS_LEFT = 2


@dataclass(frozen=True)
class Node:
    """A node of the cluster.

    Attributes:
      name: for people.
      host: of nodes on one machine the same; they do not measure at once.
      label: of the machine; empty without one.
      cores: that it may use: as many commands that need no quiet machine may run on the host.
    """

    id: str
    name: str
    host: str
    label: str = ""
    cores: int = 1


@dataclass(frozen=True)
class Assignment:
    """Cells for a node.

    Attributes:
      cells: what it measures, by one command.
    """

    number: int
    node: Node
    cells: tuple[Cell, ...]

    @property
    def command(self) -> Command:
        """How these cells are measured."""
        return COMMANDS[self.cells[0].kind]


@dataclass(frozen=True)
class LostCell:
    """A cell that was begun as often as the plan allows, and never ended well.

    Attributes:
      detail: how it ended last, in one line.
    """

    cell: Cell
    detail: str


@dataclass(frozen=True)
class NodeRecord:
    """What became of a node.

    Attributes:
      is_there: whether it can be given work.
      cells: results that it delivered.
      failed: how often its command or its worker failed.
      reason: why it refused or failed last; empty if it never did.
    """

    node: Node
    is_there: bool = True
    cells: int = 0
    busy_s: float = 0.0
    refused: int = 0
    failed: int = 0
    reason: str = ""


@dataclass
class _NodeState:
    """A node's record, and how long it is left alone after troubles in a row."""

    record: NodeRecord
    rests_until_s: float = -math.inf
    next_rest_s: float = _REST_S

    def rest(self, now_s: float) -> None:
        """Leave the node alone for a while; twice as long each further time."""
        self.rests_until_s = now_s + self.next_rest_s
        self.next_rest_s = min(_LONGEST_REST_S, 2 * self.next_rest_s)

    def is_resting(self, now_s: float) -> bool:
        """Return whether it is left alone now."""
        return now_s < self.rests_until_s


@dataclass
class _Running:
    assignment: Assignment
    missing: list[Cell]
    begin_s: float
    has_begun: bool = False


class Scheduler:
    """Hands out cells."""

    def __init__(
        self, cells: Iterable[Cell], tries: int = 3, patience_s: float = 600.0, now_s: float = 0.0
    ):
        """Take the cells that are missing.

        Args:
          cells: each once, in the order in which they are to be measured.
          tries: how often a cell is begun at most.
          patience_s: seconds without a node that measures, after which `is_stuck`.
        """
        self._waiting = Waiting(cells)
        self._tries, self._patience_s = tries, patience_s
        self._failures: Counter[Cell] = Counter()
        self._failed_on: dict[Cell, set[str]] = {}
        self._running: dict[int, _Running] = {}
        self._on_host: dict[str, list[Assignment]] = {}
        self._count = 0
        self._active_s = now_s
        self._nodes: dict[str, _NodeState] = {}

    # -- what is there to do ---------------------------------------------------------------------

    @property
    def is_done(self) -> bool:
        """Whether nothing is missing, and nothing runs."""
        return not self._waiting and not self._running

    @property
    def missing(self) -> tuple[Cell, ...]:
        """The cells without a result, those that are being measured included."""
        running = [cell for run in self._running.values() for cell in run.missing]
        return (*self._waiting, *running)

    @property
    def missing_count(self) -> int:
        """How many cells are without a result."""
        return len(self._waiting) + sum(len(run.missing) for run in self._running.values())

    @property
    def nodes(self) -> tuple[NodeRecord, ...]:
        """What became of each node."""
        return tuple(state.record for state in self._nodes.values())

    @property
    def running(self) -> tuple[Assignment, ...]:
        """What is being measured."""
        return tuple(run.assignment for run in self._running.values())

    def is_stuck(self, now_s: float) -> bool:
        """Return whether no node has measured anything for longer than the plan's patience."""
        return not self.is_done and not self._running and self._idle_s(now_s) >= self._patience_s

    def _idle_s(self, now_s: float) -> float:
        return now_s - self._active_s

    def reasons(self) -> list[str]:
        """Return why nodes did not measure, each in one line."""
        lines = [f"{record.node.name}: {record.reason}" for record in self.nodes if record.reason]
        labels = self._waiting.labels()
        there = {record.node.label for record in self.nodes if record.is_there}
        lines += [f"no node has the label {label}" for label in sorted(labels - there)]
        if not any(record.is_there for record in self.nodes):
            lines.append("there is no node")
        return lines

    # -- nodes -----------------------------------------------------------------------------------

    def join(self, node: Node) -> None:
        """Take a node into account, also one that was gone."""
        state = self._nodes.setdefault(node.id, _NodeState(NodeRecord(node)))
        state.record = replace(state.record, node=node, is_there=True)

    def leave(self, node_id: str, reason: str) -> None:
        """Note that a node is gone; what it measures ends by `end` as well."""
        if state := self._nodes.get(node_id):
            state.record = replace(state.record, is_there=False, reason=reason)

    # -- assignments -----------------------------------------------------------------------------

    def assign(self, now_s: float) -> list[Assignment]:
        """Return what nodes are to begin now; it counts as running from here on.

        Nodes take turns, so that none has several commands while another has none.
        """
        begun: list[Assignment] = []
        while turn := [
            assignment
            for state in self._nodes.values()
            if state.record.is_there and (assignment := self._assign(state, now_s))
        ]:
            begun += turn
        return begun

    def _assign(self, state: _NodeState, now_s: float) -> Assignment | None:
        """Have a node begin one command more; None where it is not to."""
        cells = self._choose(state, now_s)
        if not cells:
            return None
        assignment = Assignment(self._count, state.record.node, cells)
        self._count += 1
        self._running[assignment.number] = _Running(assignment, list(cells), now_s)
        self._on_host.setdefault(state.record.node.host, []).append(assignment)
        self._waiting.take(cells)
        return assignment

    def _choose(self, state: _NodeState, now_s: float) -> tuple[Cell, ...]:
        """Return what a node is to measure next; nothing while it may not.

        A machine that measures time does nothing else. While there is time to be measured on it,
        nothing is begun that would keep it from that.
        """
        node, is_resting = state.record.node, state.is_resting(now_s)
        beside = self._on_host.get(node.host, [])
        if any(assignment.command.needs_quiet for assignment in beside):
            return ()
        if not is_resting and self._eligible(node, needs_quiet=True):
            return () if beside else self._together(node, needs_quiet=True)
        has_failed = is_resting and state.record.failed > 0
        if has_failed or len(beside) >= node.cores:
            return ()
        return self._together(node, needs_quiet=False)

    def _eligible(self, node: Node, needs_quiet: bool) -> int:
        """Return how many cells that wait a node may measure."""
        return self._waiting.count(node.label, needs_quiet) + len(self._failed(node, needs_quiet))

    def _failed(self, node: Node, needs_quiet: bool) -> list[Cell]:
        """Return the cells that failed before and that a node may measure."""
        return [
            cell
            for cell in self._waiting.failed
            if COMMANDS[cell.kind].needs_quiet == needs_quiet and self._may_measure(cell, node)
        ]

    def _may_measure(self, cell: Cell, node: Node) -> bool:
        """Return whether a node may measure a cell: one that failed on its host goes elsewhere."""
        if cell.machine and cell.machine != node.label:
            return False
        failed_on = self._failed_on.get(cell, set())
        if node.host not in failed_on:
            return True
        others = [
            other
            for other in self.nodes
            if other.is_there
            and other.node.host not in failed_on
            and (not cell.machine or other.node.label == cell.machine)
        ]
        return not others

    def _together(self, node: Node, needs_quiet: bool) -> tuple[Cell, ...]:
        """Return the next cell that a node may measure, with those that one command measures, too.

        There are fewer, the fewer are left for each host. A cell that failed before is alone: it
        must not take others with it again.
        """
        first = self._waiting.next_together(node.label, needs_quiet, most=1)
        if not first:
            return tuple(self._failed(node, needs_quiet)[:1])
        command = COMMANDS[first[0].kind]
        hosts = len({record.node.host for record in self.nodes if record.is_there})
        turns = _TURNS_LEFT * hosts if hosts > 1 else 1
        share = math.ceil(self._eligible(node, needs_quiet) / turns)
        size = min(command.most, max(command.least, share))
        return self._waiting.next_together(node.label, needs_quiet, size)

    # -- what happened ---------------------------------------------------------------------------

    def begin(self, number: int, now_s: float) -> None:
        """Note that an assignment's command has been started."""
        if run := self._running.get(number):
            run.has_begun = True
            self._active_s = now_s

    def has_begun(self, number: int) -> bool:
        """Return whether an assignment's command has been started."""
        run = self._running.get(number)
        return run is not None and run.has_begun

    def begun_s(self, number: int) -> float:
        """Return when an assignment was handed out."""
        return self._running[number].begin_s

    def open_cells(self, number: int) -> tuple[Cell, ...]:
        """Return the cells of an assignment that runs which have no result yet."""
        run = self._running.get(number)
        return tuple(run.missing) if run else ()

    def deliver(self, number: int, cell: Cell) -> bool:
        """Return whether a result is the first of its cell, and is to be stored."""
        run = self._running.get(number)
        if run is None or cell not in run.missing:
            return False
        run.missing.remove(cell)
        state = self._nodes[run.assignment.node.id]
        state.record = replace(state.record, cells=state.record.cells + 1)
        state.next_rest_s = _REST_S
        return True

    def refuse(self, number: int, reason: str, now_s: float) -> None:
        """Put back what a node does not measure now; it is asked again later."""
        if run := self._stop(number):
            state = self._nodes[run.assignment.node.id]
            state.record = replace(state.record, refused=state.record.refused + 1, reason=reason)
            state.rest(now_s)
            self._put_back(run.missing)

    def end(self, number: int, problem: str, now_s: float) -> list[LostCell]:
        """Note that an assignment has ended.

        Args:
          problem: what went wrong, in one line; empty where all went well.

        Returns:
          The cells that are given up: none of their tries ended well. They count as done.
        """
        run = self._stop(number)
        if run is None:
            return []
        state = self._nodes[run.assignment.node.id]
        state.record = replace(state.record, busy_s=state.record.busy_s + now_s - run.begin_s)
        self._active_s = now_s
        if problem:
            state.record = replace(state.record, failed=state.record.failed + 1, reason=problem)
            state.rest(now_s)
        lost = []
        for cell in run.missing:
            self._failures[cell] += 1
            self._failed_on.setdefault(cell, set()).add(run.assignment.node.host)
            if self._failures[cell] >= self._tries:
                lost.append(LostCell(cell, problem or "the command ended without this result"))
        given_up = {item.cell for item in lost}
        self._put_back([cell for cell in run.missing if cell not in given_up])
        return lost

    def _put_back(self, cells: Sequence[Cell]) -> None:
        """Have cells measured next; those that failed last, so that they do not hold up others."""
        self._waiting.put_first([cell for cell in cells if not self._failures[cell]])
        self._waiting.put_last(cell for cell in cells if self._failures[cell])

    def _stop(self, number: int) -> _Running | None:
        """Return what an assignment was, which no longer runs; None where it did not."""
        run = self._running.pop(number, None)
        if run is not None:
            self._on_host[run.assignment.node.host].remove(run.assignment)
        return run
