"""Invented verdicts, as run files hold them."""

import math
from dataclasses import replace
from typing import Any

from mjbench.interval import Interval
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import LaunchRow, TargetRow, VerdictRecord
from mjbench.releases.placement import AS_SHIPPED, PlacementPair
from mjbench.status import Status

SIDES = tuple(
    TargetRow(
        release=release,
        model="m",
        path="python_loop",
        options={},
        model_options={},
        build=f"{release}-cpython-311-x86_64-numpy2.4.6",
    )
    for release in ("1.0.0", "2.0.0")
)
SAME = VerdictRecord(
    model="m",
    path="python_loop",
    old="1.0.0",
    new="2.0.0",
    sides=SIDES,
    status=Status.OK,
    verdict=Verdict.SAME,
    ratio=Interval(1.0, 0.996, 1.004),
    e_slower=0.1,
    e_faster=0.1,
    changed_work=False,
    nbatch=4,
    nstep=50,
    launches=10,
)
SLOWER = replace(SAME, verdict=Verdict.SLOWER, ratio=Interval(1.03, 1.02, 1.04), e_slower=1e6)
FASTER = replace(SAME, verdict=Verdict.FASTER, ratio=Interval(0.97, 0.96, 0.98), e_faster=1e6)
OPEN = replace(SAME, verdict=Verdict.INCONCLUSIVE, ratio=Interval(1.0, 0.98, 1.02))
FAILED = replace(
    SAME, status=Status.CRASHED, detail="signal 11", verdict=None, ratio=None, nbatch=None
)


def of_model(verdict: VerdictRecord, model: str, **fields: Any) -> VerdictRecord:
    """Return the verdict of another model."""
    sides = [replace(side, model=model) for side in verdict.sides]
    return replace(verdict, model=model, sides=sides, **fields)


def launch(log_ratio: float, placements: PlacementPair = AS_SHIPPED) -> LaunchRow:
    """Return a launch in which the candidate takes longer by a log ratio."""
    slow = round(1_000_000_000 * math.exp(log_ratio))
    ns = [[1_000_000_000, slow, slow, 1_000_000_000]]
    return LaunchRow(0, None, ["ABBA"], ns, placements, [1])
