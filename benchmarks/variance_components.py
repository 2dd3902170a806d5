"""Where the noise of launches comes from: blocks, layouts of memory, or launches themselves.

    python -m benchmarks.variance_components [MODEL]... [--programs 10] [--releases OLD NEW]

splits the variance of launches' log ratios into three components. More blocks in a launch reduce
the first, more layouts the second; only more launches reduce the third. It then prints the mean of
the log ratios, the correlation of launches whose workers were forked from the same programs, and
the standard deviation of a launch for several ways to sum up its blocks.

Both sides are the installed release, unless two others are given; their code is moved from launch
to launch. Leave the machine alone meanwhile; 10 programs take about a minute for each model.
"""

import argparse
import itertools
import random
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjbench.measuring import stats
from mjbench.paired import memory_layout
from mjbench.paired.records import LaunchRow
from mjbench.paired.target_pair import TargetPair
from mjbench.paired.targets import Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import placement, release_names
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation import models

# Ratio of the standard deviation of normal noise to its median absolute deviation, and of the
# standard error of a median to that of a mean.
_SD_PER_MAD, _MEDIAN_ERROR = 1.4826, 1.2533


@dataclass(frozen=True)
class Components:
    """Standard deviations of a launch's log ratio, in percent; their squares add up.

    Attributes:
      blocks: of the noise of blocks, for all blocks of a launch together.
      layouts: of layouts of memory, for all layouts of a launch together.
      launches: between launches, beyond both.
      total: of the log ratios of launches.
    """

    blocks: float
    layouts: float
    launches: float
    total: float


def by_layout(launch: LaunchRow) -> list[LaunchRow]:
    """Return each layout of a launch as if it were a launch."""
    layouts, end = [], 0
    for count in launch.layouts:
        chosen, end = slice(end, end + count), end + count
        orders, ns = launch.orders[chosen], launch.ns[chosen]
        layouts.append(replace(launch, orders=orders, ns=ns, layouts=[count]))
    return layouts


def _pairs(launch: LaunchRow) -> np.ndarray:
    """Return (quads, 2) log ratios of pairs (see `stats.pair_log_ratios`)."""
    return stats.pair_log_ratios(launch.orders, np.asarray(launch.ns, dtype=float))


def components(launches: Sequence[LaunchRow]) -> Components:
    """Split the variance of launches, each with several layouts, by the method of moments."""
    ratios, errors = [], []
    for launch in launches:
        layouts = by_layout(launch)
        ratios.append(np.array([layout.log_ratio for layout in layouts]))
        errors.append(np.array([_block_variance(layout) for layout in layouts]))
    counts = np.array([len(r) for r in ratios])
    block = np.mean([e.mean() for e in errors])
    between_layouts = np.mean([r.var(ddof=1) for r in ratios])
    layout = max(between_layouts - block, 0.0)
    per_launch = float(np.mean(1 / counts))
    total = float(np.var([launch.log_ratio for launch in launches], ddof=1))
    remaining = max(total - (layout + block) * per_launch, 0.0)
    parts = (block * per_launch, layout * per_launch, remaining, total)
    return Components(*(100 * float(np.sqrt(part)) for part in parts))


def _block_variance(layout: LaunchRow) -> float:
    """Return the variance of a layout's log ratio, from how the pairs of a section spread."""
    pairs = _pairs(layout)
    sections = (pairs - np.median(pairs, axis=0)).reshape(-1, layout.nsection, 2)
    mad = np.median(np.abs(sections - np.median(sections, axis=(0, 2), keepdims=True)))
    return float((_MEDIAN_ERROR * _SD_PER_MAD * mad) ** 2 / pairs.size)


def _median(pairs: np.ndarray) -> float:
    return float(np.median(pairs, axis=0).mean())


def _trimmed(pairs: np.ndarray) -> float:
    ordered = np.sort(pairs, axis=0)
    cut = len(pairs) // 5
    return float(ordered[cut : len(pairs) - cut].mean())


SUMMARIES: dict[str, Callable[[LaunchRow], float]] = {
    "section by section, as in verdicts": lambda launch: launch.log_ratio,
    "median of all pairs": lambda launch: _median(_pairs(launch)),
    "mean of the layouts, each section by section": lambda launch: float(
        np.mean([layout.log_ratio for layout in by_layout(launch)])
    ),
    "trimmed mean of all pairs": lambda launch: _trimmed(_pairs(launch)),
}


def _spread(values: Sequence[float]) -> float:
    """Return a standard deviation in percent that disturbed launches do not decide."""
    low, high = np.quantile(values, [0.1, 0.9])
    return float(100 * (high - low) / 2.5631)  # of normal values


def correlation(groups: Sequence[Sequence[LaunchRow]]) -> tuple[float, float]:
    """Return the correlation of launches of one group, and its standard error if it is small.

    It is the intraclass correlation of a one-way analysis of variance. Its variance where there is
    none: Fisher, Statistical Methods for Research Workers, section 40.
    """
    values = np.array([[launch.log_ratio for launch in group] for group in groups])
    count, size = values.shape
    within = values.var(axis=1, ddof=1).mean()
    between = size * values.mean(axis=1).var(ddof=1)
    estimate = (between - within) / (between + (size - 1) * within)
    return float(estimate), float(np.sqrt(2 / (count * size * (size - 1))))


def measure(old: ReleaseSpec, new: ReleaseSpec, model: str, programs: int) -> list[list[LaunchRow]]:
    """Return the launches of each pair of programs; every pair has its own pool."""
    baseline, candidate = (Target(release, models.resolve(model)) for release in (old, new))
    groups = []
    for _ in range(programs):
        with WorkerPool() as pool:
            pair = TargetPair(pool, baseline, candidate)
            pair.prepare(placement.schedule(random.Random()))
            count = memory_layout.launches_of_a_program() - 1
            groups.append([pair.launch() for _ in range(count)])
            pair.close()
    return groups


def main(arguments: Sequence[str]) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="variance_components", description=__doc__)
    parser.add_argument("models", nargs="*", metavar="MODEL")
    parser.add_argument("--programs", type=int, default=10)
    parser.add_argument("--releases", nargs=2, default=2 * [release_names.INSTALLED])
    options = parser.parse_args(arguments)
    old, new = map(release_names.parse_release, options.releases)
    for model in options.models or models.shipped():
        programs = measure(old, new, model, options.programs)
        launches = list(itertools.chain(*programs))
        parts = components(launches)
        layouts = np.mean([len(launch.layouts) for launch in launches])
        print(
            f"{model}: {parts.total:.2f} % = blocks {parts.blocks:.2f} %, layouts"
            f" {parts.layouts:.2f} %, launches {parts.launches:.2f} %"
            f" ({len(launches)} launches of {layouts:.1f} layouts)"
        )
        values = 100 * np.array([launch.log_ratio for launch in launches])
        mean_error = values.std(ddof=1) / np.sqrt(len(values))
        print(f"  mean: {values.mean():+.2f} +- {mean_error:.2f} %")
        estimate, error = correlation(programs)
        print(f"  correlation of launches of one program: {estimate:.2f} +- {error:.2f}")
        for name, summary in SUMMARIES.items():
            spread = _spread([summary(launch) for launch in launches])
            print(f"  {name}: {spread:.2f} %", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
