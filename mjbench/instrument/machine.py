"""What a run ran on: processor, cores it may use, memory, versions, load.

Usable cores come from the scheduler's affinity and the control group's quota, never from the
number of cores the machine has. `Calibration` says how many of them a run really had.
"""

import importlib.metadata
import math
import os
import platform
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_PACKAGES = (
    "mujoco",
    "mujoco-core",
    "mujoco-mjx",
    "mujoco-warp",
    "numpy",
    "scipy",
    "jax",
    "jaxlib",
    "warp-lang",
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
# XML of a body that costs about a microsecond a step and touches little memory.
_SPINNER = (
    "<mujoco><option gravity='0 0 0'/><worldbody><body><joint type='hinge'/>"
    "<geom size='.1' contype='0' conaffinity='0'/></body></worldbody></mujoco>"
)
_CALIBRATION_STEPS = 5000


def usable_cores(cgroup: Path = Path("/sys/fs/cgroup")) -> int:
    """Return how many cores this process may use: affinity, limited by the cgroup's quota."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        cores = os.cpu_count() or 1
    quota = cgroup_quota(cgroup)
    return max(1, min(cores, math.ceil(quota))) if quota else cores


def cgroup_quota(root: Path = Path("/sys/fs/cgroup")) -> float | None:
    """Return the CPU quota of the control group in cores, or None if there is none.

    Reads `cpu.max` (version 2) or `cpu.cfs_quota_us` and `cpu.cfs_period_us` (version 1).
    """
    try:
        quota, period = (root / "cpu.max").read_text().split()[:2]
    except (OSError, ValueError):
        try:
            quota = (root / "cpu/cpu.cfs_quota_us").read_text().strip()
            period = (root / "cpu/cpu.cfs_period_us").read_text().strip()
        except OSError:
            return None
    try:
        cores = int(quota) / int(period)
    except (ValueError, ZeroDivisionError):  # "max": no limit
        return None
    return cores if cores > 0 else None


def available_memory_bytes() -> int:
    """Return the memory that can be used without swapping: MemAvailable, or the cgroup's rest."""
    available = sys.maxsize
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                available = int(line.split()[1]) * 1024
    except OSError:
        pass
    try:
        root = Path("/sys/fs/cgroup")
        limit = int((root / "memory.max").read_text())
        used = int((root / "memory.current").read_text())
        for line in (root / "memory.stat").read_text().splitlines():
            if line.startswith("inactive_file "):  # files kept in memory, given back when asked
                used -= int(line.split()[1])
        available = min(available, limit - used)
    except (OSError, ValueError):
        pass
    return max(0, available)


def data_bytes(model: Any) -> int:
    """Return about how much memory one MjData of `model` takes once it has stepped, in bytes.

    The arena is counted as far as a step at the model's defaults used it, twice over: what is
    never touched takes no memory.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    used = int(getattr(data, "maxuse_arena", 0))
    return int(getattr(data, "nbuffer", 0)) + 2 * used


def peak_memory_bytes() -> int:
    """Return the most memory that this process has had, in bytes."""
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) * (1 if sys.platform == "darwin" else 1024)


@dataclass(frozen=True)
class Machine:
    """The machine and what runs on it, as stored with every result.

    Attributes:
      cpu: the processor's name.
      architecture: such as `x86_64`.
      system: operating system and kernel.
      cores: of the machine; None when unknown.
      usable_cores: that this process may use (see `usable_cores`).
      cgroup_quota_cores: the control group's CPU quota in cores; None without one.
      memory_bytes: of the machine.
      load_1min: load average of the last minute when the run began.
      governor: how the processor's clock is chosen; empty when unknown.
      hypervisor: whether this is a virtual machine.
      python: its version.
      versions: of the packages that a result depends on, by name.
      flags: environment variables that change speed or results, by name.
    """

    cpu: str
    architecture: str
    system: str
    cores: int | None
    usable_cores: int
    cgroup_quota_cores: float | None
    memory_bytes: int
    load_1min: float
    governor: str
    hypervisor: bool
    python: str
    versions: dict[str, str]
    flags: dict[str, str] = field(default_factory=dict)


def describe() -> Machine:
    """Return the machine and what runs on it."""
    return Machine(
        cpu=_cpu_name(),
        architecture=platform.machine(),
        system=platform.platform(terse=True),
        cores=os.cpu_count(),
        usable_cores=usable_cores(),
        cgroup_quota_cores=cgroup_quota(),
        memory_bytes=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        load_1min=round(os.getloadavg()[0], 2),
        governor=_read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        hypervisor="hypervisor" in _cpuinfo("flags").split(),
        python=platform.python_version(),
        versions={name: version for name in _PACKAGES if (version := _version(name))},
        flags={name: os.environ[name] for name in _FLAGS if name in os.environ},
    )


class Calibration:
    """How many cores `threads` threads really get: the same work alone and side by side.

    `single()` steps a tiny model in one thread, `together()` in every thread at once; both are
    meant to be timed. With perfect cores both take equally long.
    """

    def __init__(self, threads: int):
        import mujoco

        self.threads = threads
        self._model = mujoco.MjModel.from_xml_string(_SPINNER)
        self._datas = [mujoco.MjData(self._model) for _ in range(threads)]
        self._step = mujoco.mj_step

    def single(self) -> None:
        """Do one thread's work."""
        self._spin(self._datas[0])

    def together(self) -> None:
        """Do every thread's work at once."""
        others = [threading.Thread(target=self._spin, args=(d,)) for d in self._datas[1:]]
        for thread in others:
            thread.start()
        self._spin(self._datas[0])
        for thread in others:
            thread.join()

    def cores(self, single_s: float, together_s: float) -> float:
        """Return the cores that a pair of times stands for."""
        return self.threads * single_s / together_s

    def _spin(self, data: Any) -> None:
        self._step(self._model, data, _CALIBRATION_STEPS)


def _cpu_name() -> str:
    return _cpuinfo("model name") or platform.processor() or platform.machine()


def _cpuinfo(key: str) -> str:
    for line in _read("/proc/cpuinfo").splitlines():
        if line.startswith(key):
            return line.partition(":")[2].strip()
    return ""


def _read(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
