"""A cluster that runs a sweep, simulated event by event.

The scheduler is that of `mjbench sweep` itself; it gets simulated events at simulated times. Nodes
differ in speed, refuse, and die; one driver handles all events, one after the other. The same seed
gives the same run.
"""

import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.studies.scale_tally import Assumptions, SchedulingCost
from mjbench.sweep.cells import Cell
from mjbench.sweep.scheduler import Assignment, Node, Scheduler

# How often it is looked whether a node that was left alone may be asked again, in seconds.
_LOOK_S = 15.0


@dataclass(frozen=True)
class Work:
    """What cells take on a node of usual speed.

    Attributes:
      start_s: seconds that the command of some cells takes beside them.
      cell_s: seconds of a cell.
      store_s: seconds of the driver for its result.
    """

    start_s: Callable[[Cell], float]
    cell_s: Callable[[Cell], float]
    store_s: Callable[[Cell], float]


@dataclass(frozen=True)
class Course:
    """How a simulated sweep went.

    Attributes:
      delivered: each cell with a result, and when it came.
      given_up: cells whose every try failed.
      end_s: when the last result came.
      work_s: seconds of nodes in commands that ended well, divided by the commands that a node may
        run at once; slower nodes take longer.
      lost_s: seconds of nodes in commands that died, without the cells that they had delivered.
      deaths: of nodes that were measuring.
      refusals: of nodes.
      commands: that were handed out.
      driver_s: seconds for which the driver was busy.
      longest_wait_s: longest time for which a node waited for the driver.
    """

    delivered: Sequence[tuple[Cell, float]]
    given_up: Sequence[Cell]
    end_s: float
    work_s: float
    lost_s: float
    deaths: int
    refusals: int
    commands: int
    driver_s: float
    longest_wait_s: float


@dataclass(frozen=True)
class SimulatedNode:
    """A node, and how many times as long as usual everything takes there."""

    node: Node
    slowness: float = 1.0


def simulate(
    cells: Sequence[Cell],
    nodes: Sequence[SimulatedNode],
    work: Work,
    scheduling: SchedulingCost,
    assumptions: Assumptions,
    seed: int = 0,
) -> Course:
    """Return how a sweep goes on a cluster.

    Args:
      cells: each once.
      nodes: that are there at the beginning; one that dies comes back.
      work: what cells take.
      scheduling: what handing them out takes.
      assumptions: how nodes die and refuse.
      seed: of what is drawn.
    """
    return _Simulation(cells, nodes, work, scheduling, assumptions, seed).run()


@dataclass(frozen=True)
class _Began:
    number: int


@dataclass(frozen=True)
class _Delivered:
    number: int
    cell: Cell


@dataclass(frozen=True)
class _Ended:
    number: int


@dataclass(frozen=True)
class _Refused:
    number: int


@dataclass(frozen=True)
class _Died:
    number: int


@dataclass(frozen=True)
class _Left:
    node_id: str


@dataclass(frozen=True)
class _Joined:
    node_id: str


@dataclass(frozen=True)
class _Look:
    """Nothing happened, but a node may have rested long enough."""


_Event = _Began | _Delivered | _Ended | _Refused | _Died | _Left | _Joined | _Look


@dataclass
class _NodeState:
    """What becomes of a node: when it dies next, and which commands it runs."""

    node: SimulatedNode
    death_s: float
    running: set[int] = field(default_factory=set)
    is_there: bool = True


@dataclass(frozen=True)
class _Command:
    """A command that a node runs.

    Attributes:
      assignment: of the scheduler.
      state: of its node.
      begin_s: when it began.
      ends_s: when each cell is to end.
      death_s: when its node dies next.
    """

    assignment: Assignment
    state: _NodeState
    begin_s: float
    ends_s: tuple[float, ...]
    death_s: float

    @property
    def share(self) -> float:
        """Of the node: commands that need no quiet machine run beside others."""
        return 1.0 if self.assignment.command.needs_quiet else 1 / self.assignment.node.cores

    @property
    def lost_s(self) -> float:
        """Seconds that are lost where the node dies: those since the last cell that ended."""
        ended = [end for end in self.ends_s if end <= self.death_s]
        return max(0.0, self.death_s - max([self.begin_s, *ended]))


class _Simulation:
    """The events that are to come, and what has been counted so far."""

    def __init__(
        self,
        cells: Sequence[Cell],
        nodes: Sequence[SimulatedNode],
        work: Work,
        scheduling: SchedulingCost,
        assumptions: Assumptions,
        seed: int,
    ):
        self._work, self._scheduling, self._assumptions = work, scheduling, assumptions
        self._rng = np.random.default_rng(seed)
        self._scheduler = Scheduler(cells, patience_s=math.inf)
        self._events: list[tuple[float, int, _Event]] = []
        self._order = itertools.count()
        self._commands: dict[int, _Command] = {}
        self._nodes = {each.node.id: _NodeState(each, math.inf) for each in nodes}
        self._driver_free_s = self._driver_s = self._longest_wait_s = 0.0
        self._delivered: list[tuple[Cell, float]] = []
        self._given_up: list[Cell] = []
        self._work_s = self._lost_s = 0.0
        self._count = self._deaths = self._refusals = 0
        self._is_looking = False

    def run(self) -> Course:
        """Handle all events, until no cell is missing."""
        for node_id in self._nodes:
            self._join(node_id, 0.0)
        self._hand_out(0.0)
        while self._events and not self._scheduler.is_done:
            happened_s, _, event = heapq.heappop(self._events)
            now_s = max(happened_s, self._driver_free_s)
            self._longest_wait_s = max(self._longest_wait_s, now_s - happened_s)
            if isinstance(event, _Delivered):
                self._occupy_driver(now_s, self._work.store_s(event.cell))
            if self._handle(event, now_s):
                self._hand_out(now_s)
        return Course(
            delivered=self._delivered,
            given_up=self._given_up,
            end_s=max((time_s for _, time_s in self._delivered), default=0.0),
            work_s=self._work_s,
            lost_s=self._lost_s,
            deaths=self._deaths,
            refusals=self._refusals,
            commands=self._count,
            driver_s=self._driver_s,
            longest_wait_s=self._longest_wait_s,
        )

    def _after(self, time_s: float, event: _Event) -> None:
        heapq.heappush(self._events, (time_s, next(self._order), event))

    def _occupy_driver(self, now_s: float, seconds: float) -> None:
        self._driver_free_s = max(now_s, self._driver_free_s) + seconds
        self._driver_s += seconds

    def _handle(self, event: _Event, now_s: float) -> bool:
        """Tell the scheduler what happened; return whether there may be something to hand out."""
        match event:
            case _Began(number):
                self._scheduler.begin(number, now_s)
                return False
            case _Delivered(number, cell):
                if self._scheduler.deliver(number, cell):
                    self._delivered.append((cell, now_s))
                return False
            case _Ended(number) | _Died(number):
                self._end(number, now_s, "" if isinstance(event, _Ended) else "it died")
            case _Refused(number):
                self._pop(number)
                self._refusals += 1
                self._scheduler.refuse(number, "it is busy", now_s)
            case _Left(node_id):
                self._nodes[node_id].is_there = False
                self._scheduler.leave(node_id, "it died")
            case _Joined(node_id):
                self._join(node_id, now_s)
            case _Look():
                self._is_looking = False
        return True

    def _join(self, node_id: str, now_s: float) -> None:
        """Have a node come, and draw when it dies."""
        state, assumed = self._nodes[node_id], self._assumptions
        state.is_there = True
        self._scheduler.join(state.node.node)
        state.death_s = math.inf
        if assumed.hours_between_deaths < math.inf:
            state.death_s = now_s + 3600 * self._rng.exponential(assumed.hours_between_deaths)
            self._after(state.death_s + assumed.detection_s, _Left(node_id))
            back_s = max(assumed.outage_s, assumed.detection_s)
            self._after(state.death_s + back_s, _Joined(node_id))

    def _pop(self, number: int) -> _Command:
        command = self._commands.pop(number)
        command.state.running.discard(number)
        return command

    def _end(self, number: int, now_s: float, problem: str) -> None:
        command = self._pop(number)
        self._given_up += [item.cell for item in self._scheduler.end(number, problem, now_s)]
        if problem:
            self._deaths += 1
            self._lost_s += command.lost_s * command.share
            self._work_s += command.share * max(
                0.0, min(command.death_s, command.ends_s[-1]) - command.begin_s - command.lost_s
            )
        else:
            self._work_s += (command.ends_s[-1] - command.begin_s) * command.share

    def _hand_out(self, now_s: float) -> None:
        """Have the scheduler assign what it can, and begin that."""
        for assignment in self._scheduler.assign(now_s):
            self._count += 1
            self._occupy_driver(now_s, self._scheduling.command_s)
            self._longest_wait_s = max(self._longest_wait_s, self._driver_free_s - now_s)
            self._begin(assignment)
        if not self._is_looking and any(
            state.is_there and not state.running for state in self._nodes.values()
        ):
            self._is_looking = True
            self._after(now_s + _LOOK_S, _Look())

    def _begin(self, assignment: Assignment) -> None:
        """Have a node run a command, as far as it gets."""
        number, state = assignment.number, self._nodes[assignment.node.id]
        begin_s = self._driver_free_s + self._scheduling.handover_s
        is_quiet = assignment.command.needs_quiet
        if is_quiet:
            begin_s += self._scheduling.calibration_s
        end_s = begin_s + self._work.start_s(assignment.cells[0]) * state.node.slowness
        ends_s = []
        for cell in assignment.cells:
            end_s += self._work.cell_s(cell) * state.node.slowness
            ends_s.append(end_s)
        command = _Command(assignment, state, begin_s, tuple(ends_s), state.death_s)
        self._commands[number] = command
        state.running.add(number)
        is_refused = is_quiet and self._rng.random() < self._assumptions.refusals
        if is_refused and begin_s < state.death_s:
            self._after(begin_s, _Refused(number))
            return
        if begin_s < state.death_s:
            self._after(begin_s, _Began(number))
        for cell, cell_end_s in zip(assignment.cells, ends_s, strict=True):
            if cell_end_s < state.death_s:
                self._after(cell_end_s, _Delivered(number, cell))
        if end_s < state.death_s:
            self._after(end_s, _Ended(number))
        else:
            detected_s = state.death_s + self._assumptions.detection_s
            self._after(max(begin_s, detected_s), _Died(number))
