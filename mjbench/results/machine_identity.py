"""Which runs were measured on the same machine, and a short name of each machine.

Runs are of one machine where processor, architecture, usable cores, memory, kind of system,
virtualisation and the user's label (MJBENCH_MACHINE) are the same; without a label, the host must
be the same.
"""

import math
import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mjbench import formats
from mjbench.host.machine import Machine

# What names of processors say besides which one it is.
_NOT_THE_MODEL = re.compile(
    r"\((?:R|TM)\)|\bCPU\b|@.*$|\b\d+-Core\b|\bProcessor\b|\bwith Radeon.*$", re.IGNORECASE
)

# A reference loop varies by less from one run to another on a quiet machine.
LEAST_CHANGE = 1.1


@dataclass(frozen=True)
class MachineIdentity:
    """One machine among those of some runs, with its own name; one with a label has no host."""

    name: str
    cpu: str
    architecture: str
    usable_cores: int
    memory_gib: int
    system: str
    hypervisor: bool
    label: str
    host: str


def identify(machines: Sequence[Machine]) -> list[MachineIdentity]:
    """Return the identity of each machine of some runs; equal ones are the same machine.

    Names depend on which others there are. Machines that share a name get letters in their order.
    """
    unnamed = [
        MachineIdentity(
            "",
            machine.cpu,
            machine.architecture,
            machine.usable_cores,
            round(machine.memory_bytes / 2**30),  # kernels reserve a little more or less
            machine.system.partition("-")[0],  # without the version
            machine.hypervisor,
            machine.label,
            "" if machine.label else machine.host,
        )
        for machine in machines
    ]
    names = _names(list(dict.fromkeys(unnamed)))
    return [replace(identity, name=names[identity]) for identity in unnamed]


def changed_speed(old: Machine, new: Machine) -> str:
    """Return that the machine itself became faster or slower, in a sentence; else empty."""
    if not old.reference_ns or not new.reference_ns or old.python != new.python:
        return ""
    ratio = new.reference_ns / old.reference_ns
    if abs(math.log(ratio)) < math.log(LEAST_CHANGE):
        return ""
    return (
        f"A reference loop takes {formats.factor(ratio)} times as long in NEW: the speed of the"
        " machine changed"
    )


def _names(identities: Sequence[MachineIdentity]) -> dict[MachineIdentity, str]:
    """Return a name for each: as much as tells it apart, and a letter where nothing does."""
    names = {i: i.label or short_cpu_name(i.cpu) for i in identities}
    for detail in _DETAILS:
        for group in _same_name(names):
            if len({detail(i) for i in group}) > 1:
                names |= {i: f"{names[i]}, {detail(i)}" for i in group}
    for group in _same_name(names):
        names |= {i: f"{names[i]} {_letters(n)}" for n, i in enumerate(group)}
    return names


def _same_name(names: dict[MachineIdentity, str]) -> list[list[MachineIdentity]]:
    groups: dict[str, list[MachineIdentity]] = defaultdict(list)
    for identity, name in names.items():
        groups[name].append(identity)
    return [group for group in groups.values() if len(group) > 1]


def short_cpu_name(cpu: str) -> str:
    return " ".join(_NOT_THE_MODEL.sub(" ", cpu).split()) or cpu or "unknown processor"


def _letters(number: int) -> str:
    """Return A, B, …, Z, AA, AB, … for 0, 1, 2 and so on."""
    before, digit = divmod(number, 26)
    return (_letters(before - 1) if before else "") + chr(ord("A") + digit)


# What tells machines of one name apart, tried in turn.
_DETAILS: tuple[Callable[[MachineIdentity], str], ...] = (
    lambda machine: short_cpu_name(machine.cpu),
    lambda machine: machine.cpu,
    lambda machine: formats.count_of(machine.usable_cores, "core"),
    lambda machine: f"{machine.memory_gib} GiB",
    lambda machine: machine.architecture,
    lambda machine: machine.system,
    lambda machine: "virtual" if machine.hypervisor else "not virtual",
)
