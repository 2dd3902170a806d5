"""`mjbench.latency`: how long ticks of a controller take, and which are late."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.latency import measure
from mjbench.commands.latency.measure import LatencyRow, Pace
from mjbench.commands.latency.options import LatencyOptions

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model


@dataclass(frozen=True, repr=False, eq=False)
class Latency(Result):
    """How long ticks take, free-running and paced."""

    @property
    def paces(self) -> tuple[LatencyRow, ...]:
        """A row for each pace."""
        return tuple(self.run.of_type(LatencyRow))

    @property
    def free_running(self) -> LatencyRow:
        """Ticks that begin when the one before has ended."""
        return next(row for row in self.paces if row.pace == Pace.FREE)

    @property
    def paced(self) -> LatencyRow:
        """Ticks that are due at a fixed rate."""
        return next(row for row in self.paces if row.pace == Pace.PACED)


@with_options(LatencyOptions)
def latency(model: "Model", *, options: LatencyOptions) -> Latency:
    """Return how long ticks take, which miss their deadline, and what slow ones share.

    The same as `mjbench latency`. They run in a child process.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.

    Raises:
      InputError: there is no such model, it cannot be loaded, or an argument is out of its range.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    with model_sources.sources([model]) as sources:
        return Latency.of(measure.measurement(sources, options), options.wait)
