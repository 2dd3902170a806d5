"""Plans, cells, run file lines and a cluster without Ray, for tests of sweeps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.instrument import run_file, runs
from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import Record, RunHeader
from mjbench.paired.outcomes import Metric, Verdict
from mjbench.paired.records import TargetRow, VerdictRecord
from mjbench.releases.installs import ReleaseSpec
from mjbench.simulation import models
from mjbench.status import Status
from mjbench.sweep.cells import Cell, Kind
from mjbench.sweep.executor import Died, Event, Joined, Left, Reported
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.messages import Began, Finished, Lines, Refused, Request
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.plan import NodeRules, Part, Plan
from mjbench.sweep.scheduler import Node

MACHINE = Machine(
    cpu="a processor",
    architecture="x86_64",
    system="Linux",
    cores=2,
    usable_cores=2,
    cgroup_quota_cores=None,
    memory_bytes=1 << 30,
    load_1min=0.0,
    governor="",
    hypervisor=False,
    python="3.11.0",
    versions={},
)


def verdict_cell(model: str, release: str = "4.0.0", machine: str = "") -> Cell:
    """Return a cell that compares a release with 3.3.0 by time."""
    return Cell(
        Kind.VERSIONS, model, release, "3.3.0", "", "python_loop", Metric.TIME, machine, "content"
    )


def count_cell(model: str, release: str = "4.0.0") -> Cell:
    """Return a cell that counts instructions."""
    return Cell(Kind.INSTRUCTIONS, model, release, "3.3.0", content="content")


def line(record: Record) -> bytes:
    """Return a record as a run file has it."""
    return run_file.line_of(record).encode()


def header(command: str = "versions") -> bytes:
    """Return the first line of a run file."""
    return line(RunHeader(runs.SCHEMA, command, MACHINE, {}))


def verdict(cell: Cell, status: Status = Status.OK) -> VerdictRecord:
    """Return the record that is the result of a cell."""
    assert cell.metric is not None
    return VerdictRecord(
        model=cell.model,
        path=cell.path,
        old=cell.baseline,
        new=cell.release,
        sides=[TargetRow(r, cell.model, cell.path, {}, {}) for r in (cell.baseline, cell.release)],
        metric=cell.metric,
        status=status,
        detail="" if status == Status.OK else "it failed",
        verdict=Verdict.SAME if status == Status.OK else None,
        seconds=12.0,
    )


def plan(**fields: object) -> Plan:
    """Return a plan of one verdict on the cart-pole."""
    releases = (ReleaseSpec("3.3.0", "3.3.0"), ReleaseSpec("4.0.0", "4.0.0"))
    usual: dict[str, object] = {
        "models": (models.resolve("cartpole"),),
        "releases": releases,
        "pairs": (releases,),
        "paths": ("python_loop",),
        "metrics": (Metric.TIME,),
        "machines": (),
        "parts": (Part(Kind.VERSIONS), Part(Kind.INSTRUCTIONS), Part(Kind.COMPARE)),
        "rules": NodeRules(),
    }
    return Plan(**{**usual, **fields})  # type: ignore[arg-type]


def matrix(cells: Sequence[Cell], **fields: object) -> Matrix:
    """Return a matrix of some cells."""
    return Matrix(plan(**fields), tuple(cells), {})


def node(name: str, host: str = "", label: str = "", cores: int = 2) -> Node:
    """Return a node, on a machine of its own unless it is given a host."""
    return Node(name, name, host or f"host of {name}", label, cores)


@dataclass
class Work:
    """What a node of a fake cluster measures.

    Attributes:
      number: of the assignment.
      node: that measures it.
      request: what it is asked for.
      cells: of the request, in the order in which their lines come.
      has_begun: whether the first line has been sent.
    """

    number: int
    node: Node
    request: Request
    cells: list[Cell]
    has_begun: bool = False


class FakeCluster:
    """An executor whose nodes do what a test tells them, one event at a time.

    Attributes:
      time_s: its clock; every look at events takes a second.
      running: what nodes measure, by the number of the assignment.
      stopped: assignments that were stopped.
    """

    def __init__(self, nodes: Sequence[Node], act: Callable[["FakeCluster"], Sequence[Event]]):
        """Begin with some nodes; `act` says what happens in each look at events."""
        self.nodes = {one.id: one for one in nodes}
        self._act = act
        self.time_s = 0.0
        self.running: dict[int, Work] = {}
        self.stopped: list[int] = []
        self.began: list[Work] = []

    def clock(self) -> float:
        """Return the time in seconds."""
        return self.time_s

    def joined(self) -> list[Event]:
        """Return the events of all nodes that are there."""
        return [Joined(one, MACHINE) for one in self.nodes.values()]

    def cells_of(self, request: Request) -> list[Cell]:
        """Return the cells that a request of `versions` or `instructions` is for."""
        arguments = request.line.arguments
        option = "--new" if arguments[0] == "versions" else "--release"
        releases = [arguments[i + 1] for i, argument in enumerate(arguments) if argument == option]
        make = verdict_cell if arguments[0] == "versions" else count_cell
        return [make(model, release) for model in request.line.operands for release in releases]

    def start(
        self, number: int, node: Node, request: Request, carried: Sequence[CarriedModel]
    ) -> None:
        work = Work(number, node, request, self.cells_of(request))
        assert node.id in self.nodes, "a node that is gone gets no work"
        self.running[number] = work
        self.began.append(work)

    def stop(self, number: int) -> None:
        self.stopped.append(number)
        self.running.pop(number, None)

    def events(self, timeout_s: float) -> Sequence[Event]:
        self.time_s += 1.0
        return self._act(self)

    # -- what can happen -------------------------------------------------------------------------

    def delivers(self, number: int) -> list[Event]:
        """A node measures the next of its cells; the last one ends its command."""
        work = self.running[number]
        events: list[Event] = []
        if not work.has_begun:
            work.has_begun = True
            events += [Reported(number, Began()), Reported(number, Lines((header(),)))]
        if work.cells:
            events.append(Reported(number, Lines((line(verdict(work.cells.pop(0))),))))
        if not work.cells:
            events += self.finishes(number, 0)
        return events

    def finishes(self, number: int, code: int, detail: str = "") -> list[Event]:
        """A command ends."""
        del self.running[number]
        return [Reported(number, Finished(code, detail))]

    def refuses(self, number: int, reason: str = "others keep it busy") -> list[Event]:
        """A node does not measure now."""
        del self.running[number]
        return [Reported(number, Refused(reason))]

    def dies(self, number: int) -> list[Event]:
        """A worker is killed; its node stays."""
        del self.running[number]
        return [Died(number, "its worker was killed")]

    def leaves(self, node_id: str) -> list[Event]:
        """A node is gone, with what it measures."""
        del self.nodes[node_id]
        dead = [number for number, work in self.running.items() if work.node.id == node_id]
        for number in dead:
            del self.running[number]
        return [Left(node_id, "it is gone"), *(Died(n, "its node is gone") for n in dead)]

    def joins(self, one: Node) -> list[Event]:
        """A node appears."""
        self.nodes[one.id] = one
        return [Joined(one, MACHINE)]


def plan_file(folder: Path, text: str) -> Path:
    """Write a plan; return its file."""
    file = folder / "plan.toml"
    file.write_text(text)
    return file
