"""What disturbs a measurement from outside: other mjbench, the host, and changes of cores."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.bounds import NonNegativeFloat
from mjbench.host import machine, neighbours
from mjbench.host.machine import CoreChange, ProcessorTime
from mjbench.host.neighbours import Neighbour

# The share of processor time that the host of a virtual machine must take before it counts.
NOTABLE_STOLEN = 0.02


@dataclass(frozen=True)
class Disturbance:
    """What disturbed a run or a race; a run's is its last record, where anything did.

    Attributes:
      commands: of other mjbench that measured on this machine meanwhile.
      stolen_share: of the processor time, which the host gave to others; None where unknown.
      core_change: of the cores that can be used, since the beginning; None without one.
    """

    record_type: ClassVar[str] = "disturbance"
    commands: Sequence[str] = ()
    stolen_share: NonNegativeFloat | None = None
    core_change: CoreChange | None = None

    @property
    def clauses(self) -> list[str]:
        clauses = []
        if (share := self.stolen_share or 0.0) >= NOTABLE_STOLEN:
            clauses.append(f"the host took {100 * share:.0f} % of the processor time for others")
        if self.commands:
            names = ", ".join(f"mjbench {name}" for name in self.commands)
            clauses.append(f"{names} measured on this machine at the same time")
        if self.core_change is not None:
            clauses.append(str(self.core_change))
        return clauses


def sentence(clauses: Sequence[str]) -> str:
    """Return what disturbed a measurement, and what to do; empty where nothing did."""
    return f"Disturbed: {'; '.join(clauses)}. Measure again." if clauses else ""


class Watch:
    """Notices what disturbs a measurement, from its creation on."""

    def __init__(self, others: Iterable[Neighbour] = ()):
        """Begin to watch; `others` measure already."""
        self._commands = {each.command for each in others}
        self._begin, self._cores = ProcessorTime.now(), machine.allowed_cores()
        self._core_change: CoreChange | None = None

    def look(self) -> Disturbance:
        """Return what has disturbed the measurement until now."""
        self._commands.update(each.command for each in neighbours.measuring_now())
        self._core_change = self._core_change or CoreChange.since(self._cores)
        stolen_share = ProcessorTime.now().stolen_since(self._begin)
        return Disturbance(sorted(self._commands), stolen_share, self._core_change)
