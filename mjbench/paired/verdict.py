"""Launch two sides until it is certain which is faster: the loop around paired and stats."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError
from mjbench.instrument import stats
from mjbench.paired.protocol import Launch, Sizes, Target, TargetPair, WorkCheck
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import agreement


@dataclass(frozen=True)
class VerdictPlan:
    """What a verdict must be.

    Attributes:
      min_effect: smallest change of time that matters, such as 0.01.
      confidence: that a verdict is right, such as 0.99.
      precision: half-width of the interval at which to stop in any case.
      time_limit_s: seconds of launches after which to stop in any case.
      sizes: of a block's work.
    """

    min_effect: float = 0.01
    confidence: float = 0.99
    precision: float = 0.005
    time_limit_s: float = 60.0
    sizes: Sizes = field(default_factory=Sizes)

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-ready values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class PairedResult:
    """What came of a comparison.

    Attributes:
      old: the old side.
      new: the new side.
      status: `ok`, `input`, `failed` or `interrupted`.
      detail: one line, empty when ok.
      work_check: whether it was the same work; None where that was not reached.
      work: file of the old side's workload, which lasts as long as the pool.
      launches: what each launch measured.
      judgement: None without launches.
      seconds: from start to verdict, workers' start included.
    """

    old: Target
    new: Target
    status: str
    detail: str = ""
    work_check: WorkCheck | None = None
    launches: Sequence[Launch] = ()
    judgement: stats.Judgement | None = None
    seconds: float = 0.0
    work: Path | None = None

    @property
    def changed_work(self) -> bool:
        """Return whether counters or the result of a step changed beyond rounding."""
        return self.work_check is not None and changed(self.work_check)

    def as_result(self) -> dict[str, Any]:
        """Return what `--json` gives; what cannot be said is None."""
        judged = self.judgement
        return {
            "model": self.new.model.name,
            "path": self.new.path,
            "old": self.old.release.version,
            "new": self.new.release.version,
            "sides": [self.old.as_dict(), self.new.as_dict()],
            "status": self.status,
            "detail": self.detail,
            "verdict": judged.verdict if judged else None,
            "ratio": judged and interval(judged),
            "changed_work": self.changed_work if self.work_check else None,
            "work": self.work_check
            and {"old": dict(self.work_check.old), "new": dict(self.work_check.new)},
            "drift": self.work_check and self.work_check.drift,
            "diverged": self.work_check
            and dict(zip(("old", "new"), self.work_check.diverged, strict=True)),
            "nbatch": self.work_check and self.work_check.nbatch,
            "nstep": self.work_check and self.work_check.nstep,
            "launches": len(self.launches),
            "pairs": 2 * sum(len(launch.orders) for launch in self.launches),
            "seconds": self.seconds,
        }

    def as_record(self) -> dict[str, Any]:
        """Return the record of the run file: the result, with every launch's raw times."""
        launches = [launch.as_dict() for launch in self.launches]
        return {"type": "verdict", **self.as_result(), "samples": launches}


def changed(same: WorkCheck) -> bool:
    """Return whether two sides do other work: counters, or one step's result beyond rounding."""
    return bool(agreement.work_changes(same.old, same.new, same.drift, same.diverged))


def decide(
    pool: WorkerPool,
    old: Target,
    new: Target,
    plan: VerdictPlan,
    on_launch: Callable[[stats.Judgement], None] = lambda judged: None,
    clock: Callable[[], float] = time.monotonic,
) -> PairedResult:
    """Compare two sides until the verdict is certain, or time is up.

    A side that crashes, hangs or fails, and Ctrl-C, end in an outcome that says so, with what was
    measured until then.
    """
    begin = clock()
    launches: list[Launch] = []
    judged: stats.Judgement | None = None
    work_check: WorkCheck | None = None
    status, detail = "ok", ""
    pair: TargetPair | None = None
    try:
        pair = TargetPair(pool, old, new, plan.sizes)
        work_check = pair.work_check
        ready = clock()
        while judged is None or not judged.enough:
            launches.append(pair.launch())
            values = [launch.value for launch in launches]
            judged = stats.judge(values, plan.min_effect, plan.confidence, plan.precision)
            on_launch(judged)
            spent = clock() - ready
            if spent + spent / len(launches) > plan.time_limit_s:
                break
    except InputError as error:
        status, detail = "input", str(error)
    except MachineError as error:
        status, detail = "failed", str(error)
    except KeyboardInterrupt:
        status, detail = "interrupted", "interrupted"
    finally:
        if pair is not None:
            pair.close()
    work = pair.works[0] if pair is not None else None
    return PairedResult(
        old, new, status, detail, work_check, launches, judged, clock() - begin, work
    )


def interval(judged: stats.Judgement) -> dict[str, float | None]:
    """Return estimate, low and high, JSON-ready; the ends are None with too few launches."""
    known = math.isfinite(judged.high)
    ends = (judged.low, judged.high) if known else (None, None)
    return {"estimate": judged.ratio, "low": ends[0], "high": ends[1]}
