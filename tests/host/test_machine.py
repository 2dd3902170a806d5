import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import psutil
import pytest

from mjbench.errors import InputError
from mjbench.host import machine


def set_file(root: Path, name: str, text: str) -> None:
    file = root / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def set_group(root: Path, text: str) -> None:
    """Say in which control groups the process is."""
    set_file(root, "proc/self/cgroup", text)


def set_older_quota(root: Path, group: str, quota_us: int) -> None:
    set_file(root, f"sys/fs/cgroup/cpu/{group}/cpu.cfs_quota_us", f"{quota_us}\n")
    set_file(root, f"sys/fs/cgroup/cpu/{group}/cpu.cfs_period_us", "100000\n")


def test_a_quota_of_cgroup_version_2_is_read(tmp_path: Path) -> None:
    set_file(tmp_path, "sys/fs/cgroup/cpu.max", "150000 100000\n")
    assert machine.cgroup_quota(tmp_path) == 1.5  # also without /proc/self/cgroup
    set_group(tmp_path, "0::/\n")
    assert machine.cgroup_quota(tmp_path) == 1.5


def test_a_quota_of_cgroup_version_1_is_read(tmp_path: Path) -> None:
    set_group(tmp_path, "2:cpu,cpuacct:/\n1:memory:/\n")
    set_older_quota(tmp_path, "", 50_000)
    assert machine.cgroup_quota(tmp_path) == 0.5
    assert machine.usable_cores(tmp_path) == 1


def test_the_least_quota_of_nested_groups_counts(tmp_path: Path) -> None:
    set_group(tmp_path, "0::/user.slice/job:7/step\n")
    groups = {"": "max 100000", "user.slice": "400000 100000", "user.slice/job:7/step": "3 1"}
    for group, text in groups.items():
        set_file(tmp_path, f"sys/fs/cgroup/{group}/cpu.max", text)
    set_file(tmp_path, "sys/fs/cgroup/other/cpu.max", "1 1")
    assert machine.cgroup_quota(tmp_path) == 3.0
    set_file(tmp_path, "sys/fs/cgroup/user.slice/job:7/cpu.max", "150000 100000")
    assert machine.cgroup_quota(tmp_path) == 1.5


def test_the_least_quota_of_nested_groups_of_version_1_counts(tmp_path: Path) -> None:
    set_group(tmp_path, "3:cpuset:/a\n1:cpu:/slurm/job_1\n0::/\n")
    set_older_quota(tmp_path, "", -1)
    set_older_quota(tmp_path, "slurm", 200_000)
    set_older_quota(tmp_path, "slurm/job_1", 50_000)
    set_older_quota(tmp_path, "a", 10_000)
    assert machine.cgroup_quota(tmp_path) == 0.5


@pytest.mark.parametrize("group", ["/../other", "/docker/1234"])
def test_a_container_has_the_quota_that_it_sees_at_the_top(tmp_path: Path, group: str) -> None:
    set_group(tmp_path, f"0::{group}\n")
    set_file(tmp_path, "sys/fs/cgroup/cpu.max", "200000 100000")
    set_file(tmp_path, "sys/fs/other/cpu.max", "1 1")
    assert machine.cgroup_quota(tmp_path) == 2.0


@pytest.mark.parametrize("text", ["max 100000\n", "", "-1 100000"])
def test_no_limit_is_no_quota(tmp_path: Path, text: str) -> None:
    set_file(tmp_path, "sys/fs/cgroup/cpu.max", text)
    assert machine.cgroup_quota(tmp_path) is None


def test_affinity_limits_the_usable_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine.os, "sched_getaffinity", lambda pid: {0, 3, 5})
    assert machine.usable_cores(tmp_path) == 3


def test_cores_follow_from_a_pair_of_times() -> None:
    calibration = machine.Calibration(2)
    assert calibration.cores(single_s=1.0, together_s=1.0) == 2.0
    assert calibration.cores(single_s=1.0, together_s=2.0) == 1.0


def test_both_halves_of_the_calibration_do_the_work_they_stand_for() -> None:
    calibration = machine.Calibration(3)
    step = calibration._model.opt.timestep
    calibration.single()
    calibration.together()
    steps = [round(data.time / step) for data in calibration._datas]
    assert steps == [2 * machine._CALIBRATION_STEPS] + [machine._CALIBRATION_STEPS] * 2


def test_the_description_says_what_ran_where() -> None:
    description = machine.describe()
    assert description.usable_cores >= 1
    assert description.versions["numpy"]
    assert 0 < machine.available_memory_bytes() <= description.memory_bytes


def test_on_macos_the_processor_is_what_its_kernel_names(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"machdep.cpu.brand_string": "Apple M4", "kern.hv_vmm_present": "1"}

    def sysctl(command: list[str], **options: object) -> "subprocess.CompletedProcess[str]":
        return subprocess.CompletedProcess(command, 0, stdout=f"{values[command[-1]]}\n")

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(machine, "_entry", lambda file, key: "")
    monkeypatch.setattr(subprocess, "run", sysctl)
    description = machine.describe()
    assert description.cpu == "Apple M4"
    assert description.hypervisor


@pytest.mark.parametrize("has_psutil", [True, False])
def test_the_control_group_limits_the_available_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_psutil: bool
) -> None:
    if not has_psutil:
        monkeypatch.setitem(sys.modules, "psutil", None)
    top = "sys/fs/cgroup"
    set_file(tmp_path, f"{top}/memory.max", "1000000\n")
    set_file(tmp_path, f"{top}/memory.current", "700000\n")
    set_file(tmp_path, f"{top}/memory.stat", "anon 500000\ninactive_file 200000\n")
    assert machine.available_memory_bytes(tmp_path) == 500_000
    set_group(tmp_path, "1:memory:/a/b\n0::/\n")  # of version 1, within another group
    set_file(tmp_path, f"{top}/memory/a/memory.limit_in_bytes", "500000")
    set_file(tmp_path, f"{top}/memory/a/memory.usage_in_bytes", "300000")
    set_file(tmp_path, f"{top}/memory/a/memory.stat", "cache 5\ntotal_inactive_file 100000\n")
    assert machine.available_memory_bytes(tmp_path) == 300_000


@pytest.mark.parametrize("limit", ["max\n", None])
def test_without_psutil_and_a_limit_memory_counts_as_unlimited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str | None
) -> None:
    monkeypatch.setitem(sys.modules, "psutil", None)
    if limit:
        set_file(tmp_path, "sys/fs/cgroup/memory.max", limit)
    assert machine.available_memory_bytes(tmp_path) == sys.maxsize


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux knows the peak of a program")
def test_the_peak_of_memory_is_not_that_of_the_program_before() -> None:
    peak = "from mjbench.host import machine; print(machine.peak_memory_bytes())"
    program = "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    before = f"import os, sys; bytearray(b'x') * 2**28; {program}"
    command = [sys.executable, "-c", before, "-c", peak]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert 2**22 < int(output) < 2**27


def test_time_that_the_host_took_is_a_share_of_the_time_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = namedtuple("times", "user system idle iowait steal guest")
    readings = iter([times(10, 5, 100, 3, 2, 4), times(25, 8, 180, 9, 4, 16)])
    monkeypatch.setattr(psutil, "cpu_times", lambda: next(readings))
    before, after = machine.ProcessorTime.now(), machine.ProcessorTime.now()
    assert (before.busy_s, before.stolen_s) == (15, 2)
    assert after.stolen_since(before) == pytest.approx(2 / (2 + 18))
    assert before.stolen_since(before) == 0.0


def test_a_system_that_does_not_know_of_a_host_has_nothing_stolen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = namedtuple("times", "user nice system idle")
    monkeypatch.setattr(psutil, "cpu_times", lambda: times(10, 1, 5, 100))
    assert machine.ProcessorTime.now() == machine.ProcessorTime(16, 0.0)


def host_of(monkeypatch: pytest.MonkeyPatch, machine_id: str, address: int, name: str) -> str:
    monkeypatch.setattr(machine, "read_text", lambda path: machine_id)
    monkeypatch.setattr(machine.uuid, "getnode", lambda: address)
    monkeypatch.setattr(machine.platform, "node", lambda: name)
    return machine.host_hash()


def test_a_host_is_told_apart_by_its_id_and_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    hosts = [
        host_of(monkeypatch, machine_id, address, name)
        for machine_id in ("1" * 32, "2" * 32, "")
        for address in (0x02FC00000001, 0x02FC00000002)
        for name in ("alpha", "beta")
    ]
    # with an id, the network card makes no difference
    assert len(set(hosts)) == 2 * 2 + 2 * 2
    assert all(len(host) == 10 and int(host, 16) >= 0 for host in hosts)


def test_a_host_without_an_id_of_its_own_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn_by_python = 0x02FC00000001 | 1 << 40
    assert host_of(monkeypatch, "", drawn_by_python, "alpha") == ""


def test_the_user_names_a_machine_by_a_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(machine.LABEL_VARIABLE, raising=False)
    assert machine.describe().label == ""
    monkeypatch.setenv(machine.LABEL_VARIABLE, " lab\n 1\x1b" + "x" * 55)
    assert machine.describe().label == "lab 1\\x1b" + "x" * 55


def test_a_name_is_not_cut_short_to_that_of_another_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(machine.LABEL_VARIABLE, "x" * 65)
    with pytest.raises(InputError, match="MJBENCH_MACHINE is longer than 64 characters"):
        machine.describe()
