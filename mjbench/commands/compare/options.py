"""The options of `mjbench compare`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    TimeLimitOptions,
    WorkOptions,
    code_option,
    threads_option,
)
from mjbench.options import (
    COUNT,
    FLAG,
    LARGE_COUNT,
    NAMES,
    SETTINGS,
    choice,
    numbers,
    option,
)


@dataclass(frozen=True, kw_only=True)
class CompareOptions(BudgetOptions, WorkOptions, TimeLimitOptions, OutputOptions):
    """Which ways of stepping are compared, and how."""

    EACH_S, QUICK_S = 23.0, 5.0
    paths: list[str] | None = option(
        None,
        NAMES,
        "Compare these (see `mjbench paths`), or MODULE:CLASS of your own, and python_loop, which"
        " is always added; `c` stands for all C paths, `usual` for those and, where installed, MJX",
        unset="c",
    )
    threads: list[int] | None = threads_option()
    chunk: list[int] | None = option(None, numbers(), "Simulations that a thread takes at a time.")
    options: list[str] | None = option(
        None,
        SETTINGS,
        "Values of any other option of a path, such as pool=new or checks=off.",
        "--option",
    )
    nbatch: list[int] | None = option(
        None,
        numbers(),
        "Simulations; several values are measured one after the other",
        unset="up to 64",
    )
    returns: str = option(
        "final",
        choice("final", "trajectory", "sensors"),
        "What every path returns: final states; the state after every step, too; and sensor data"
        " of every step, too, which are of the state before it.",
    )
    nstep: int | None = option(None, COUNT, "Steps of each simulation", unset="up to 100")
    total_steps: int | None = option(
        None,
        LARGE_COUNT,
        "Steps that you will take in all simulations together, such as 1e9: a path that compiles"
        " is advised only if that pays within them",
        unset="those of one block",
    )
    scaling: bool = option(
        False,
        FLAG,
        "How many threads? Race many numbers of threads, up to twice as many as can run at once,"
        " and chunk sizes, or those of --threads and --chunk. Only rollout and batch_step race,"
        " unless --paths names others.",
        of_functions=False,
    )
    code: bool = code_option()
