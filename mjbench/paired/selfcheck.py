"""How often paired comparison is wrong, slow or undecided on this machine, now.

Both targets of a trial are the same release, path and work; the candidate may do a known share of
the simulations twice. Whatever a verdict says beyond that is an error of the instrument.
"""

import contextlib
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from mjbench.errors import InputError, MachineError, MjbenchError
from mjbench.instrument import child, platforms
from mjbench.paired import verdict
from mjbench.paired.outcomes import Verdict
from mjbench.paired.preparation import Sizes
from mjbench.paired.records import SelfcheckRow, TrialRecord
from mjbench.paired.targets import Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# Simulations of a block, at most: a slowdown is a whole number of them.
MAX_NBATCH = 200


@dataclass(frozen=True)
class Case:
    """A model with a slowdown of known size.

    Attributes:
      model: to step.
      slowdown: share of the work that is done once more; 0 is an A/A comparison.
      sizes: the fewest simulations of which the slowdown is a whole number; the usual ones for 0.
    """

    model: ModelSource
    slowdown: float
    sizes: Sizes

    @classmethod
    def create(cls, model: ModelSource, slowdown: float) -> "Case":
        """Return the case of a slowdown, such as 0.01.

        Raises:
          InputError: it is not a whole number of at most MAX_NBATCH simulations.
        """
        if slowdown == 0:
            return cls(model, slowdown, Sizes())
        share = Fraction(slowdown).limit_denominator(MAX_NBATCH)
        if share <= 0 or abs(share - slowdown) > 1e-9:
            raise InputError(
                f"cannot inject a slowdown of {100 * slowdown:g} %: it must be a whole number of at"
                f" most {MAX_NBATCH} simulations, such as 0.5 % (1 of 200) or 1 % (1 of 100)"
            )
        return cls(model, slowdown, Sizes(nbatch=share.denominator))


def trial(pool: WorkerPool, case: Case, plan: verdict.VerdictPlan) -> TrialRecord:
    """Run one trial; return its record.

    Raises:
      InputError: a target cannot do the work.
      MachineError: a target failed.
      KeyboardInterrupt: interrupted.
    """
    baseline = Target(installs.parse_release(installs.INSTALLED), case.model)
    candidate = replace(baseline, slowdown=case.slowdown)
    result = verdict.decide(pool, baseline, candidate, replace(plan, sizes=case.sizes))
    if result.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    if result.status == Status.OK and result.judgement is None:
        raise MachineError(result.detail)
    if result.status != Status.OK or result.judgement is None:
        raise (InputError if result.status == Status.INPUT else MachineError)(result.detail)
    ratio = verdict.ratio_of(result.judgement)
    return TrialRecord(
        model=case.model.name,
        slowdown=case.slowdown,
        verdict=result.judgement.verdict,
        estimate=ratio.estimate,
        low=ratio.low,
        high=ratio.high,
        seconds=result.seconds,
        launches=[round(launch.log_ratio, 7) for launch in result.launches],
    )


def remaining(cases: Sequence[Case], trials: int, records: Sequence[TrialRecord]) -> Iterator[Case]:
    """Yield a case for each trial to do, in turns, so that a change of the machine hits all.

    Args:
      cases: to try.
      trials: of each case.
      records: of trials that were done before.
    """
    done = Counter((record.model, record.slowdown) for record in records)
    for turn in range(trials):
        for case in cases:
            if done[case.model.name, case.slowdown] <= turn:
                yield case


def run(
    pool: WorkerPool,
    cases: Iterable[Case],
    plan: verdict.VerdictPlan,
    on_trial: Callable[[TrialRecord], None],
    on_failure: Callable[[ModelSource, MjbenchError], None],
) -> None:
    """Run a trial of each case, one after the other.

    A model that cannot do the work, or whose target failed, is not tried again; others are.

    Args:
      pool: starts the processes.
      cases: of the trials.
      plan: of every verdict; its sizes are replaced by those of the case.
      on_trial: called after each trial.
      on_failure: called with each model that is not tried again, and why.

    Raises:
      KeyboardInterrupt: interrupted.
    """
    failed: set[ModelSource] = set()
    for case in cases:
        if case.model in failed:
            continue
        try:
            record = trial(pool, case, plan)
        except (InputError, MachineError) as error:
            failed.add(case.model)
            on_failure(case.model, error)
        else:
            on_trial(record)


def summary(trials: Sequence[TrialRecord]) -> list[SelfcheckRow]:
    """Return what the trials say, a row for each model and slowdown, sorted by both."""
    groups: dict[tuple[str, float], list[TrialRecord]] = {}
    for record in trials:
        groups.setdefault((record.model, record.slowdown), []).append(record)
    return [_row(model, slowdown, group) for (model, slowdown), group in sorted(groups.items())]


def _row(model: str, slowdown: float, trials: Sequence[TrialRecord]) -> SelfcheckRow:
    def share(test: Callable[[TrialRecord], bool]) -> float:
        return sum(map(test, trials)) / len(trials)

    wrong = {Verdict.FASTER} if slowdown else {Verdict.FASTER, Verdict.SLOWER}
    variances = [np.var(t.launches, ddof=1) for t in trials if len(t.launches) > 1]
    return SelfcheckRow(
        model=model,
        slowdown=slowdown,
        trials=len(trials),
        detected=share(lambda t: t.verdict == Verdict.SLOWER),
        wrong=share(lambda t: t.verdict in wrong),
        missed=share(lambda t: t.verdict == Verdict.SAME and slowdown > 0),
        inconclusive=share(lambda t: t.verdict == Verdict.INCONCLUSIVE),
        covered=share(lambda t: _covers(t, 1 + slowdown)),
        error=float(np.mean([t.estimate - 1 - slowdown for t in trials])),
        seconds=float(np.mean([t.seconds for t in trials])),
        launches=float(np.mean([len(t.launches) for t in trials])),
        launch_sd=float(np.sqrt(np.mean(variances))) if variances else None,
    )


def _covers(trial: TrialRecord, truth: float) -> bool:
    """Return whether a trial's interval holds the true ratio; a missing end is no bound."""
    return (trial.low is None or trial.low <= truth) and (trial.high is None or truth <= trial.high)


@contextlib.contextmanager
def busy_neighbour_core() -> Iterator[None]:
    """Keep the last of this process's cores busy while the block runs.

    Raises:
      MachineError: this system cannot keep a process on one core.
    """
    allowed = platforms.affinity()
    if not allowed:
        raise MachineError("--busy cannot work here: this system cannot keep a process on one core")
    core = max(allowed)
    code = f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: sum(range(100000))"
    parent = os.getpid()
    spinner = child.Child(  # in a session of its own: Ctrl-C is not for it
        [sys.executable, "-c", code],
        stdin=subprocess.DEVNULL,
        preexec_fn=lambda: child.die_with_parent(parent),
    )
    try:
        yield
    finally:
        spinner.end()
