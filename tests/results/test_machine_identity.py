"""Which runs are of the same machine, and what machines are called."""

from dataclasses import replace
from typing import Any

import pytest
from set_files import MACHINE as EPYC

from mjbench.host.machine import Machine
from mjbench.results.machine_identity import changed_speed, identify, short_cpu_name

XEON = replace(EPYC, cpu="Intel(R) Xeon(R) Platinum 8370C CPU @ 2.80GHz")


def names(*machines: Machine) -> list[str]:
    return [identity.name for identity in identify(machines)]


# the same machine


def test_what_is_not_of_the_machine_does_not_tell_machines_apart() -> None:
    earlier = replace(EPYC, system="Linux-6.1-x86_64", memory_bytes=EPYC.memory_bytes - 2**24)
    newer = replace(EPYC, system="Linux-7.0-x86_64", python="3.12.0", versions={})
    later = replace(newer, load_1min=3.0, cores=8, reference_ns=9.0)
    assert len(set(identify([earlier, later]))) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"cpu": XEON.cpu},
        {"architecture": "aarch64"},
        {"usable_cores": 2},
        {"hypervisor": False},
        {"memory_bytes": 2**35},
        {"system": "macOS-15.1-arm64"},
    ],
)
@pytest.mark.parametrize("known", [{}, {"label": "lab"}, {"host": "a1"}])
def test_another_kind_is_another_machine(
    change: dict[str, object], known: dict[str, object]
) -> None:
    machine = replace(EPYC, **known)
    first, second = identify([machine, replace(machine, **change)])
    assert first != second
    assert first.name != second.name


def test_a_label_decides_whatever_the_host() -> None:
    a, b = (replace(EPYC, label="runner", host=host) for host in ("a1", "b2"))
    other = replace(a, label="other")
    identities = identify([a, b, other])
    assert identities[0] == identities[1] != identities[2]
    assert names(a, b, other) == ["runner", "runner", "other"]


def test_a_run_without_a_label_is_of_another_machine_than_one_with() -> None:
    labelled = replace(EPYC, label="lab", host="a1")
    assert names(replace(labelled, label=""), labelled) == ["AMD EPYC 7763", "lab"]


def test_without_labels_the_host_decides() -> None:
    hosts = [replace(EPYC, host=host) for host in ("b2", "a1", "b2")]
    assert names(*hosts) == ["AMD EPYC 7763 A", "AMD EPYC 7763 B", "AMD EPYC 7763 A"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"reference_ns": 1300.0}, "takes 1.30 times as long in NEW"),
        ({"reference_ns": 700.0}, "takes 0.70 times as long in NEW"),
        ({"reference_ns": 1050.0}, ""),
        ({"reference_ns": 1300.0, "python": "3.14.0"}, ""),
        ({"reference_ns": None}, ""),
    ],
)
def test_a_machine_whose_own_speed_changed_is_said_to(change: dict[str, Any], says: str) -> None:
    machine = replace(EPYC, reference_ns=1000.0)
    sentence = changed_speed(machine, replace(machine, **change))
    assert says in sentence and bool(sentence) == bool(says)


# names


def test_names_say_as_much_as_tells_machines_apart() -> None:
    assert names(EPYC, XEON) == ["AMD EPYC 7763", "Intel Xeon Platinum 8370C"]
    small = replace(EPYC, usable_cores=1)
    assert names(EPYC, small) == ["AMD EPYC 7763, 4 cores", "AMD EPYC 7763, 1 core"]
    labelled = [replace(machine, label="ci") for machine in (EPYC, XEON)]
    assert names(*labelled) == ["ci, AMD EPYC 7763", "ci, Intel Xeon Platinum 8370C"]
    faster = replace(XEON, cpu=XEON.cpu.replace("2.80", "2.90"))
    assert len(set(names(XEON, faster))) == 2


def test_many_hosts_have_letters() -> None:
    found = names(*(replace(EPYC, host=str(n)) for n in range(28)))
    assert found[25:] == ["AMD EPYC 7763 Z", "AMD EPYC 7763 AA", "AMD EPYC 7763 AB"]


@pytest.mark.parametrize(
    ("cpu", "short"),
    [
        ("AMD Ryzen 9 7950X 16-Core Processor", "AMD Ryzen 9 7950X"),
        ("Intel(R) Xeon(R) Processor", "Intel Xeon"),
        ("Apple M4", "Apple M4"),
        ("Processor", "Processor"),
        ("", "unknown processor"),
    ],
)
def test_names_of_processors_are_short(cpu: str, short: str) -> None:
    assert short_cpu_name(cpu) == short
