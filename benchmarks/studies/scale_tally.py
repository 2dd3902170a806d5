"""What the simulation of a cluster starts from, and what comes of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from benchmarks.studies import tally_file
from benchmarks.studies.sweep_tally import SweepCost, TaskCost


class CellKind(StrEnum):
    """What a cell of the matrix is; the values are for people."""

    VERDICT = "verdict by time"
    COUNT = "count of instructions"
    COMPARISON = "comparison of paths"


@dataclass(frozen=True)
class CellCost:
    """What a cell takes on a model, measured on one machine.

    Attributes:
      kind: of the cell.
      model: its name.
      step_us: microseconds of a step in the plain loop.
      start_s: seconds that its command takes beside its cells, however many they are.
      cell_s: seconds of a cell.
      cell_bytes: of the run file.
      store_s: seconds in which the process that runs a sweep reads and stores its result.
    """

    kind: CellKind
    model: str
    step_us: float
    start_s: float
    cell_s: float
    cell_bytes: int
    store_s: float


@dataclass(frozen=True)
class CellTally:
    """What cells take, by `benchmarks.cell_cost`.

    Attributes:
      date: of the measurement.
      processor: of the machine.
      usable_cores: of the machine.
      old: release of the verdicts' baseline; counts are of both releases.
      new: release of their candidate.
      install_bytes: of an installed release, the mean of these two.
      cells: one of each kind for each model.
    """

    date: str
    processor: str
    usable_cores: int
    old: str
    new: str
    install_bytes: int
    cells: Sequence[CellCost]


@dataclass(frozen=True)
class SchedulingCost:
    """What handing out commands takes, measured on local Ray nodes.

    Attributes:
      handover_s: seconds from when the driver hands out a command until it starts on its node.
      calibration_s: further seconds where the node must be quiet, for its calibration.
      command_s: seconds of the driver for each command, from choosing its cells to its end, without
        its results.
      tasks: what the first and the last are taken from, on each number of nodes.
    """

    handover_s: float
    calibration_s: float
    command_s: float
    tasks: Sequence[TaskCost] = ()


@dataclass(frozen=True)
class Assumptions:
    """What nobody measured: how nodes differ, refuse and die.

    Attributes:
      slowness_deviation: standard deviation of the logarithm of the time that nodes take.
      refusals: share of commands that need a quiet machine which a node refuses.
      hours_between_deaths: of one node, in the mean; exponentially distributed.
      detection_s: until the driver knows of a death.
      outage_s: until a node that died is there again.
    """

    slowness_deviation: float = 0.1
    refusals: float = 0.02
    hours_between_deaths: float = 100.0
    detection_s: float = 30.0
    outage_s: float = 900.0


@dataclass(frozen=True)
class MatrixSize:
    """How large the full matrix is.

    Attributes:
      models: how many.
      releases: how many; each but the newest is compared with it, and all are counted.
      processors: how many kinds, each of which measures everything.
    """

    models: int = 331
    releases: int = 42
    processors: int = 4

    def cells(self, kind: CellKind) -> int:
        """Return how many cells of a kind one processor has."""
        match kind:
            case CellKind.VERDICT:
                return self.models * (self.releases - 1)
            case CellKind.COUNT:
                return self.models * self.releases
            case CellKind.COMPARISON:
                return self.models


@dataclass(frozen=True)
class KindCost:
    """What all cells of a kind take on one node of each processor, with nothing lost.

    Attributes:
      kind: of the cells.
      cells: of all processors.
      node_hours: seconds of their commands, on all processors.
      result_bytes: of all processors.
    """

    kind: CellKind
    cells: int
    node_hours: float
    result_bytes: float


@dataclass(frozen=True)
class ClusterRow:
    """A simulated sweep of the matrix on one cluster.

    Attributes:
      nodes: as many of each processor.
      processors: kinds of processors; the matrix has a part for each.
      cells: of these parts.
      hours: until the last result.
      night_cells: results of the first eight hours.
      node_hours: of commands that ended well, slow nodes included.
      lost_hours: of nodes, in commands that died.
      deaths: commands that died with their node.
      refusals: by nodes.
      given_up: cells without a result.
      commands: that were handed out.
      driver_share: of the time, for which the driver is busy.
      longest_wait_s: for the driver.
    """

    nodes: int
    processors: int
    cells: int
    hours: float
    night_cells: int
    node_hours: float
    lost_hours: float
    deaths: int
    refusals: int
    given_up: int
    commands: int
    driver_share: float
    longest_wait_s: float

    @property
    def efficiency(self) -> float:
        """Share of all nodes' time in commands that ended well."""
        return self.node_hours / (self.nodes * self.hours)

    @property
    def nodes_of_a_busy_driver(self) -> float:
        """With how many nodes one driver would be busy all the time."""
        return self.nodes / self.driver_share


@dataclass(frozen=True)
class ScaleTally:
    """What the simulation started from, and what came of it.

    Attributes:
      size: of the matrix.
      scheduling: what was measured on local Ray nodes.
      assumptions: what was not measured.
      seed: of what was drawn.
      kinds: what the cells take.
      rows: of clusters.
    """

    size: MatrixSize
    scheduling: SchedulingCost
    assumptions: Assumptions
    seed: int
    kinds: Sequence[KindCost]
    rows: Sequence[ClusterRow]


def load_scale(file: Path) -> ScaleTally:
    """Return the tally of simulated clusters.

    Raises:
      InputError: the file is not one.
    """
    return tally_file.load(file, ScaleTally, "simulated clusters")


def load_cells(file: Path) -> CellTally:
    """Return the tally of what cells take.

    Raises:
      InputError: the file is not one.
    """
    return tally_file.load(file, CellTally, "what cells take")


def load_scheduling(file: Path) -> SchedulingCost:
    """Return what handing out commands takes, as `benchmarks.sweep_cost` measured it.

    Tasks on the most local nodes stand for all: there, the driver has most to do.

    Raises:
      InputError: the file does not say.
    """
    cost = tally_file.load(file, SweepCost, "what a sweep costs")
    tasks = max(cost.tasks, key=lambda task: task.nodes)
    calibration_s = sum(times.calibration_s for times in cost.sweeps)
    return SchedulingCost(
        handover_s=tasks.latency_s,
        calibration_s=calibration_s / sum(times.tasks for times in cost.sweeps),
        command_s=tasks.driver_s + cost.choice.choice_s,
        tasks=cost.tasks,
    )
