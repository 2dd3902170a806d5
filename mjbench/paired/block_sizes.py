"""How much work a block is: what the user asked for, or what takes about a millisecond."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from mjbench.errors import InputError
from mjbench.paired.outcomes import Metric
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.simulation.workload import Product, whole_holds

# Seconds of a block. The shorter it is, the closer in time the two blocks of a pair, and the fewer
# blocks are hit by what else the machine does. The longer it is, the less its cold start counts,
# which both targets share and which makes any change look smaller.
BLOCK_S = 0.001
# Seconds of a segment, which blocks of the plain loop are (see `loop_segments`), and the most
# segments of a run.
SEGMENT_S, MAX_SEGMENTS = 0.0001, 16
# Steps of each simulation of a block, at most.
MAX_NSTEP = 100
# Seconds of a block for each thread of a path with threads: long enough that starting the threads
# is not what is measured.
THREADED_BLOCK_S = 0.01
# Steps of a block whose slowest are compared, at least: five are above the 99th percentile.
MIN_P99_STEPS = 500
# Simulations that are drawn for each one of a block. Every layout does others of them, so that a
# verdict does not rest on the states of one block.
DRAWN_PER_BLOCK = 8


@dataclass(frozen=True)
class Sizes:
    """The work of a block, as the user asked for it.

    Attributes:
      nbatch: simulations; None chooses them from what a step costs.
      nstep: steps of each simulation; None chooses them from what a step costs.
      hold: steps for which each control is held.
      seed: of start states and controls.
      starts: where start states are to come from.
      returns: what a run returns.
      metric: what of a block is compared: its time, or that of its slowest steps.
    """

    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0
    starts: StartPlan = DEFAULT_STARTS
    returns: Product = Product.FINAL
    metric: Metric = Metric.TIME

    def __post_init__(self) -> None:
        """Check that a block has enough steps.

        Raises:
          InputError: it has too few for its slowest.
        """
        if self.metric != Metric.P99 or self.nbatch is None or self.nstep is None:
            return
        if self.nbatch * self.nstep < MIN_P99_STEPS:
            raise InputError(
                f"--metric p99 needs at least {MIN_P99_STEPS} steps in a block: --nbatch times"
                " --nstep"
            )


class BlockSize(NamedTuple):
    """Simulations of a block, and steps of each."""

    nbatch: int
    nstep: int

    def nsegment(self, step_s: float, hold: int) -> int:
        """Return the number of segments of a run of the plain loop.

        Args:
          step_s: seconds of a step of the target that is slower.
          hold: steps per control.
        """
        steps = self.nbatch * self.nstep
        return min(max(1, round(steps * step_s / SEGMENT_S)), steps // hold, MAX_SEGMENTS)


def block_size(
    sizes: Sizes, nthread: int, step_s: float, most_nstep: int | None = None
) -> BlockSize:
    """Return a size such that a block takes about BLOCK_S where the user leaves it open.

    Args:
      sizes: as the user asked.
      nthread: threads of the target that has more.
      step_s: seconds of a step of the target that is slower, as tables have it.
      most_nstep: steps of a simulation at most, unless the user asked for more; None for no bound.

    Raises:
      InputError: the slowest steps are to be compared, and there are too few.
    """
    block_s = BLOCK_S if nthread == 1 else nthread * THREADED_BLOCK_S
    steps, hold = max(1, int(block_s / step_s)), sizes.hold
    if sizes.metric == Metric.P99:
        steps = max(steps, MIN_P99_STEPS)
    longest = steps if most_nstep is None else most_nstep
    if sizes.nbatch:
        nstep = sizes.nstep or whole_holds(min(steps // sizes.nbatch, longest), hold)
        if most_nstep is not None:
            replace(sizes, nstep=nstep)  # refuses too few steps
        return BlockSize(sizes.nbatch, nstep)
    nstep = sizes.nstep or whole_holds(min(steps, MAX_NSTEP, longest), hold)
    return BlockSize(max(1 if nthread == 1 else 4 * nthread, steps // nstep), nstep)
