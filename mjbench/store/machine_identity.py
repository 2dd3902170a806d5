"""Which runs were measured on the same machine, and a short name of each machine.

Runs are of one machine where its kind is the same (`MachineKind`), and its label, which the user
gave it. Without labels the host must be the same. A run that says neither, as in older run files,
is counted to the only machine of its kind; where there are several, or none that is known, it is a
machine of its own.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from mjbench import units
from mjbench.host.machine import Machine

# What names of processors say besides which one it is.
_NOT_THE_MODEL = re.compile(
    r"\((?:R|TM)\)|\bCPU\b|@.*$|\b\d+-Core\b|\bProcessor\b|\bwith Radeon.*$", re.IGNORECASE
)


@dataclass(frozen=True)
class MachineKind:
    """What machines share that may be the same one."""

    cpu: str
    architecture: str
    usable_cores: int
    hypervisor: bool

    @classmethod
    def of(cls, machine: Machine) -> "MachineKind":
        return cls(machine.cpu, machine.architecture, machine.usable_cores, machine.hypervisor)


@dataclass(frozen=True)
class MachineIdentity:
    """One machine among those of some runs, with its own name; one with a label has no host."""

    name: str
    kind: MachineKind
    label: str = ""
    host: str = ""


@dataclass(frozen=True)
class RunSoftware:
    """What must be the same for results of one machine to be of the same software."""

    python: str
    versions: tuple[tuple[str, str], ...]
    flags: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, machine: Machine) -> "RunSoftware":
        versions, flags = (tuple(sorted(d.items())) for d in (machine.versions, machine.flags))
        return cls(machine.python, versions, flags)

    def items(self) -> tuple[tuple[str, str], ...]:
        return (*self.versions, ("Python", self.python), *self.flags)


def identify(machines: Sequence[Machine]) -> list[MachineIdentity]:
    """Return the identity of each machine of some runs; equal ones are the same machine.

    Names depend on which others there are. Machines that share a name get letters in their order.
    """
    unnamed = [_identity(machine) for machine in machines]
    known = list(dict.fromkeys(u for u in unnamed if u.label or u.host))
    hosts = _hosts_of_labels(machines)
    resolved = [_resolved(u, known, hosts) for u in unnamed]
    names = _names(list(dict.fromkeys(resolved)))
    return [replace(identity, name=names[identity]) for identity in resolved]


def software_names(softwares: Iterable[RunSoftware]) -> dict[RunSoftware, str]:
    """Return what tells each apart, such as `mujoco 3.17.0`; empty where there is only one."""
    distinct = list(dict.fromkeys(softwares))
    values: dict[str, dict[RunSoftware, str]] = defaultdict(dict)
    for software in distinct:
        for name, value in software.items():
            values[name][software] = value
    differing = {
        name: of_software
        for name, of_software in values.items()
        if len(of_software) < len(distinct) or len(set(of_software.values())) > 1
    }
    return {
        software: ", ".join(
            f"{name} {of_software[software]}" if software in of_software else f"no {name}"
            for name, of_software in differing.items()
        )
        for software in distinct
    }


def _identity(machine: Machine) -> MachineIdentity:
    host = "" if machine.label else machine.host
    return MachineIdentity("", MachineKind.of(machine), machine.label, host)


def _hosts_of_labels(machines: Sequence[Machine]) -> dict[MachineIdentity, set[MachineIdentity]]:
    labelled: dict[MachineIdentity, set[MachineIdentity]] = defaultdict(set)
    for machine in machines:
        if machine.label and machine.host:
            labelled[_identity(replace(machine, label=""))].add(_identity(machine))
    return labelled


def _resolved(
    unnamed: MachineIdentity,
    known: Sequence[MachineIdentity],
    hosts: dict[MachineIdentity, set[MachineIdentity]],
) -> MachineIdentity:
    """Return the machine of a run: the only one that it can be, or one of its own."""
    if unnamed.label:
        return unnamed
    if unnamed.host:
        labelled = hosts.get(unnamed, set())
        return next(iter(labelled)) if len(labelled) == 1 else unnamed
    resolved = {_resolved(k, known, hosts) for k in known if k.kind == unnamed.kind}
    return next(iter(resolved)) if len(resolved) == 1 else unnamed


def _names(identities: Sequence[MachineIdentity]) -> dict[MachineIdentity, str]:
    """Return a name for each: as much as tells it apart, and a letter where nothing does."""
    names = {i: i.label or short_cpu_name(i.kind.cpu) for i in identities}
    for detail in _DETAILS:
        for group in _same_name(names):
            if len({detail(i.kind) for i in group}) > 1:
                names |= {i: f"{names[i]}, {detail(i.kind)}" for i in group}
    for group in _same_name(names):
        unknown = [i for i in group if not (i.label or i.host)]
        names |= {i: f"{names[i]}, host unknown" for i in unknown}
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
_DETAILS: tuple[Callable[[MachineKind], str], ...] = (
    lambda kind: short_cpu_name(kind.cpu),
    lambda kind: kind.cpu,
    lambda kind: units.count_of(kind.usable_cores, "core"),
    lambda kind: kind.architecture,
    lambda kind: "virtual" if kind.hypervisor else "not virtual",
)
