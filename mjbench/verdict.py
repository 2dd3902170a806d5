"""Launch two sides until it is certain which is faster: the loop around paired and stats."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mjbench import agreement, stats
from mjbench.errors import InputError, MachineError
from mjbench.fleet import Fleet
from mjbench.paired import Launch, Pair, Same, Side, Sizes


@dataclass(frozen=True)
class Plan:
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
class Outcome:
    """What came of a comparison.

    Attributes:
      old: the old side.
      new: the new side.
      status: `ok`, `input`, `failed` or `interrupted`.
      detail: one line, empty when ok.
      same: whether it was the same work; None where that was not reached.
      work: file of the old side's workload, which lasts as long as the fleet.
      launches: what each launch measured.
      judgement: None without launches.
      seconds: from start to verdict, workers' start included.
    """

    old: Side
    new: Side
    status: str
    detail: str = ""
    same: Same | None = None
    launches: Sequence[Launch] = ()
    judgement: stats.Judgement | None = None
    seconds: float = 0.0
    work: Path | None = None

    @property
    def changed_work(self) -> bool:
        """Return whether counters or the result of a step changed beyond rounding."""
        return self.same is not None and changed(self.same)

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
            "changed_work": self.changed_work if self.same else None,
            "work": self.same and {"old": dict(self.same.old), "new": dict(self.same.new)},
            "drift": self.same and self.same.drift,
            "diverged": self.same and dict(zip(("old", "new"), self.same.diverged, strict=True)),
            "nbatch": self.same and self.same.nbatch,
            "nstep": self.same and self.same.nstep,
            "launches": len(self.launches),
            "pairs": 2 * sum(len(launch.orders) for launch in self.launches),
            "seconds": self.seconds,
        }

    def as_record(self) -> dict[str, Any]:
        """Return the record of the run file: the result, with every launch's raw times."""
        launches = [launch.as_dict() for launch in self.launches]
        return {"type": "verdict", **self.as_result(), "samples": launches}


def changed(same: Same) -> bool:
    """Return whether two sides do other work: counters, or one step's result beyond rounding."""
    return bool(agreement.work_changes(same.old, same.new, same.drift, same.diverged))


def decide(
    fleet: Fleet,
    old: Side,
    new: Side,
    plan: Plan,
    on_launch: Callable[[stats.Judgement], None] = lambda judged: None,
    clock: Callable[[], float] = time.monotonic,
) -> Outcome:
    """Compare two sides until the verdict is certain, or time is up.

    A side that crashes, hangs or fails, and Ctrl-C, end in an outcome that says so, with what was
    measured until then.
    """
    begin = clock()
    launches: list[Launch] = []
    judged: stats.Judgement | None = None
    same: Same | None = None
    status, detail = "ok", ""
    pair: Pair | None = None
    try:
        pair = Pair(fleet, old, new, plan.sizes)
        same = pair.same
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
    return Outcome(old, new, status, detail, same, launches, judged, clock() - begin, work)


def interval(judged: stats.Judgement) -> dict[str, float | None]:
    """Return estimate, low and high, JSON-ready; the ends are None with too few launches."""
    known = math.isfinite(judged.high)
    ends = (judged.low, judged.high) if known else (None, None)
    return {"estimate": judged.ratio, "low": ends[0], "high": ends[1]}
