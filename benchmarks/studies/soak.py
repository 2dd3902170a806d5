"""Check that many comparisons in one process use up nothing.

    python -m benchmarks.studies.soak [--comparisons 1000] [--every 50]

compares ways of stepping the cart-pole again and again in one process, each time with a child, and
launches a pair of workers after every fifth. At regular intervals it prints what this process
holds: file descriptors, threads, memory, child processes, and temporary files that carry its
process id.

The exit code is 1 if any of them grows. Descriptors, threads, processes and files must never be
more than at the first report. Memory may vary: the median of the last third of the reports must not
exceed that of the first third by more than 5 MiB and 1 KiB per comparison between the two.

A thousand comparisons take half an hour or more; the machine may do other work meanwhile.
"""

import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import tally_command

if TYPE_CHECKING:
    from mjbench.paired.worker_pool import WorkerPool

MODEL = "cartpole"
# Comparisons for each launch of a pair of workers, which takes several times as long.
COMPARISONS_PER_LAUNCH = 5
# Memory that a process may gain without a leak: at once, and for each comparison.
SLACK_BYTES, SLACK_PER_COMPARISON_BYTES = 5 << 20, 1 << 10


@dataclass(frozen=True)
class Usage:
    """What this process holds after some comparisons.

    Attributes:
      processes: processes below this one.
      files: temporary files of this process.
      memory_bytes: resident memory.
    """

    comparisons: int
    descriptors: int
    threads: int
    processes: int
    files: int
    memory_bytes: int

    @classmethod
    def now(cls, comparisons: int) -> "Usage":
        """Return what this process holds now."""
        import psutil  # asv imports this module where it is missing

        process = psutil.Process()
        names = Path(tempfile.gettempdir()).glob(f"mjbench-*-{process.pid}-*")
        return cls(
            comparisons,
            descriptors=process.num_fds(),
            threads=process.num_threads(),
            processes=len(process.children(recursive=True)),
            files=len(list(names)),
            memory_bytes=process.memory_info().rss,
        )

    def __str__(self) -> str:
        """Return it as a line for people."""
        return (
            f"{self.comparisons:6,} comparisons: {self.descriptors} descriptors,"
            f" {self.threads} threads, {self.processes} processes, {self.files} temporary files,"
            f" {self.memory_bytes / 2**20:.1f} MiB"
        )


def growth(usages: Sequence[Usage]) -> list[str]:
    """Return what grew, a line each; empty if nothing did."""
    first, lines = usages[0], []
    for name in ("descriptors", "threads", "processes", "files"):
        most = max(getattr(usage, name) for usage in usages)
        if most > getattr(first, name):
            lines.append(f"{name} grew from {getattr(first, name)} to {most}")
    third = max(1, len(usages) // 3)
    before, after = usages[:third], usages[-third:]
    gain = _median_bytes(after) - _median_bytes(before)
    comparisons = after[-1].comparisons - before[0].comparisons
    if gain > SLACK_BYTES + SLACK_PER_COMPARISON_BYTES * comparisons:
        lines.append(f"memory grew by {gain / 2**20:.1f} MiB over {comparisons:,} comparisons")
    return lines


def _median_bytes(usages: Sequence[Usage]) -> float:
    return statistics.median(usage.memory_bytes for usage in usages)


def compare_once() -> None:
    """Compare once, by a child."""
    from mjbench.commands.compare.driver import ModelChildren
    from mjbench.host import files
    from mjbench.paths import BASE
    from mjbench.simulation import models
    from mjbench.status import Status
    from mjbench.verification.path_verification import ModelFiles
    from mjbench.verification.plan import ComparisonPlan, Variant

    # the smallest work there is: what is checked is what is left after it
    plan = ComparisonPlan(variants=(Variant(BASE, {}),), nbatch=1, nstep=1)
    with files.temporary_folder() as folder:
        ended = ModelChildren(models.resolve(MODEL), plan, ModelFiles.in_folder(folder)).verify()
    if ended.status != Status.OK:
        raise SystemExit(f"a comparison failed: {ended.detail}")


def launch_once(pool: "WorkerPool") -> None:
    """Launch a pair of workers once."""
    from mjbench.paired.run_sizes import Sizes
    from mjbench.paired.target_pair import pair_of
    from mjbench.paired.targets import Target
    from mjbench.releases import release_names
    from mjbench.simulation import models

    target = Target(release_names.parse_release(release_names.INSTALLED), models.resolve(MODEL))
    pair = pair_of(pool, (target, target), Sizes(nbatch=1, nstep=1))
    try:
        pair.prepare()
        pair.launch()
    finally:
        pair.close()
        if pair.baseline_workload:
            pair.baseline_workload.unlink()  # it would last as long as the pool


def main() -> int:
    """Run the comparisons; return the exit code."""
    from mjbench.paired.worker_pool import WorkerPool

    parser = tally_command.parser(__doc__)
    parser.add_argument("--comparisons", type=int, default=1000, help="to run")
    parser.add_argument("--every", type=int, default=50, help="comparisons between two reports")
    options = parser.parse_args()
    usages: list[Usage] = []
    with WorkerPool() as pool:
        for count in range(1, options.comparisons + 1):
            compare_once()
            if count % COMPARISONS_PER_LAUNCH == 1:  # the first one, too
                launch_once(pool)
            if count % options.every == 0 or count in (1, options.comparisons):
                usages.append(Usage.now(count))
                print(usages[-1], flush=True)
    lines = growth(usages)
    print("\n".join(lines) if lines else "nothing grew")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
