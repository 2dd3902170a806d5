"""Describes what a run ran on: processor, usable cores, memory, versions, load.

Usable cores follow from the scheduler's affinity and the control group's quota, not from the
number of cores of the machine. `Calibration` measures how many of them a run really gets.

Parts of this module also run inside the environments of old releases, where psutil may be missing;
see `available_memory_bytes`.
"""

import contextlib
import hashlib
import hmac
import importlib.metadata
import math
import os
import platform
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt
from mjbench.errors import InputError, one_line
from mjbench.host import platforms

if TYPE_CHECKING:
    import mujoco

_ROOT, _CPUINFO = Path("/"), "/proc/cpuinfo"
# Of a control group of version 2 and of version 1: its limit, what it uses, and the key of what of
# that are cached files.
_MEMORY_FILES = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
# Packages that a result depends on.
_PACKAGES = (
    *("mujoco", "mujoco-core", "mujoco-mjx", "mujoco-warp"),
    *("numpy", "scipy", "jax", "jaxlib", "warp-lang"),
)
# Environment variables that change how fast or what the engine computes.
_FLAGS = (
    "OMP_NUM_THREADS",
    "XLA_FLAGS",
    "JAX_ENABLE_X64",
    "JAX_DEFAULT_MATMUL_PRECISION",
    "NVIDIA_TF32_OVERRIDE",
    "GLIBC_TUNABLES",
    "LD_PRELOAD",
)
# The environment variable with the user's name for this machine, and the longest such name: hosts
# may have such ones.
LABEL_VARIABLE = "MJBENCH_MACHINE"
_LABEL_LENGTH = 64
# XML of a body that costs about a microsecond a step and touches little memory.
_SPINNER = (
    "<mujoco><option gravity='0 0 0'/><worldbody><body><joint type='hinge'/>"
    "<geom size='.1' contype='0' conaffinity='0'/></body></worldbody></mujoco>"
)
_CALIBRATION_STEPS = 5000
# Of the reference loop, which takes about 0.3 ms: the least of so many counts.
_REFERENCE_ITERATIONS, _REFERENCE_LOOPS = 20_000, 20
# Share of the available memory that work may take.
MEMORY_SHARE = 0.6


def usable_cores(root: Path = _ROOT) -> int:
    return max(1, math.ceil(allowed_cores(root)))


def allowed_cores(root: Path = _ROOT) -> float:
    """Return how many cores the affinity and the quota allow; not whole where a quota is not."""
    cores = len(platforms.affinity()) or os.cpu_count() or 1
    return min(cores, cgroup_quota(root) or cores)


@dataclass(frozen=True)
class CoreChange:
    """How many cores this process was allowed before, and how many after a change."""

    before: PositiveFloat
    after: PositiveFloat

    @classmethod
    def since(cls, before: float) -> "CoreChange | None":
        """Return the change until now; None where there is none."""
        after = allowed_cores()
        return cls(before, after) if after != before else None

    def __str__(self) -> str:
        return f"the usable cores changed from {self.before:g} to {self.after:g}"


def cgroup_quota(root: Path = _ROOT) -> float | None:
    """Return the least CPU quota of the control groups of this process, in cores; None without.

    It is in other files of version 2 and version 1 of control groups; psutil knows neither.
    """
    quotas = []
    for group in _control_groups("cpu", root):
        older = (read_text(group / f"cpu.cfs_{name}_us") for name in ("quota", "period"))
        with contextlib.suppress(ValueError, ZeroDivisionError):  # "max" or nothing: no limit
            quota, period = read_text(group / "cpu.max").split()[:2] or older
            quotas.append(int(quota) / int(period))
    return min((quota for quota in quotas if quota > 0), default=None)


def _control_groups(controller: str, root: Path) -> Iterator[Path]:
    """Yield the folders of this process's control group and of those that contain it.

    /proc/self/cgroup has a line such as `0::/a/b` for version 2, and one such as `4:cpu,cpuacct:/a`
    for each hierarchy of version 1. Outside of a container's own groups, the path names none.
    """
    for line in ("0::/", *read_text(root / "proc/self/cgroup").splitlines()):
        _, controllers, name = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / (controller if controllers else "")
        group = PurePath("" if ".." in name else name.lstrip("/"))
        yield from (top / each for each in (group, *group.parents))


def available_memory_bytes(root: Path = _ROOT) -> int:
    """Return the memory that can be used without swapping, limited by the control group's.

    Without psutil, and without such a limit, memory counts as unlimited.
    """
    available = sys.maxsize
    try:
        import psutil
    except ImportError:
        pass
    else:
        available = psutil.virtual_memory().available
    remaining = _cgroup_remaining_bytes(root)
    return available if remaining is None else max(0, min(available, remaining))


def check_memory(bytes_needed: float, work: str, remedy: str) -> None:
    """Refuse work, such as `64 simulations`, that does not fit into memory, and say a remedy."""
    available_bytes = available_memory_bytes()
    if bytes_needed > MEMORY_SHARE * available_bytes:
        raise InputError(
            f"{work} need about {bytes_needed / 2**30:.1f} GiB, {available_bytes / 2**30:.1f} GiB"
            f" are available: {remedy}"
        )


def _cgroup_remaining_bytes(root: Path) -> int | None:
    """Return the least memory that a control group of this process leaves; None without a limit."""
    remaining = []
    for group in _control_groups("memory", root):
        for limit, used, cached in _MEMORY_FILES:
            with contextlib.suppress(ValueError):  # "max" or nothing: no limit
                bytes_left = int(read_text(group / limit)) - int(read_text(group / used))
                for line in read_text(group / "memory.stat").splitlines():
                    if line.startswith(f"{cached} "):  # files that the kernel frees on demand
                        bytes_left += int(line.split()[1])
                remaining.append(bytes_left)
    return min(remaining, default=None)


def data_bytes(model: "mujoco.MjModel") -> int:
    """Return about how much memory one MjData of `model` takes after stepping.

    The arena takes memory only where it was written; it counts as twice what one step uses.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    used = int(getattr(data, "maxuse_arena", 0))
    return int(getattr(data, "nbuffer", 0)) + 2 * used


def peak_memory_bytes() -> int:
    """Return the most memory that this process has had.

    Linux has `ru_maxrss` of what the process ran before, too (execve(2)).
    """
    if sys.platform == "win32":
        raise NotImplementedError("nothing is measured on Windows")
    import resource

    kilobytes = _entry("/proc/self/status", "VmHWM").split()
    peak_bytes = int(kilobytes[0]) * 1024 if kilobytes else None
    if peak_bytes is not None:
        return peak_bytes
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) * (1 if sys.platform == "darwin" else 1024)


def other_programs_s() -> float:
    """Return for how many seconds cores have run other programs, since some moment.

    A difference of two holds where this process and its descendants are the same at both.
    """
    import psutil

    own, other_s = psutil.Process(), ProcessorTime.now().busy_s
    for process in (own, *own.children(recursive=True)):
        with contextlib.suppress(psutil.Error):  # it has ended
            other_s -= sum(process.cpu_times()[:2])
    return other_s


@dataclass(frozen=True)
class ProcessorTime:
    """How long the cores of this machine have run, all together, since it was started.

    Attributes:
      stolen_s: for which a process was ready while the host gave the core to others, if known.
    """

    busy_s: float
    stolen_s: float

    @classmethod
    def now(cls) -> "ProcessorTime":
        import psutil

        times = psutil.cpu_times()
        idle_s = times.idle + getattr(times, "iowait", 0.0)
        # Linux counts the time of guests as time of users, too
        guest_s = getattr(times, "guest", 0.0) + getattr(times, "guest_nice", 0.0)
        stolen_s = getattr(times, "steal", 0.0)
        return cls(sum(times) - idle_s - guest_s - stolen_s, stolen_s)

    def stolen_since(self, earlier: "ProcessorTime") -> float:
        """Return the share of the time asked for since then that the host gave to others."""
        stolen_s = self.stolen_s - earlier.stolen_s
        asked_s = stolen_s + self.busy_s - earlier.busy_s
        return stolen_s / asked_s if asked_s > 0 else 0.0


@dataclass(frozen=True)
class Machine:
    """The machine and its software, as stored with every result.

    Attributes:
      architecture: such as `x86_64`.
      cores: None when unknown.
      usable_cores: see `usable_cores`.
      load_1min: when the run began.
      versions: of the packages that a result depends on, by name.
      flags: environment variables that change speed or results, by name.
      label: the user's name for this machine, from MJBENCH_MACHINE.
      host: see `host_hash`.
      reference_ns: the least time of a short loop of Python when the run began; None if unknown.
    """

    cpu: str
    architecture: str
    system: str
    cores: NonNegativeInt | None
    usable_cores: PositiveInt
    memory_bytes: NonNegativeInt
    load_1min: NonNegativeFloat
    hypervisor: bool
    python: str
    versions: dict[str, str]
    flags: dict[str, str] = field(default_factory=dict)
    label: str = ""
    host: str = ""
    reference_ns: PositiveFloat | None = None


def describe() -> Machine:
    import psutil

    return Machine(
        cpu=_entry(_CPUINFO, "model name")
        or _sysctl("machdep.cpu.brand_string")
        or platform.processor()
        or platform.machine(),
        architecture=platform.machine(),
        system=platform.platform(terse=True),
        cores=os.cpu_count(),
        usable_cores=usable_cores(),
        memory_bytes=psutil.virtual_memory().total,
        load_1min=round(psutil.getloadavg()[0], 2),
        hypervisor=is_virtual(),
        python=platform.python_version(),
        versions=package_versions(_PACKAGES),
        flags={name: os.environ[name] for name in _FLAGS if name in os.environ},
        label=_label(),
        host=host_hash(),
        reference_ns=_reference_ns(),
    )


def _reference_ns() -> float:
    def loop_ns() -> int:
        begin_ns = time.perf_counter_ns()
        for _ in range(_REFERENCE_ITERATIONS):
            pass
        return time.perf_counter_ns() - begin_ns

    return float(min(loop_ns() for _ in range(_REFERENCE_LOOPS)))


class Calibration:
    """Measures how many cores `threads` threads really get: the same work alone and side by side.

    `single()` steps a tiny model in one thread, `together()` in every thread at once; the caller
    times both. If every thread has a core of its own, both take equally long.
    """

    def __init__(self, threads: int):
        import mujoco

        self.threads = threads
        self._model = mujoco.MjModel.from_xml_string(_SPINNER)
        self._datas = [mujoco.MjData(self._model) for _ in range(threads)]
        self._mj_step = mujoco.mj_step

    def single(self) -> None:
        self._work(self._datas[0])

    def together(self) -> None:
        others = [threading.Thread(target=self._work, args=(data,)) for data in self._datas[1:]]
        for thread in others:
            thread.start()
        self._work(self._datas[0])
        for thread in others:
            thread.join()

    def cores(self, single_s: float, together_s: float) -> float:
        return self.threads * single_s / together_s

    def _work(self, data: "mujoco.MjData") -> None:
        self._mj_step(self._model, data, _CALIBRATION_STEPS)


def _label() -> str:
    # cut short, it could be that of another machine
    label = one_line(os.environ.get(LABEL_VARIABLE, ""), _LABEL_LENGTH + 1)
    if len(label) > _LABEL_LENGTH:
        raise InputError(f"{LABEL_VARIABLE} is longer than {_LABEL_LENGTH} characters: {label}")
    return label


def host_hash() -> str:
    """Return ten hexadecimal digits that differ from machine to machine and do not name any.

    They are an HMAC of the host's name, keyed with what nobody outside knows: the machine's id
    (machine-id(5), which must not be published), else the address of a network card. Both go in,
    because containers of one image share the id, and machines may share a name. Empty where there
    is no key: a container that has neither.
    """
    key = read_text("/etc/machine-id") or _network_address()
    if not key:
        return ""
    return hmac.new(key.encode(), platform.node().encode(), hashlib.sha256).hexdigest()[:10]


def _network_address() -> str:
    address = uuid.getnode()
    # where it finds none, it draws a number with this bit set
    return "" if address >> 40 & 1 else f"{address:012x}"


def is_virtual() -> bool:
    flags = _entry(_CPUINFO, "flags").split()
    return "hypervisor" in flags or _sysctl("kern.hv_vmm_present") == "1"


def _entry(file: str, key: str) -> str:
    """Return what a file of /proc has behind a key, on the first line with it; empty without."""
    for line in read_text(file).splitlines():
        name, _, value = line.partition(":")
        if name.strip() == key:
            return value.strip()
    return ""


def _sysctl(name: str) -> str:
    if sys.platform != "darwin":
        return ""
    command = ["/usr/sbin/sysctl", "-n", name]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def read_text(path: str | Path) -> str:
    """Return the text of a file, such as one of the kernel; empty where there is none."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def package_versions(names: Iterable[str]) -> dict[str, str]:
    return {name: version for name in names if (version := _version(name))}


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
