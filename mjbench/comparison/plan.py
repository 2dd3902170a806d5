"""What a comparison is to do: the variants of paths, and the sizes of the work."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mjbench import paths
from mjbench.limits import TIME_LIMIT_S
from mjbench.paths.base import nthread
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.simulation.workload import Product

# Seconds for each model, agreement included, that paths which run C may take; and with --quick.
BUDGET_S, QUICK_BUDGET_S = 23.0, 5.0


@dataclass(frozen=True)
class Variant:
    """A path with its options set."""

    path: str
    options: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.path} {describe_options(self.options)}".rstrip()


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
