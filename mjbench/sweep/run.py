"""Measure the cells of a sweep that are missing, and store each result as it comes."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mjbench.errors import Failure, InputError, MachineError, suggestion
from mjbench.instrument import child
from mjbench.instrument.machine import Machine
from mjbench.status import ExitCode, Status
from mjbench.sweep import results
from mjbench.sweep.cells import Cell
from mjbench.sweep.executor import Died, Event, Executor, Joined, Left, LeftOut, Reported
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.messages import Began, Finished, Lines, Message, Refused, Request
from mjbench.sweep.results import CellResult, Collector, Outcome
from mjbench.sweep.scheduler import Assignment, LostCell, NodeRecord, Scheduler

# How long to wait for something to happen, in seconds, before looking at the clock again.
_WAIT_S = 1.0
# A node that has not started its command after so many seconds has no room for it.
_BEGIN_S = 90.0
_NO_ROOM = "it is taken by other work of the cluster"


@dataclass(frozen=True)
class Progress:
    """How far a sweep is.

    Attributes:
      done: cells with a result, earlier ones included.
    """

    done: int
    count: int
    running: tuple[Assignment, ...]


@dataclass(frozen=True)
class Summary:
    """What a sweep came to.

    Attributes:
      outcomes: of the cells that were measured now, in the order in which they were complete.
      reasons: why nodes did not measure, where they are why cells are missing.
      finished: what the nodes said of each command that ended.
    """

    outcomes: Mapping[Cell, Outcome]
    nodes: tuple[NodeRecord, ...]
    left_out: tuple[LeftOut, ...]
    missing: tuple[Cell, ...]
    reasons: tuple[str, ...] = ()
    is_interrupted: bool = False
    finished: tuple[Finished, ...] = ()


class Sweep:
    """Has the missing cells of a matrix measured."""

    def __init__(
        self,
        matrix: Matrix,
        done: Sequence[Cell],
        executor: Executor,
        store: Callable[[CellResult], None],
        record_types: Mapping[str, type],
        *,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        on_left_out: Callable[[LeftOut], None] = lambda left_out: None,
        clock: Callable[[], float] = time.monotonic,
        program: tuple[str, ...] = (),
    ):
        """Prepare.

        Args:
          done: those that need not be measured.
          record_types: the class of each record of a run file by its `type`.
          on_left_out: called with nodes that cannot be given work.
          program: what runs on nodes instead of mjbench; for tests.
        """
        self._matrix, self._executor, self._store = matrix, executor, store
        self._types, self._clock, self._program = record_types, clock, program
        self._on_progress, self._on_left_out = on_progress, on_left_out
        rules, earlier = matrix.plan.rules, set(done)
        missing = [cell for cell in matrix.cells if cell not in earlier]
        self._scheduler = Scheduler(missing, rules.tries, rules.patience_s, clock())
        self._collectors: dict[int, Collector] = {}
        self._assignments: dict[int, Assignment] = {}
        self._machines: dict[str, Machine] = {}
        self._outcomes: dict[Cell, Outcome] = {}
        self._left_out: list[LeftOut] = []
        self._finished: list[Finished] = []

    def take_nodes(self, events: Sequence[Event]) -> None:
        """Take the nodes that are there before anything begins.

        Raises:
          InputError: no node has a label that the plan names.
          MachineError: there is no node that can measure.
        """
        for event in events:
            self._handle(event)
        nodes = [record.node for record in self._scheduler.nodes]
        if not nodes:
            reasons = "; ".join(f"{one.name}: {one.reason}" for one in self._left_out)
            raise MachineError(f"no node of the cluster can measure ({reasons or 'there is none'})")
        labels = sorted({node.label for node in nodes if node.label})
        for label in {cell.machine: None for cell in self._scheduler.missing if cell.machine}:
            if label not in labels:
                known = f"there are {', '.join(labels)}" if labels else "no node has one"
                raise InputError(
                    f"no node has the label {label!r}{suggestion(label, labels)}: {known}; give it"
                    f" by `ray start --labels mjbench-machine={label}`, or MJBENCH_MACHINE={label}"
                )

    def measure(self) -> Summary:
        """Measure until nothing is missing, no node would measure, or the user stops it.

        Raises:
          MachineError: a result cannot be stored.
        """
        try:
            while not self._scheduler.is_done and not self._scheduler.is_stuck(self._clock()):
                self._step()
        except KeyboardInterrupt:
            return self._summary(is_interrupted=True)
        return self._summary()

    def _step(self) -> None:
        """Hand out what can be handed out, and handle what happens next."""
        assignments = self._scheduler.assign(self._clock())
        for assignment in assignments:
            self._start(assignment)
        if assignments:
            self._show_progress()
        events = self._executor.events(_WAIT_S)
        for event in events:
            self._handle(event)
        if events:
            self._show_progress()
        self._stop_waiting()

    def _start(self, assignment: Assignment) -> None:
        cells = assignment.cells
        is_timed = assignment.command.needs_quiet
        request = Request(
            self._matrix.command_line(cells),
            self._matrix.plan.rules.limits if is_timed else None,
            assignment.node.label,
            self._program,
        )
        self._assignments[assignment.number] = assignment
        self._collectors[assignment.number] = Collector(cells, self._types)
        models = self._matrix.models_of(cells)
        self._executor.start(assignment.number, assignment.node, request, models)

    def _stop_waiting(self) -> None:
        """Give what a node does not begin to another."""
        now_s, scheduler = self._clock(), self._scheduler
        for number in [assignment.number for assignment in scheduler.running]:
            if not scheduler.has_begun(number) and now_s - scheduler.begun_s(number) > _BEGIN_S:
                self._executor.stop(number)
                scheduler.refuse(number, _NO_ROOM, now_s)

    def _handle(self, event: Event) -> None:
        match event:
            case Joined(node, machine):
                self._machines[node.id] = machine
                self._scheduler.join(node)
            case LeftOut():
                self._left_out.append(event)
                self._on_left_out(event)
            case Left(node_id, reason):
                self._scheduler.leave(node_id, reason)
            case Reported(number, message):
                self._handle_message(number, message)
            case Died(number, reason):
                self._end(number, Failure(Status.CRASHED, reason))

    def _handle_message(self, number: int, message: Message) -> None:
        if number not in self._collectors:  # it was ended by an earlier message
            return
        match message:
            case Began():
                self._scheduler.begin(number, self._clock())
            case Refused(reason):
                self._scheduler.refuse(number, reason, self._clock())
            case Lines(lines):
                try:
                    self._deliver(number, self._collectors[number].add(lines))
                except InputError as error:
                    self._executor.stop(number)
                    self._end(number, Failure(Status.FAILED, str(error)))
            case Finished():
                self._finished.append(message)
                self._finish(number, message)

    def _finish(self, number: int, finished: Finished) -> None:
        """Take what the end of a command completes, and what it leaves."""
        code = finished.exit_code
        detail = finished.detail or child.describe_exit(code)
        try:
            self._deliver(number, self._collectors[number].end(code))
        except InputError as error:
            detail = str(error)
        if code == ExitCode.USAGE:  # the command line is wrong on every node
            self._deliver(number, self._failed(number, Failure(Status.INPUT, detail)))
        is_killed = code < 0 or code == ExitCode.INTERRUPTED
        self._end(number, Failure(Status.CRASHED if is_killed else Status.FAILED, detail))

    def _end(self, number: int, failure: Failure) -> None:
        """End an assignment; of cells that are given up, how they failed is their result."""
        assignment = self._assignments.get(number)
        if assignment is None:
            return
        is_whole = not self._scheduler.open_cells(number)
        problem = "" if is_whole else failure.detail
        self._collectors.pop(number, None)
        lost = self._scheduler.end(number, problem, self._clock())
        for item in lost:
            self._keep(self._failed_result(assignment, item, failure.status))

    def _failed(self, number: int, failure: Failure) -> list[CellResult]:
        assignment = self._assignments[number]
        machine = self._machines[assignment.node.id]
        cells = self._scheduler.open_cells(number)
        return [results.failed(cell, failure, machine) for cell in cells]

    def _failed_result(self, assignment: Assignment, lost: LostCell, status: Status) -> CellResult:
        machine = self._machines[assignment.node.id]
        return results.failed(lost.cell, Failure(status, lost.detail), machine)

    def _deliver(self, number: int, complete: Sequence[CellResult]) -> None:
        for result in complete:
            if self._scheduler.deliver(number, result.cell):
                self._keep(result)

    def _keep(self, result: CellResult) -> None:
        self._store(result)
        self._outcomes[result.cell] = result.outcome

    def _show_progress(self) -> None:
        count, scheduler = len(self._matrix.cells), self._scheduler
        self._on_progress(Progress(count - scheduler.missing_count, count, scheduler.running))

    def _summary(self, is_interrupted: bool = False) -> Summary:
        scheduler = self._scheduler
        missing = scheduler.missing
        return Summary(
            outcomes=dict(self._outcomes),
            nodes=scheduler.nodes,
            left_out=tuple(self._left_out),
            missing=missing,
            reasons=tuple(scheduler.reasons()) if missing and not is_interrupted else (),
            is_interrupted=is_interrupted,
            finished=tuple(self._finished),
        )
