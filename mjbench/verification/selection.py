"""Which paths are compared, with which options and sizes: those named, and of the usual ones."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from mjbench import paths
from mjbench.errors import InputError, describe
from mjbench.host import machine, topology
from mjbench.paths.accelerated import reference_peaks
from mjbench.paths.base import WORKER_OPTIONS
from mjbench.simulation import reference_run
from mjbench.simulation.workload import Workload
from mjbench.verification.plan import WITHOUT_TIMER, ComparisonPlan, Variant

# Names that stand for several paths.
C_PATHS, USUAL_PATHS = "c", "usual"
# What `--scaling` tries: paths for open and for closed loop, and simulations that a thread takes at
# a time.
SCALING_PATHS, SCALING_CHUNKS = ("rollout", "batch_step"), "chunk=1,4,16"
# On a CPU, MJX is slow on a model that makes contact (docs/method/accelerated.md gives figures),
# and takes minutes to compile RK4, which has four of everything: not tried unless named.
_CONTACT_REASON = "makes contact, where it is slow on a CPU; name it with --paths to try it"
_RK4_REASON = "is integrated by RK4, which compiles for minutes; name it with --paths to try it"


def default_threads() -> list[int]:
    return sorted({1, machine.usable_cores()})


def scaling_threads() -> list[int]:
    """Return the thread counts that `--scaling` tries: powers of two, and where cores end."""
    cores = topology.read()
    powers = {2**i for i in range(cores.usable.bit_length())}
    return sorted({*powers, *cores.thread_counts(), 2 * cores.usable})


def variants(
    names: Sequence[str],
    threads: Sequence[int] | None = None,
    choices: Mapping[str, Sequence[Any]] | None = None,
) -> tuple[Variant, ...]:
    """Return the variants of the named paths, the base path first (added if missing)."""
    counts = list(threads or default_threads())
    # one Python thread or process is the plain loop with overhead: unless asked, only the most
    workers = counts if threads else [max(counts)]
    names = expand(names or [C_PATHS])
    selected = []
    for name in [paths.BASE, *(n for n in names if n != paths.BASE)]:
        path = paths.find(name)
        values = dict(choices or {})
        values |= dict.fromkeys(WORKER_OPTIONS, workers)
        values["threads"] = workers if name == "threads" else counts
        try:
            selected += [Variant(name, options) for options in path.variants(values)]
        except Exception as error:  # a path of the user's own may raise anything
            raise InputError(f"path {name}: {describe(error)}") from error
    return tuple(selected)


def plans(
    plan: ComparisonPlan,
    path_names: Sequence[str],
    threads: Sequence[int] | None = None,
    option_words: Sequence[str] = (),
    nbatches: Sequence[int] | None = None,
    is_rl: bool = False,
) -> list[ComparisonPlan]:
    """Return one plan for each size of a sweep.

    Args:
      option_words: such as `pool=new,kept` (see `choices`).
      is_rl: whether there are only paths whose controls a policy can choose.

    Raises:
      InputError: an unknown path or option, or a value that an option cannot have.
    """
    names = expand(path_names)
    values_by_name = choices(option_words, names)
    sizes: list[int | None] = [*nbatches] if nbatches else [None]
    if names and len(sizes) > 1:
        names = [*names, *rivals(names)]
    if is_rl:
        names = [name for name in names or expand([C_PATHS]) if paths.find(name).closed_loop]
    selected = list(variants(names, threads, values_by_name))
    if WITHOUT_TIMER not in selected:
        selected.insert(1, WITHOUT_TIMER)
    plan = dataclasses.replace(plan, variants=tuple(selected))
    return [dataclasses.replace(plan, nbatch=size) for size in sizes]


def expand(names: Sequence[str]) -> list[str]:
    """Return paths by name, with `c` replaced by the C paths, `usual` by those and MJX if there.

    Paths that are not usual are in neither.
    """
    usual = {n: path for n, path in paths.registry().items() if path.usual}
    expanded: list[str] = []
    for name in names:
        if name == C_PATHS:
            expanded += [n for n, path in usual.items() if not path.compiles]
        elif name == USUAL_PATHS:
            expanded += [n for n, p in usual.items() if not p.compiles or p.unavailable() is None]
        else:
            expanded.append(name)
    return list(dict.fromkeys(expanded))


def check_for_rl(names: Sequence[str]) -> None:
    """Refuse a path whose controls a policy cannot choose from the states before them."""
    for name in names:
        if name not in (C_PATHS, USUAL_PATHS) and not paths.find(name).closed_loop:
            raise InputError(f"--rl: {name} takes controls known beforehand, no policy can use it")


def why_left_out_on_a_cpu(workload: Workload, resources: paths.Resources) -> str | None:
    """Return why a path that compiles is not tried on this model unless the user named it."""
    if reference_run.describe(workload.model).integrator == "rk4":
        return _RK4_REASON
    return _CONTACT_REASON if reference_peaks(workload, resources).contacts else None


def rivals(names: Sequence[str]) -> list[str]:
    """Return the C paths to compare with in a sweep that names accelerated paths alone."""
    accelerated = [name for name in names if paths.find(name).compiles]
    if accelerated and not set(names) - {*accelerated, paths.BASE}:
        return [n for n, p in paths.registry().items() if "threads" in {o.name for o in p.options}]
    return []


def choices(arguments: Sequence[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """Return option values by option name from arguments such as `pool=new,kept`."""
    options = {
        option.name: option
        for name in [*paths.registry(), *names]
        for option in paths.find(name).options
    }
    values_by_name: dict[str, list[Any]] = {}
    for argument in arguments:
        name, equals, values = argument.partition("=")
        if not equals or name not in options:
            known = ", ".join(options)
            raise InputError(f"--option {argument!r}: give NAME=VALUE, NAME one of {known}")
        if name in WORKER_OPTIONS:
            raise InputError(f"--option {argument!r}: give the number of {name} with --threads")
        if name in values_by_name:
            raise InputError(f"--option {argument!r}: {name} is given twice; name values V,V")
        values_by_name[name] = [options[name].value(value) for value in values.split(",")]
    return values_by_name
