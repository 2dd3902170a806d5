"""What a sweep needs of a cluster, whichever it is: nodes, and a way to have them measure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from mjbench.instrument.machine import Machine
from mjbench.sweep.messages import Message, Request
from mjbench.sweep.model_files import CarriedModel
from mjbench.sweep.scheduler import Node


@dataclass(frozen=True)
class Joined:
    """A node can be given work."""

    node: Node
    machine: Machine


@dataclass(frozen=True)
class LeftOut:
    """A node cannot be given work."""

    name: str
    reason: str


@dataclass(frozen=True)
class Left:
    """A node is gone; what it measured has died."""

    node_id: str
    reason: str


@dataclass(frozen=True)
class Reported:
    """A node says something of an assignment."""

    number: int
    message: Message


@dataclass(frozen=True)
class Died:
    """What measured an assignment is gone, and says nothing more."""

    number: int
    reason: str


Event = Joined | LeftOut | Left | Reported | Died


class Executor(Protocol):
    """Has nodes measure."""

    def start(
        self, number: int, node: Node, request: Request, carried: Sequence[CarriedModel]
    ) -> None:
        """Have a node measure; what comes of it are events with the number of the assignment."""

    def stop(self, number: int) -> None:
        """Have a node stop measuring; there are no further events of the assignment."""

    def events(self, timeout_s: float) -> Sequence[Event]:
        """Return what happened since the last call; wait so long for something to happen."""
