"""What a worker answers (see `worker`), and the bytes by which it times blocks.

A call is pickled over the worker's socket and answered by `Done` or by a `Failure`; calls are
answered in the order they were sent. A timed block is no call: after `Worker.time_blocks` it is one
byte there and eight bytes back, so that the time between two blocks stays short.

This module is imported inside any release, before MuJoCo and NumPy are: it needs the standard
library alone.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from mjbench.releases.placement import Placement

if TYPE_CHECKING:
    import numpy as np

    from mjbench.simulation.reference_run import Work
    from mjbench.simulation.starts import Starts
    from mjbench.simulation.state_drift import Followed
    from mjbench.simulation.workload import PortableWorkload

Answer = TypeVar("Answer")

# The bytes that ask for one more block, and for no more; a block answers with its nanoseconds.
BLOCK, END = b"b", b"e"
NANOSECONDS = struct.Struct("<q")


@dataclass(frozen=True)
class Done(Generic[Answer]):
    """The answer of a task that did not fail."""

    value: Answer


@dataclass(frozen=True)
class Move:
    """How to move the libraries of a release; `others` is the folder of what lies beside it."""

    movable_file: Path
    others: Path
    folder: Path
    placement: Placement


@dataclass(frozen=True)
class StepCost:
    """What a step costs.

    Attributes:
      settling_nstep: steps of the run along which starts are to be sampled, if nothing bounds it.
      most_nstep: steps of a simulation that the user's files have controls for; None for any
        number.
    """

    digest: str
    step_s: float
    settling_nstep: int
    most_nstep: int | None
    has_sleep: bool


@dataclass(frozen=True, eq=False)
class ReadyOperation:
    """An operation that is ready to be timed: nanoseconds of a warm block, and what it computed."""

    ns: int
    result: "np.ndarray"


@dataclass(frozen=True, eq=False)
class DrawnWorkload:
    """A workload that was drawn, with states along it (see `state_drift.probe`)."""

    workload: "PortableWorkload"
    starts: "Starts"


@dataclass(frozen=True, eq=False)
class Observed:
    """What a target did with a workload, stepped the plain way.

    Attributes:
      healthy: (nbatch,) whether a simulation did not diverge.
      diagnosis: why others diverged, such as `BADQACC in 3`; empty without any.
      final_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION after the last step.
      can_divide: whether its healthy simulations can be divided into the sections asked for.
    """

    work: "Work"
    healthy: "np.ndarray"
    diagnosis: str
    warnings: Mapping[str, int]
    final_state: "np.ndarray"
    followed: "Followed"
    can_divide: bool
    timestep_s: float
