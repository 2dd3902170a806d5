"""What on this machine spoils a measurement, and what to do about it.

Each function looks at one thing, and returns a `Condition`; those that do not apply here return
None. On Linux most of it is in /sys and /proc.
"""

import itertools
import os
import statistics
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mjbench import formats
from mjbench.host import machine, neighbours, topology
from mjbench.host.disturbance import NOTABLE_STOLEN
from mjbench.host.machine import ProcessorTime
from mjbench.host.neighbours import Neighbour

_CPU = Path("/sys/devices/system/cpu")
# A load above this share of the usable cores leaves too little to measurements.
_MAX_LOAD = 0.3
# How long the processor is kept busy while the host's share is measured, in seconds.
_STOLEN_S = 2.0
_BETTER_CLOCK = "have the kernel use the processor's counter: boot with clocksource=tsc"
# A clock whose smallest step is longer cannot time a step, in nanoseconds.
_MAX_TIMER_NS = 1000.0

# The share that threads must get of the cores that they can use: with less, their figures say more
# about the machine's other guests than about what was measured.
ENOUGH_CORES = 0.85


class Grade(StrEnum):
    """How bad a condition is."""

    GOOD = "good"
    NOTE = "note"
    """It limits what can be measured, and nothing else."""
    BAD = "bad"
    """It makes measurements noisier, or wrong."""


@dataclass(frozen=True)
class Condition:
    """One thing that was looked at.

    Attributes:
      remedy: empty where nothing need be done.
    """

    name: str
    grade: Grade
    detail: str
    remedy: str = ""


def all_conditions(others: Sequence[Neighbour]) -> Iterator[Condition]:
    for condition in (
        cores(),
        governor(),
        turbo(),
        load(),
        stolen(),
        battery(),
        debug_build(),
        other_mjbench(others),
        timer(),
    ):
        if condition is not None:
            yield condition


def cores() -> Condition:
    usable = topology.read()
    detail = formats.count_of(usable.hardware_threads, "hardware thread")
    if usable.cores is not None:
        detail += f" of {formats.count_of(usable.cores, 'core')}"
    if len(usable.node_sizes) > 1:
        detail += f" on {len(usable.node_sizes)} NUMA nodes"
    if usable.quota_cores is not None and usable.quota_cores < usable.hardware_threads:
        return Condition(
            "cores",
            Grade.BAD,
            f"{detail}, but a quota of {usable.quota_cores:g} cores, which stops threads at times",
            "lift the control group's quota, or pin the container to whole cores",
        )
    if usable.cores is not None and usable.cores < usable.hardware_threads:
        return Condition(
            "cores",
            Grade.NOTE,
            f"{detail}: hyper-threads share a core",
            "where threads are compared, turn hyper-threading off, or give --threads at most the"
            " number of cores",
        )
    if usable.hardware_threads < 2:
        return Condition(
            "cores",
            Grade.NOTE,
            f"{detail}: the next processes start on the core that is being measured",
            "verdicts take longer; allow a second core",
        )
    return Condition("cores", Grade.GOOD, detail)


def governor(folder: Path = _CPU) -> Condition | None:
    files = folder.glob("cpu[0-9]*/cpufreq/scaling_governor")
    names = {name for name in map(machine.read_text, files) if name}
    if not names:
        return None
    detail = ", ".join(sorted(names))
    if names == {"performance"}:
        return Condition("governor", Grade.GOOD, detail)
    return Condition(
        "governor",
        Grade.BAD,
        f"{detail}: the clock follows the load",
        "sudo cpupower frequency-set --governor performance",
    )


def turbo(folder: Path = _CPU) -> Condition | None:
    no_turbo = machine.read_text(folder / "intel_pstate/no_turbo")
    boost = machine.read_text(folder / "cpufreq/boost")
    if not no_turbo and not boost:
        return None
    if no_turbo == "1" or boost == "0":
        return Condition("turbo", Grade.GOOD, "off")
    return Condition(
        "turbo",
        Grade.NOTE,
        "on: one thread has a faster clock than several, and heat slows it down",
        "where threads are compared, turn it off: echo 1 | sudo tee"
        " /sys/devices/system/cpu/intel_pstate/no_turbo, or echo 0 | sudo tee"
        " /sys/devices/system/cpu/cpufreq/boost",
    )


def load() -> Condition:
    import psutil

    usable, average = machine.usable_cores(), psutil.getloadavg()[0]
    total = max(usable, os.cpu_count() or 1)
    detail = f"load average {average:.1f} on {formats.count_of(total, 'core')}"
    if usable < total:
        detail += f", of which {usable} are usable here"
    if average <= total - (1 - _MAX_LOAD) * usable:
        return Condition("load", Grade.GOOD, detail)
    return Condition("load", Grade.BAD, detail, "end other programs, and wait a minute")


def stolen() -> Condition | None:
    """Return the share of processor time that the host takes; None on a machine of its own.

    A hypervisor that hides itself shows by the processor time that it has taken.
    """
    before = ProcessorTime.now()
    if not (machine.is_virtual() or before.stolen_s > 0):
        return None
    end = time.monotonic() + _STOLEN_S
    while time.monotonic() < end:  # a machine that asks for nothing gets all of it
        pass
    share = ProcessorTime.now().stolen_since(before)
    detail = f"a virtual machine; its host takes {100 * share:.0f} % of the processor time"
    if share < NOTABLE_STOLEN:
        return Condition("host", Grade.GOOD, detail)
    return Condition(
        "host", Grade.BAD, detail, "measure at another hour, or on a machine of your own"
    )


def battery() -> Condition | None:
    import psutil

    read = getattr(psutil, "sensors_battery", None)
    state = read() if read else None
    if state is None or state.power_plugged is None:  # none, or the system does not know
        return None
    if state.power_plugged:
        return Condition("power", Grade.GOOD, "plugged in")
    return Condition("power", Grade.BAD, "on battery, which slows the clock", "plug it in")


def debug_build() -> Condition:
    if sysconfig.get_config_var("Py_DEBUG"):
        detail, remedy = "a debug build of Python", "use a release build"
    elif sys.gettrace() is not None or sys.getprofile() is not None:
        detail, remedy = "a debugger, profiler or coverage is active", "run without it"
    elif sys.flags.dev_mode or "debug" in os.environ.get("PYTHONMALLOC", ""):
        detail, remedy = "Python checks its memory", "unset PYTHONDEVMODE and PYTHONMALLOC"
    else:
        return Condition("Python", Grade.GOOD, sys.version.split()[0])
    return Condition("Python", Grade.BAD, detail, remedy)


def other_mjbench(others: Sequence[Neighbour]) -> Condition:
    if not others:
        return Condition("other mjbench", Grade.GOOD, "none measures now")
    verb = "measures" if len(others) == 1 else "measure"
    return Condition(
        "other mjbench",
        Grade.BAD,
        f"{neighbours.describe(others)} {verb} now",
        "wait until it ends, or use --wait",
    )


def timer(clock: Callable[[], int] = time.perf_counter_ns) -> Condition:
    readings = [clock() for _ in range(2000)]
    steps = [b - a for a, b in itertools.pairwise(readings)]
    moves = [step for step in steps if step > 0]
    if not moves:
        detail = f"the clock did not move during {len(readings):,} readings"
        return Condition("clock", Grade.BAD, detail, _BETTER_CLOCK)
    cost_ns, resolution_ns = statistics.median(steps), min(moves)
    detail = (
        f"reading the clock takes {cost_ns:.0f} ns; its smallest step is {resolution_ns:.0f} ns"
    )
    if max(cost_ns, resolution_ns) <= _MAX_TIMER_NS:
        return Condition("clock", Grade.GOOD, detail)
    return Condition("clock", Grade.BAD, f"{detail}: too long for single steps", _BETTER_CLOCK)
