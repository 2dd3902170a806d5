"""What goes to and from a node: frozen values, so that the nodes can be anything."""

from dataclasses import dataclass

from mjbench.instrument.machine import Machine
from mjbench.sweep.calibration import Limits
from mjbench.sweep.commands import CommandLine
from mjbench.sweep.software import Software


@dataclass(frozen=True)
class NodeAnswer:
    """What a node says of itself when it is first asked."""

    software: Software
    machine: Machine


@dataclass(frozen=True)
class Request:
    """What a node is to measure.

    Attributes:
      line: the command line, without where results go.
      limits: what the node must have to measure; None where it need not be quiet.
      label: of the machine, for its results; empty to leave what the node's environment says.
      program: what runs the command line; empty for this version of mjbench.
    """

    line: CommandLine
    limits: Limits | None = None
    label: str = ""
    program: tuple[str, ...] = ()


@dataclass(frozen=True)
class Began:
    """From the node: the calibration, if any, was good, and the command has been started."""


@dataclass(frozen=True)
class Lines:
    """From the node: further lines of the run file, each with its line break; the header first."""

    lines: tuple[bytes, ...]


@dataclass(frozen=True)
class Refused:
    """From the node, as the last message: it does not measure now."""

    reason: str


@dataclass(frozen=True)
class Finished:
    """From the node, as the last message: the command has ended.

    Attributes:
      exit_code: of the command, or minus the signal that killed it.
      detail: the last line that it wrote to standard error; empty if it wrote none.
      wall_s: seconds from when the node was asked until now, those of the calibration included.
      command_s: of them, seconds of the command.
    """

    exit_code: int
    detail: str = ""
    wall_s: float = 0.0
    command_s: float = 0.0


Message = Began | Lines | Refused | Finished
