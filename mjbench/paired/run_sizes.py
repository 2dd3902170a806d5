"""How much work a run is: what the user asked for, or what takes about a millisecond."""

from dataclasses import dataclass
from typing import NamedTuple

from mjbench.paired.metrics import Metric
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.simulation.workload import Product, whole_holds

# Seconds of a run. Where it is not divided into sections, a block is a whole run. In a short block,
# the two blocks of a pair are close in time, and what else the machine does hits few of them. In a
# long block, the cold start matters less; it is the same in both targets and makes any change look
# smaller.
RUN_S = 0.001
# Seconds of a section (see `loop_sections`), and the most sections of a run. A longer run is not
# divided: a quad of each of its sections would take longer than a layout of memory.
SECTION_S, MAX_SECTIONS = 0.0001, 50
# Steps of each simulation of a run, at most.
MAX_NSTEP = 100
# Seconds of a run for each thread of a path with threads: long enough that starting the threads
# is not what is measured.
THREADED_RUN_S = 0.01


@dataclass(frozen=True)
class Sizes:
    """The work of a run, as the user asked for it.

    Attributes:
      nbatch: simulations; None chooses them from what a step costs.
      perturbs: whether velocities of start states are perturbed (see `SampleRequest`).
    """

    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0
    starts: StartPlan = DEFAULT_STARTS
    returns: Product = Product.FINAL
    metric: Metric = Metric.TIME
    perturbs: bool = False


class RunSize(NamedTuple):
    """Simulations of a run, and steps of each."""

    nbatch: int
    nstep: int

    def nsection(self, step_s: float | None, hold: int) -> int:
        """Return the number of sections of a run of the plain loop; 1 if it is not to be divided.

        Args:
          step_s: seconds of a step of the target that is faster; None where no run is divided.
        """
        if step_s is None:
            return 1
        steps = self.nbatch * self.nstep
        count = round(steps * step_s / SECTION_S)
        return min(max(1, count), steps // hold) if count <= MAX_SECTIONS else 1


def run_size(sizes: Sizes, nthread: int, step_s: float, most_nstep: int | None = None) -> RunSize:
    """Return a size such that a run takes about RUN_S where the user leaves it open.

    Args:
      step_s: seconds of a step of the target that is slower, as tables have it.
      most_nstep: steps of a simulation at most, unless the user asked for more; None for no bound.
    """
    run_s = RUN_S if nthread == 1 else nthread * THREADED_RUN_S
    steps, hold = max(1, int(run_s / step_s)), sizes.hold
    longest = steps if most_nstep is None else most_nstep
    if sizes.nbatch:
        nstep = sizes.nstep or whole_holds(min(steps // sizes.nbatch, longest), hold)
        return RunSize(sizes.nbatch, nstep)
    nstep = sizes.nstep or whole_holds(min(steps, MAX_NSTEP, longest), hold)
    return RunSize(max(1 if nthread == 1 else 4 * nthread, steps // nstep), nstep)
