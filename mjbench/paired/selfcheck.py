"""How often paired comparison is wrong, slow or undecided on this machine, now.

Both sides of a trial are the same release, path and work; the new one may do a known share of the
simulations once more. Whatever a verdict says beyond that is an error of the instrument.
"""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from mjbench.errors import InputError, MachineError
from mjbench.instrument import child
from mjbench.instrument.runs import Record
from mjbench.paired import verdict
from mjbench.paired.protocol import Sizes, Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource

# The most simulations of a block: a slowdown is a whole number of them.
MOST_NBATCH = 200


@dataclass(frozen=True)
class Arm:
    """A model with a slowdown of known size; 0 is an A/A comparison."""

    model: ModelSource
    slowdown: float

    @property
    def sizes(self) -> Sizes:
        """The fewest simulations of which the slowdown is a whole number; the default ones for 0.

        Raises:
          InputError: there is no such number.
        """
        if self.slowdown == 0:
            return Sizes()
        share = Fraction(self.slowdown).limit_denominator(MOST_NBATCH)
        if share <= 0 or abs(share - self.slowdown) > 1e-9:
            raise InputError(
                f"a slowdown of {100 * self.slowdown:g} % is no whole number of at most"
                f" {MOST_NBATCH} simulations"
            )
        return Sizes(nbatch=share.denominator)


def trial(pool: WorkerPool, arm: Arm, plan: verdict.VerdictPlan) -> Record:
    """Run one trial; return its record.

    Raises:
      MachineError: a side failed.
      KeyboardInterrupt: interrupted.
    """
    side = Target(installs.parse_release(installs.INSTALLED), arm.model)
    new = replace(side, slowdown=arm.slowdown)
    outcome = verdict.decide(pool, side, new, replace(plan, sizes=arm.sizes))
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if outcome.status != "ok" or outcome.judgement is None:
        raise (InputError if outcome.status == "input" else MachineError)(outcome.detail)
    judged = outcome.judgement
    return {
        "type": "trial",
        "model": arm.model.name,
        "slowdown": arm.slowdown,
        "verdict": judged.verdict,
        **verdict.interval(judged),
        "seconds": outcome.seconds,
        "launches": [round(launch.value, 7) for launch in outcome.launches],
    }


def run(
    pool: WorkerPool,
    arms: Sequence[Arm],
    trials: int,
    plan: verdict.VerdictPlan,
    on_trial: Callable[[Record], None],
) -> None:
    """Run the trials of all arms in turns, so that a change of the machine hits all of them."""
    for _ in range(trials):
        for arm in arms:
            on_trial(trial(pool, arm, plan))


def summary(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Return, for each model and slowdown, what the trials say.

    Keys: model, slowdown, trials, detected (share called slower), wrong (share called faster, or
    anything but same or inconclusive where there is no slowdown), missed (share called the same),
    inconclusive, covered (share of intervals that hold the truth), error (mean of estimate less
    truth), seconds (mean), launches (mean), launch_sd (standard deviation of launches, of the
    logarithm).
    """
    groups: dict[tuple[str, float], list[Record]] = {}
    for record in records:
        if record["type"] == "trial":
            groups.setdefault((record["model"], record["slowdown"]), []).append(record)
    return [_row(model, truth, group) for (model, truth), group in sorted(groups.items())]


def _row(model: str, truth: float, group: Sequence[Record]) -> dict[str, Any]:
    def share(test: Callable[[Record], bool]) -> float:
        return sum(map(test, group)) / len(group)

    values = [record["launches"] for record in group]
    deviations = [np.var(v, ddof=1) for v in values if len(v) > 1]
    return {
        "model": model,
        "slowdown": truth,
        "trials": len(group),
        "detected": share(lambda r: r["verdict"] == "slower"),
        "wrong": share(lambda r: r["verdict"] in (("faster",) if truth else ("faster", "slower"))),
        "missed": share(lambda r: r["verdict"] == "same" and truth > 0),
        "inconclusive": share(lambda r: r["verdict"] == "inconclusive"),
        "covered": share(lambda r: r["low"] is None or r["low"] <= 1 + truth <= r["high"]),
        "error": float(np.mean([r["estimate"] - 1 - truth for r in group])),
        "seconds": float(np.mean([r["seconds"] for r in group])),
        "launches": float(np.mean([len(v) for v in values])),
        "launch_sd": float(np.sqrt(np.mean(deviations))) if deviations else None,
    }


@contextlib.contextmanager
def neighbour(busy: bool) -> Iterator[None]:
    """Keep the last of this process's cores busy while the block runs, if asked to."""
    if not busy:
        yield
        return
    if not hasattr(os, "sched_getaffinity"):
        raise InputError("--busy needs to choose the core of a process, which this system cannot")
    core = max(os.sched_getaffinity(0))
    code = f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: sum(range(100000))"
    spinner = subprocess.Popen([sys.executable, "-c", code], preexec_fn=child.die_with_parent)
    try:
        yield
    finally:
        spinner.kill()
        spinner.wait()
