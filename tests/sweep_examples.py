"""Plans, cells, run file lines and a cluster without Ray, for tests of sweeps."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from mjbench.host.machine import Machine
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import TargetRow, VerdictRecord
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation import models
from mjbench.status import Status
from mjbench.store import run_writer, runs
from mjbench.store.runs import Record, RunHeader
from mjbench.sweep.busy_node import NodeRules
from mjbench.sweep.cells import Cell, CellKind
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.node import NodeMeasurement, Request
from mjbench.sweep.plan import Plan
from mjbench.sweep.ray_cluster import ClusterNode, Event, LeftOut
from mjbench.sweep.results import Collector

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
        CellKind.VERSIONS,
        model,
        release,
        "3.3.0",
        "",
        "python_loop",
        Metric.TIME,
        machine,
        "content",
    )


def count_cell(model: str, release: str = "4.0.0") -> Cell:
    """Return a cell that counts instructions."""
    return Cell(CellKind.INSTRUCTIONS, model, release, "3.3.0", content="content")


def line(record: Record) -> bytes:
    """Return a record as a run file has it."""
    return run_writer.line_of(record).encode()


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
        "options": {CellKind.VERSIONS: (), CellKind.INSTRUCTIONS: (), CellKind.COMPARE: ()},
        "rules": NodeRules(),
    }
    return Plan(**{**usual, **fields})  # type: ignore[arg-type]


def matrix(cells: Sequence[Cell], **fields: object) -> Matrix:
    """Return a matrix of some cells."""
    return Matrix(plan(**fields), tuple(cells), {})


def node(name: str, label: str = "") -> ClusterNode:
    """Return a node that can measure."""
    return ClusterNode(name, name, label, MACHINE)


def delivered(cell: Cell, on: str = "one", objection: str = "") -> NodeMeasurement:
    """Return that a node has measured a cell; with an objection, it was busy for 15 s before."""
    collector = Collector([cell])
    (result,) = collector.add([header(), line(verdict(cell))])
    return NodeMeasurement(on, "", result, 12.0, 15.0 if objection else 0.0, objection)


class FakeCluster:
    """A cluster on which what a test says happens to each request.

    Attributes:
      requests: that were submitted.
    """

    def __init__(
        self,
        nodes: Sequence[ClusterNode],
        act: Callable[[Request], Iterable[Event]] = lambda request: map(delivered, request.cells),
        left_out: Sequence[LeftOut] = (),
    ):
        """Take nodes; `act` says what happens to a request, nothing if there is no node for it."""
        self.nodes, self.left_out = tuple(nodes), tuple(left_out)
        self._act = act
        self.requests: list[Request] = []

    def submit(self, request: Request, carried: Sequence[CarriedModel] = ()) -> None:
        self.requests.append(request)

    def events(self, patience_s: float) -> Iterator[Event]:
        for request in self.requests:
            yield from self._act(request)


def plan_file(folder: Path, text: str) -> Path:
    """Write a plan; return its file."""
    file = folder / "plan.toml"
    file.write_text(text)
    return file
