"""How much slower is what `mjbench compare` advises than the best path there is?

    python -m benchmarks.advice [MODEL …] [--threads N,N] [--returns PRODUCT]

compares each model as `mjbench compare` does, with its advice. The advised path then competes, in
fresh processes again, with every other C path that is at least 80 % as fast in one process. The
regret is by how much the fastest of them is faster than the advised path; it is 0 where none is.
The fastest is chosen in one half of the launches, and measured in the other: where it is chosen, it
seems faster than it is. The table has a row for each model and loop; below it stand the largest
regret and the mean.
"""

import argparse
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mjbench.errors import InputError, MachineError, MjbenchError
from mjbench.simulation import models
from mjbench.simulation.workload import Product
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.comparison.plan import ComparisonPlan, Variant
    from mjbench.paired.contest import ContestRecord
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.advice import Advice
    from mjbench.report.results import ModelResults, PathResult
    from mjbench.simulation.models import ModelSource

# Paths that are slower than this share of the fastest one's speed cannot be the best.
MAY_BE_BEST = 0.8
# Seconds of launches that decide which is the best.
TIME_LIMIT_S = 60.0


@dataclass(frozen=True)
class Regret:
    """By how much the best path is faster than the one that is advised.

    Attributes:
      model: its name.
      loop: `open` or `closed`.
      advised: path and options.
      best: path and options; the advised ones where nothing is faster.
      share: time of the advised path over that of the best, less one.
      candidates: how many paths it was compared with.
      low: lower end of the share's 95 % interval; None without one.
      high: upper end.
    """

    model: str
    loop: str
    advised: str
    best: str
    share: float
    candidates: int
    low: float | None = None
    high: float | None = None


def regrets(pool: "WorkerPool", source: "ModelSource", plan: "ComparisonPlan") -> list[Regret]:
    """Return the regret on a model, for each loop.

    Raises:
      InputError: nothing can be advised.
    """
    from mjbench.comparison import compare
    from mjbench.paired import contest
    from mjbench.report.advice import advise, contest_groups
    from mjbench.report.results import derive

    records = compare.compare_model(source, plan, lambda name, share: None)
    if records.interrupted:
        raise KeyboardInterrupt
    results = derive(records.model, records.measurements)
    if groups := contest_groups(results):
        record = contest.run(pool, source, plan, groups, results.compared_sizes)
        results = replace(results, contest=_complete(record))
    advice = advise(results)
    if not advice:
        raise InputError(f"{source.name}: {records.model.detail or 'the plain loop was not timed'}")
    return [_regret(pool, source, plan, results, row) for row in advice]


def _complete(record: "ContestRecord") -> "ContestRecord":
    if record.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    return record


def _regret(
    pool: "WorkerPool",
    source: "ModelSource",
    plan: "ComparisonPlan",
    results: "ModelResults",
    advice: "Advice",
) -> Regret:
    from mjbench.comparison.plan import Variant
    from mjbench.paired import contest
    from mjbench.report.advice import Loop

    advised = Variant(advice.path, advice.options)
    able = [r for r in results.results if r.step_ns and not r.is_accelerated]
    able = [r for r in able if advice.loop == Loop.OPEN or r.closed_loop]
    fastest = max(result.rate for result in able)
    rivals = [_variant(r) for r in able if r.rate >= MAY_BE_BEST * fastest]
    group = [advised, *(variant for variant in rivals if variant != advised)]
    regret = Regret(source.name, str(advice.loop), str(advised), str(advised), 0.0, len(group) - 1)
    if len(group) == 1:
        return regret
    sizes = results.compared_sizes
    record = _complete(contest.run(pool, source, plan, [group], sizes, TIME_LIMIT_S))
    if record.status != Status.OK or not record.launches:
        raise MachineError(f"{source.name}: {record.detail}")
    best = record.fastest(group)
    if best == advised:
        return regret
    ratio = record.ratio(best, advised)
    assert ratio is not None, "the two took part in the first launch"
    share = statistics.mean(_regret_in_halves(record, group, advised))
    low, high = (end - 1 if end else None for end in (ratio.low, ratio.high))
    return replace(regret, best=str(best), share=max(0.0, share), low=low, high=high)


def _regret_in_halves(
    record: "ContestRecord", group: "Sequence[Variant]", advised: "Variant"
) -> list[float]:
    """Return the regret in each half of the launches, of the path that is best in the other."""
    halves = [replace(record, launches=record.launches[i::2]) for i in (0, 1)]
    shares = []
    for chosen_in, measured_in in (halves, halves[::-1]):
        ratio = measured_in.ratio(chosen_in.fastest(group), advised)
        if ratio is not None:
            shares.append(ratio.estimate - 1)
    return shares


def _variant(result: "PathResult") -> "Variant":
    from mjbench.comparison.plan import Variant

    return Variant(result.path, result.options)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, one row per model and loop."""
    from mjbench.comparison import selection
    from mjbench.comparison.plan import ComparisonPlan
    from mjbench.paired.worker_pool import WorkerPool

    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", metavar="MODEL", help="default: all of ours")
    parser.add_argument(
        "--threads", default="", help="thread counts  [default: 1 and usable cores]"
    )
    parser.add_argument("--returns", default=Product.FINAL.value, choices=[*Product])
    options = parser.parse_args(arguments)
    measured: list[Regret] = []
    try:
        threads = [int(count) for count in options.threads.split(",") if count]
        plan = ComparisonPlan(
            selection.variants([], threads or None), returns=Product(options.returns)
        )
        with WorkerPool() as pool:
            for name in options.models or models.shipped():
                for regret in regrets(pool, models.resolve(name), plan):
                    measured.append(regret)
                    print(_row(regret), flush=True)
    except MjbenchError as error:
        sys.exit(f"advice: {error}")
    except KeyboardInterrupt:
        print("interrupted")
    if measured:
        shares = [100 * regret.share for regret in measured]
        print(f"regret: at most {max(shares):.1f} %, mean {statistics.mean(shares):.2f} %")


def _row(regret: Regret) -> str:
    better = ""
    if regret.best != regret.advised:
        better = f"; {regret.best} seems faster"
        if regret.low is not None and regret.high is not None:
            better += f", by {100 * regret.low:.1f} to {100 * regret.high:.1f} %"
    return (
        f"{regret.model:18} {regret.loop:6} {100 * regret.share:5.1f} %  {regret.advised}"
        f" (beside {regret.candidates} others){better}"
    )


if __name__ == "__main__":
    # Not this module's own `main`: see c_floor.
    from benchmarks import advice

    advice.main()
