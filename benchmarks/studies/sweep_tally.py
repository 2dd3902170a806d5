"""What `benchmarks.sweep_cost` measures, and stores in results/sweep.json."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.instrument.machine import Machine


@dataclass(frozen=True)
class SweepTimes:
    """Seconds of a sweep on one node.

    Attributes:
      plan_s: until its cells were known.
      start_s: until Ray ran, and the node had said what it is.
      command_s: in which commands ran.
      calibration_s: in which the node looked whether it is quiet, and unpacked what it was sent.
      scheduling_s: from the end of one task to the beginning of the next, in which nothing ran.
      stop_s: until Ray had ended.
      tasks: commands that were run.
    """

    plan_s: float
    start_s: float
    command_s: float
    calibration_s: float
    scheduling_s: float
    stop_s: float
    tasks: int

    @property
    def total_s(self) -> float:
        """Seconds of all of it."""
        ray_s = self.start_s + self.calibration_s + self.scheduling_s + self.stop_s
        return self.plan_s + ray_s + self.command_s


@dataclass(frozen=True)
class TaskCost:
    """What a task costs that does nothing.

    Attributes:
      nodes: of Ray, all on this machine.
      tasks: that were run.
      latency_s: the median from when a node is asked until it has answered, without what ran there.
      tasks_per_s: of all nodes together.
      driver_s: processor time of the process that hands tasks out, a task.
    """

    nodes: int
    tasks: int
    latency_s: float
    tasks_per_s: float
    driver_s: float


@dataclass(frozen=True)
class ChoiceCost:
    """What it costs to choose what is measured next.

    Attributes:
      cells: of the matrix.
      nodes: that ask.
      assignments: that all cells became.
      choice_s: mean seconds of one.
    """

    cells: int
    nodes: int
    assignments: int
    choice_s: float


@dataclass(frozen=True)
class SweepCost:
    """All that was measured.

    Attributes:
      machine: on which.
      models: names.
      releases: versions.
      time_limit_s: of each verdict.
      by_hand_s: seconds of all commands, by round.
      sweeps: the same by a sweep, by round.
      overhead: by which share the sweeps take longer, over all rounds.
      tasks: what tasks cost.
      choice: what choosing costs.
    """

    machine: Machine
    models: Sequence[str]
    releases: Sequence[str]
    time_limit_s: float
    by_hand_s: Sequence[float]
    sweeps: Sequence[SweepTimes]
    overhead: float
    tasks: Sequence[TaskCost]
    choice: ChoiceCost
