"""The options of `mjbench compare`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    BudgetOptions,
    OutputOptions,
    StartOptions,
    TimeLimitOptions,
    code_option,
    hold_option,
    nbatch_option,
    nstep_option,
    threads_option,
)
from mjbench.options import FLAG, LARGE_COUNT, NAMES, SETTINGS, choice, numbers, option

# Steps of an action with --rl, unless the user says.
RL_HOLD = 5
_FEWER = "fewer where the plain loop would take more than 20 ms"


@dataclass(frozen=True, kw_only=True)
class CompareOptions(BudgetOptions, StartOptions, TimeLimitOptions, OutputOptions):
    """Which ways of stepping are compared, and how."""

    EACH_S, QUICK_S = 23.0, 5.0
    paths: list[str] | None = option(
        None,
        NAMES,
        "Ways of stepping to compare, such as rollout, batch_step, mjx, warp (see `mjbench"
        " paths`), or MODULE:CLASS of your own; python_loop, with and without its timer, is always"
        " added. `c` stands for all C paths, `usual` for those and, where installed, mjx",
        unset="c",
    )
    threads: list[int] | None = threads_option()
    options: list[str] | None = option(
        None,
        SETTINGS,
        "Values of any other option of a path, such as pool=new, or chunk=1,4: simulations that a"
        " thread takes at a time.",
        "--option",
    )
    nbatch: list[int] | None = nbatch_option(f"64; {_FEWER}", numbers())
    returns: str = option(
        "final",
        choice("final", "trajectory", "sensors"),
        "What every path returns: final states; the state after every step, too; and sensor data"
        " of every step, too, which are of the state before it. MJX and Warp return final states"
        " only.",
    )
    nstep: int | None = nstep_option(f"100; {_FEWER}; --hold with --rl")
    hold: int | None = hold_option(None, unset=f"1; {RL_HOLD} with --rl")
    total_steps: int | None = option(
        None,
        LARGE_COUNT,
        "Steps that you will take in all simulations together, such as 1e9: a path that compiles"
        " is advised only if that pays within them",
        unset="--nbatch times --nstep",
    )
    rl: bool = option(
        False,
        FLAG,
        "For RL (closed loop): a policy chooses an action every --hold steps. Only paths that it"
        " can use are compared, and each call takes the steps of one action.",
    )
    scaling: bool = option(
        False,
        FLAG,
        "How many threads? Race many numbers of threads, up to twice as many as can run at once,"
        " and chunks, or those of --threads and --option chunk=. Only rollout and batch_step race"
        " (with --rl, only batch_step), unless --paths names others.",
        of_functions=False,
    )
    code: bool = code_option()
