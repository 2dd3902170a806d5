"""May a node measure time now? What it has of its cores is measured for about a second.

The load average will not do: after a measurement it is that of the measurement itself. So others'
use of the processor is seen while this process sleeps, and what threads get while all of them work.
"""

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from mjbench.host import conditions, machine, neighbours
from mjbench.host.machine import Calibration, ProcessorTime
from mjbench.host.neighbours import Neighbour

# Seconds of sleep, in which only others are busy, and of work in all threads.
_SLEEP_S, _WORK_S = 0.4, 0.6


@dataclass(frozen=True)
class Limits:
    """What a node must have to measure time; all are shares.

    Attributes:
      min_cores: of the usable cores, which as many threads must get.
      max_busy: of the usable cores, which others may keep busy.
      max_stolen: of the processor time, which the host of a virtual machine may give to others.
    """

    min_cores: float = conditions.ENOUGH_CORES
    max_busy: float = 0.3
    max_stolen: float = 0.1


@dataclass(frozen=True)
class NodeRules:
    """When nodes are given up, and when they may refuse.

    Attributes:
      tries: how often a command is begun at most, where nodes die or commands fail.
      patience_s: seconds after which a busy node gives a command back, and after which a sweep
        ends in which no node measures.
    """

    tries: int = 3
    patience_s: float = 600.0
    limits: Limits = field(default_factory=Limits)


@dataclass(frozen=True)
class NodeState:
    """What a calibration saw.

    Attributes:
      cores_had: that as many threads as usable cores got.
      busy_cores: of the machine, that others kept busy.
      stolen: share of the processor time that the host gave to others.
    """

    cores: int
    usable_cores: int
    cores_had: float
    busy_cores: float
    stolen: float
    neighbours: tuple[Neighbour, ...] = ()


def calibrate(
    sleep: Callable[[float], None] = time.sleep, clock: Callable[[], float] = time.perf_counter
) -> NodeState:
    others = neighbours.measuring_now()
    usable = machine.usable_cores()
    calibration = Calibration(usable)
    before, begin = ProcessorTime.now(), clock()
    sleep(_SLEEP_S)
    busy_s = ProcessorTime.now().busy_s - before.busy_s
    slept_s = clock() - begin
    had = _cores_had(calibration, clock)
    return NodeState(
        cores=max(usable, os.cpu_count() or 1),
        usable_cores=usable,
        cores_had=statistics.median(had),
        busy_cores=busy_s / slept_s if slept_s > 0 else 0.0,
        stolen=ProcessorTime.now().stolen_since(before),
        neighbours=tuple(others),
    )


def _cores_had(calibration: Calibration, clock: Callable[[], float]) -> list[float]:
    had: list[float] = []
    end = clock() + _WORK_S
    while not had or clock() < end:
        times = [clock()]
        for work in (calibration.single, calibration.together):
            work()
            times.append(clock())
        single_s, together_s = times[1] - times[0], times[2] - times[1]
        had.append(calibration.cores(single_s, together_s) if together_s > 0 else 0.0)
    return had


def objection(state: NodeState, limits: Limits) -> str:
    """Return why a node should not measure time now, in one line; empty if it may."""
    if state.neighbours:
        return f"{neighbours.describe(state.neighbours)} measures there"
    # of processor time, which is counted in ticks, there may be slightly more than all
    most_busy = state.cores - (1 - limits.max_busy) * state.usable_cores
    if limits.max_busy < 1 and state.busy_cores > most_busy:
        return (
            f"others keep {state.busy_cores:.1f} of {state.cores} cores busy,"
            f" of which {state.usable_cores} are usable"
        )
    if state.stolen > limits.max_stolen:
        return f"its host takes {100 * state.stolen:.0f} % of its processor time for others"
    if state.cores_had < limits.min_cores * state.usable_cores:
        return f"threads get {state.cores_had:.2f} of {state.usable_cores} usable cores"
    return ""
