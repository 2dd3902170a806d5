"""The options of `mjbench env`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    SeedOptions,
    TimeLimitOptions,
    nbatch_option,
    nstep_option,
    threads_option,
)
from mjbench.limits import Bounds
from mjbench.options import THREADS, count, names_among, option

# Steps of an environment that are recorded at most: each holds two states and its controls.
MAX_NSTEP = 100_000


@dataclass(frozen=True, kw_only=True)
class EnvironmentOptions(BudgetOptions, SeedOptions, TimeLimitOptions, OutputOptions):
    """How an environment is measured."""

    EACH_S, QUICK_S, THING = 24.0, 10.0, "environment"
    nstep: int | None = nstep_option(
        "as many as take 0.1 s, from 50 to 1000", count(Bounds(1, MAX_NSTEP))
    )
    threads: list[int] | None = threads_option(" of the physics alone, by rollout and Batch")
    nbatch: list[int] | None = nbatch_option(
        "1, 2, 4, … up to the usable cores", THREADS, ": environments in each vector environment"
    )
    skip: list[str] | None = option(
        None,
        names_among(["vectors"]),
        "Leave out these parts: vectors, SyncVectorEnv and AsyncVectorEnv.",
    )
