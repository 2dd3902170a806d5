"""What spoils measurements, on invented machines."""

import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from mjbench.host import conditions, machine
from mjbench.host.conditions import Grade
from mjbench.host.machine import ProcessorTime
from mjbench.host.neighbours import Neighbour
from mjbench.host.topology import Topology


def kernel_file(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"{text}\n")
    return folder


@pytest.mark.parametrize(
    ("topology", "grade", "words"),
    [
        (Topology(8, 8, (8,)), Grade.GOOD, "8 hardware threads of 8 cores"),
        (Topology(8, 4, (4, 4)), Grade.NOTE, "on 2 NUMA nodes: hyper-threads share a core"),
        (Topology(8, 8, (8,), 2.5), Grade.BAD, "a quota of 2.5 cores"),
        (Topology(1, 1, (1,)), Grade.NOTE, "the core that is being measured"),
    ],
)
def test_cores_are_told_apart(
    monkeypatch: pytest.MonkeyPatch, topology: Topology, grade: Grade, words: str
) -> None:
    monkeypatch.setattr(conditions.topology, "read", lambda: topology)
    condition = conditions.cores()
    assert condition.grade == grade
    assert words in condition.detail
    assert bool(condition.remedy) == (grade != Grade.GOOD)


def test_a_governor_that_follows_the_load_is_bad(tmp_path: Path) -> None:
    assert conditions.governor(tmp_path) is None
    kernel_file(tmp_path, "cpu0/cpufreq/scaling_governor", "performance")
    good = conditions.governor(tmp_path)
    assert good.grade == Grade.GOOD
    kernel_file(tmp_path, "cpu1/cpufreq/scaling_governor", "powersave")
    bad = conditions.governor(tmp_path)
    assert (bad.grade, bad.detail[:22]) == (Grade.BAD, "performance, powersave")


@pytest.mark.parametrize(
    ("name", "text", "grade"),
    [
        ("intel_pstate/no_turbo", "1", Grade.GOOD),
        ("intel_pstate/no_turbo", "0", Grade.NOTE),
        ("cpufreq/boost", "0", Grade.GOOD),
        ("cpufreq/boost", "1", Grade.NOTE),
    ],
)
def test_turbo_is_read_as_each_driver_says_it(
    tmp_path: Path, name: str, text: str, grade: Grade
) -> None:
    assert conditions.turbo(tmp_path) is None
    condition = conditions.turbo(kernel_file(tmp_path, name, text))
    assert condition.grade == grade


@pytest.mark.parametrize(
    ("total", "average", "grade"),
    [
        (2, 0.5, Grade.GOOD),
        (2, 1.5, Grade.BAD),
        # two cores of a large machine, whose load is that of all
        (64, 62.0, Grade.GOOD),
        (64, 64.0, Grade.BAD),
    ],
)
def test_a_load_takes_time_from_measurements(
    monkeypatch: pytest.MonkeyPatch, total: int, average: float, grade: Grade
) -> None:
    monkeypatch.setattr(machine, "usable_cores", lambda: 2)
    monkeypatch.setattr(conditions.os, "cpu_count", lambda: total)
    monkeypatch.setattr(psutil, "getloadavg", lambda: (average, 0.0, 0.0))
    assert conditions.load().grade == grade


@pytest.mark.parametrize(("stolen_s", "grade"), [(0.0, Grade.GOOD), (0.1, Grade.BAD)])
def test_a_host_that_takes_time_is_bad(
    monkeypatch: pytest.MonkeyPatch, stolen_s: float, grade: Grade
) -> None:
    times = iter([ProcessorTime(0.0, 0.0), ProcessorTime(0.5, stolen_s)])
    spent = iter([0.0, 0.2, 2.5])
    monkeypatch.setattr(machine, "is_virtual", lambda: True)
    monkeypatch.setattr(ProcessorTime, "now", lambda: next(times))
    monkeypatch.setattr(conditions.time, "process_time", lambda: next(spent))
    condition = conditions.stolen()
    assert condition.grade == grade


def test_a_machine_of_its_own_has_no_host(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "is_virtual", lambda: False)
    monkeypatch.setattr(ProcessorTime, "now", lambda: ProcessorTime(1.0, 0.0))
    assert conditions.stolen() is None


def test_a_host_that_hides_is_noticed_by_what_it_took(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([ProcessorTime(1.0, 0.1), ProcessorTime(2.0, 0.2)])
    spent = iter([0.0, 2.5])
    monkeypatch.setattr(machine, "is_virtual", lambda: False)
    monkeypatch.setattr(ProcessorTime, "now", lambda: next(times))
    monkeypatch.setattr(conditions.time, "process_time", lambda: next(spent))
    condition = conditions.stolen()
    assert condition.grade == Grade.BAD


@pytest.mark.parametrize(("plugged", "grade"), [(True, Grade.GOOD), (False, Grade.BAD)])
def test_a_battery_slows_the_clock(
    monkeypatch: pytest.MonkeyPatch, plugged: bool, grade: Grade
) -> None:
    state = SimpleNamespace(power_plugged=plugged)
    monkeypatch.setattr(psutil, "sensors_battery", lambda: state, raising=False)
    condition = conditions.battery()
    assert condition.grade == grade
    for unknown in (None, SimpleNamespace(power_plugged=None)):
        monkeypatch.setattr(psutil, "sensors_battery", lambda state=unknown: state, raising=False)
        assert conditions.battery() is None


def test_what_watches_python_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "gettrace", lambda: object())
    assert conditions.debug_build().grade == Grade.BAD


def test_other_measurements_are_named() -> None:
    assert conditions.other_mjbench([]).grade == Grade.GOOD
    condition = conditions.other_mjbench([Neighbour(12, "compare")])
    assert condition.grade == Grade.BAD
    assert "mjbench compare, process 12" in condition.detail


@pytest.mark.parametrize(("step_ns", "grade"), [(50, Grade.GOOD), (4_000_000, Grade.BAD)])
def test_a_coarse_clock_cannot_time_a_step(step_ns: int, grade: Grade) -> None:
    readings = iter(range(0, 10_000 * step_ns, step_ns))
    assert conditions.timer(lambda: next(readings)).grade == grade


def test_a_clock_that_stands_still_is_bad() -> None:
    condition = conditions.timer(lambda: 7)
    assert condition.grade == Grade.BAD
    assert "did not move" in condition.detail


@pytest.mark.parametrize(("allocator", "grade"), [("malloc", Grade.GOOD), ("debug", Grade.BAD)])
def test_an_allocator_that_checks_is_bad(
    monkeypatch: pytest.MonkeyPatch, allocator: str, grade: Grade
) -> None:
    monkeypatch.setattr(sys, "gettrace", lambda: None)
    monkeypatch.setenv("PYTHONMALLOC", allocator)
    assert conditions.debug_build().grade == grade
