"""What a comparison is to do: the variants of paths, and how much work a timed block has."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco

from mjbench import paths
from mjbench.host import machine
from mjbench.limits import TIME_LIMIT_S
from mjbench.paths.base import nthread
from mjbench.simulation import compat
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.simulation.workload import Product, whole_holds

# Seconds for each model, agreement included, that paths which run C may take.
BUDGET_S = 23.0

# Sizes unless the user names them. Where a block of the plain loop would take longer than
# LONG_BLOCK_S, they shrink until it takes about BLOCK_S: first the steps, then the simulations, to
# no fewer than the minimum. Where that is still too long, the steps shrink again, to one if need
# be; not where accelerated paths take part, whose single step is mostly the program's start.
NBATCH, NSTEP = 64, 100
MIN_NSTEP, MIN_NBATCH = 10, 8
LONG_BLOCK_S, BLOCK_S = 0.02, 0.015
# Simulations per thread that a reduced batch keeps, so that threads have work to share.
MIN_NBATCH_PER_THREAD = 4


# Options that say who owns the MjData, or the pool of threads.
_OWNERS = ("data", "pool")


@dataclass(frozen=True)
class Variant:
    """A path with its options set."""

    path: str
    options: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.path} {describe_options(self.options)}".rstrip()

    def is_twin_of(self, other: "Variant") -> bool:
        """Return whether two differ at most in who owns the MjData, or the pool of threads."""
        own, others = (
            {name: value for name, value in each.options.items() if name not in _OWNERS}
            for each in (self, other)
        )
        return self.path == other.path and own == others


def describe_options(options: Mapping[str, Any]) -> str:
    """Return options as people write them, such as `threads=2 pool=kept`."""
    return " ".join(f"{name}={value}" for name, value in options.items())


# The plain loop without the timer of MuJoCo's Python package: part of each race, never its winner.
WITHOUT_TIMER = Variant("python_loop", {"clock": "off"})


@dataclass(frozen=True)
class ComparisonPlan:
    """What to compare on each model.

    Attributes:
      nbatch: simulations; None lets each model have as many as its budget allows.
      nstep: steps per simulation; None likewise.
      budget_s: seconds for a model, agreement included, that paths which run C may take.
      must_end: whether paths that compile, too, end within budget_s.
      limit_s: a child process that is silent for longer is killed.
      named: paths that the user asked for by name; they are tried even where that is slow.
      total_steps: steps that the user will take in all, within which compiling must pay; None for
        those of one block.
    """

    variants: tuple[Variant, ...]
    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0
    starts: StartPlan = DEFAULT_STARTS
    returns: Product = Product.FINAL
    budget_s: float = BUDGET_S
    must_end: bool = False
    limit_s: float = TIME_LIMIT_S
    import_from: str | None = None
    named: tuple[str, ...] = ()
    total_steps: int | None = None

    @property
    def accelerated(self) -> list[int]:
        return [i for i, each in enumerate(self.variants) if paths.find(each.path).compiles]

    @property
    def most_threads(self) -> int:
        return max(nthread(variant.options) for variant in self.variants)


@dataclass(frozen=True)
class BlockSizes:
    """The sizes of a workload, which is one block; `nstep` is a multiple of `hold`.

    Attributes:
      reduced: whether they are below the usual ones to keep a block short.
    """

    nbatch: int
    nstep: int
    reduced: bool


def choose_sizes(
    step_s: float,
    *,
    nbatch: int | None = None,
    nstep: int | None = None,
    hold: int = 1,
    nthread: int = 1,
    has_accelerated: bool = False,
) -> BlockSizes:
    """Return the sizes asked for; those that are None are chosen by the seconds of a step."""
    usual = nbatch or NBATCH, nstep or whole_holds(NSTEP, hold)
    chosen_nbatch, chosen_nstep = usual
    if chosen_nbatch * chosen_nstep * step_s <= LONG_BLOCK_S:
        return BlockSizes(chosen_nbatch, chosen_nstep, reduced=False)
    steps = max(1, int(BLOCK_S / step_s))
    if nstep is None:
        least = max(MIN_NSTEP, steps // chosen_nbatch)
        chosen_nstep = min(chosen_nstep, whole_holds(least, hold))
    if nbatch is None and chosen_nbatch * chosen_nstep > steps:
        min_nbatch = min(chosen_nbatch, max(MIN_NBATCH, MIN_NBATCH_PER_THREAD * nthread))
        chosen_nbatch = min(chosen_nbatch, max(min_nbatch, steps // chosen_nstep))
    max_steps = max(1, int(LONG_BLOCK_S / step_s))
    if nstep is None and chosen_nbatch * chosen_nstep > max_steps and not has_accelerated:
        chosen_nstep = min(chosen_nstep, whole_holds(max_steps // chosen_nbatch, hold))
    chosen = chosen_nbatch, chosen_nstep
    return BlockSizes(*chosen, reduced=chosen != usual)


def check_memory(
    model: mujoco.MjModel,
    nbatch: int,
    nstep: int,
    nthread: int = 1,
    returns: Product = Product.FINAL,
) -> None:
    """Refuse sizes whose states, controls, outputs and MjData would not fit into memory."""
    nstate = compat.state_size(model)
    nphysics = compat.state_size(model, compat.FULLPHYSICS)
    # of what is returned of every step: mujoco.rollout's; else also the reference's, those that
    # paths share, those of worker processes, and a copy while two are compared
    copies = 1 if returns == Product.FINAL else 4
    per_step = 2 * model.nu + copies * (nphysics + model.nsensordata)
    # five copies of the start states: the workload's, the paths' inputs, and their outputs
    workload_bytes = 8 * nbatch * (5 * nstate + nstep * per_step)
    bytes_needed = workload_bytes + nthread * machine.data_bytes(model)
    threads = f" on {nthread} threads" if nthread > 1 else ""
    machine.check_memory(
        bytes_needed,
        f"{nbatch} simulations of {nstep} steps{threads}",
        f"reduce --nbatch or --nstep{', or the threads' if threads else ''}",
    )
