"""Which cores this process may use: hardware threads, physical cores, NUMA nodes, a quota.

Hardware threads of one core (hyper-threads) share its arithmetic units; cores of one NUMA node
share its memory. On Linux the kernel describes them in /sys/devices/system (kernel documentation,
admin-guide/cputopology.rst); elsewhere only the number of cores is known.
"""

import math
import os
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

from mjbench.host import platforms
from mjbench.host.machine import cgroup_quota

_SYSTEM = Path("/sys/devices/system")


@dataclass(frozen=True)
class Topology:
    """The cores that a process may use, as far as known.

    Attributes:
      node_sizes: hardware threads of each NUMA node, the largest first.
      quota_cores: CPU quota of the control group.
    """

    hardware_threads: int
    cores: int | None = None
    node_sizes: tuple[int, ...] = ()
    quota_cores: float | None = None

    @property
    def usable(self) -> int:
        quota = self.hardware_threads if self.quota_cores is None else math.ceil(self.quota_cores)
        return max(1, min(self.hardware_threads, quota))

    def thread_counts(self) -> tuple[int, ...]:
        """Return the numbers of threads at which something changes, in rising order."""
        counts = {1, self.usable, self.cores or 1}
        if self.node_sizes:
            counts.add(self.node_sizes[0])
        if self.quota_cores is not None:
            counts.add(max(1, int(self.quota_cores)))
        return tuple(sorted(count for count in counts if count <= self.usable))


def read(usable: AbstractSet[int] | None = None, system: Path = _SYSTEM) -> Topology:
    """Return the cores of some hardware threads; None for those that this process may use."""
    usable = platforms.affinity() if usable is None else usable
    quota_cores = cgroup_quota()
    if not usable:
        import psutil

        count = os.cpu_count() or 1
        return Topology(count, psutil.cpu_count(logical=False), quota_cores=quota_cores)
    cores = {siblings(number, system) for number in usable}
    nodes = [_numbers(file) & usable for file in system.glob("node/node[0-9]*/cpulist")]
    return Topology(
        hardware_threads=len(usable),
        cores=len(cores) if all(cores) else None,
        node_sizes=tuple(sorted((len(node) for node in nodes if node), reverse=True)),
        quota_cores=quota_cores,
    )


def siblings(thread: int, system: Path = _SYSTEM) -> frozenset[int]:
    return _numbers(system / f"cpu/cpu{thread}/topology/thread_siblings_list")


def _numbers(file: Path) -> frozenset[int]:
    numbers: set[int] = set()
    try:
        for part in file.read_text().strip().split(","):
            first, _, last = part.partition("-")
            numbers.update(range(int(first), int(last or first) + 1))
    except (OSError, ValueError):
        return frozenset()
    return frozenset(numbers)
