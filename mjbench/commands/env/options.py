"""The options of `mjbench env`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    TimeLimitOptions,
    threads_option,
)
from mjbench.limits import Bounds
from mjbench.options import FLAG, SEED, THREADS, count, option

# Steps of an environment that are recorded at most: each holds two states and its controls.
MAX_NSTEP = 100_000


@dataclass(frozen=True, kw_only=True)
class EnvironmentOptions(BudgetOptions, TimeLimitOptions, OutputOptions):
    """How an environment is measured."""

    EACH_S, QUICK_S, THING = 24.0, 10.0, "environment"
    nstep: int | None = option(
        None,
        count(Bounds(1, MAX_NSTEP)),
        "Steps of the environment to record and repeat in every round",
        unset="as many as take 0.1 s, from 50 to 1000",
    )
    seed: int = option(
        0, SEED, "Seed of actions and of the first reset; each further episode has the next."
    )
    threads: list[int] | None = threads_option()
    nbatch: list[int] | None = option(
        None,
        THREADS,
        "Numbers of environments in vectorised forms",
        unset="1, 2, 4, … usable cores",
    )
    no_vector: bool = option(False, FLAG, "Leave out vectorised forms.")
