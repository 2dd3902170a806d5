"""What `instructions` asks of the counted program, and what that answers: pickles in files.

Both sides run the same code under the same Python and NumPy. The program appends an answer after
each task; a program that is killed loses only the answer that it was writing.
"""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mjbench.errors import Failure
from mjbench.simulation.models import ModelSource
from mjbench.simulation.sampling import SampleRequest
from mjbench.simulation.starts import Starts
from mjbench.simulation.work import Work
from mjbench.simulation.work_check import Followed


@dataclass(frozen=True)
class ModelRequest:
    """A model to count, and its workload.

    Attributes:
      workload_file: a pickle of `workload.portable`; the program creates it where it is missing.
    """

    source: ModelSource
    workload_file: Path
    sample: SampleRequest


@dataclass(frozen=True)
class OperationRequest:
    """An operation around the step to count.

    Attributes:
      operation: its name (see `paired.operations`).
      source: of the model that it is done with; None where it builds its own.
    """

    operation: str
    source: ModelSource | None


# What is counted between the markers of one turn.
TaskRequest = ModelRequest | OperationRequest


@dataclass(frozen=True)
class CountRequest:
    """The program's work.

    Attributes:
      tasks: to count, in this order.
    """

    version: str
    tasks: tuple[TaskRequest, ...]


@dataclass(frozen=True, eq=False)
class CountedWork:
    """What was done between two markers.

    Attributes:
      steps: number of steps of one pass.
      warnings: how many of the others raised each warning, by its name.
      healthy: (nbatch,) bool: the simulations that did not diverge.
      followed: what the release did from the states of the workload's probe; None without one.
      starts: where start states came from; None where another process drew them.
    """

    steps: int
    work: Work
    diverged: int
    warnings: Mapping[str, int]
    healthy: np.ndarray
    followed: Followed | None
    starts: Starts | None = None


@dataclass(frozen=True)
class CountedOperation:
    """An operation that was done between two markers."""

    repeats: int


# What became of a task: the work whose instructions Callgrind wrote out, or why there is none.
CountAnswer = CountedWork | CountedOperation | Failure


def write_request(file: Path, request: CountRequest) -> None:
    """Write a request."""
    file.write_bytes(pickle.dumps(request))


def read_request(file: Path) -> CountRequest:
    """Return the request in a file."""
    request: CountRequest = pickle.loads(file.read_bytes())
    return request


def append_answer(stream: BinaryIO, answer: CountAnswer) -> None:
    """Append an answer to an open file, and flush it."""
    pickle.dump(answer, stream)
    stream.flush()


def read_answers(file: Path) -> list[CountAnswer]:
    """Return the complete answers in a file, also while it is being written; [] without a file."""
    answers: list[CountAnswer] = []
    if not file.exists():
        return answers
    with file.open("rb") as stream:
        while True:
            try:
                answers.append(pickle.load(stream))
            except (EOFError, pickle.UnpicklingError):  # the end, or an answer cut short
                return answers
