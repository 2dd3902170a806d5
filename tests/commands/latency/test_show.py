"""What the latency of ticks comes to."""

from collections.abc import Sequence

import numpy as np
import pytest
from drawn_charts import drawn
from example_records import WORK

from mjbench.commands.latency import measure as latency
from mjbench.commands.latency import show as report
from mjbench.commands.latency.measure import LatencyRow, Pace
from mjbench.results.content import Tone


def row(pace: Pace, latency_ns: Sequence[float], **features: np.ndarray) -> LatencyRow:
    rate_hz = 500.0 if pace == Pace.PACED else None
    ns = np.asarray(latency_ns)
    return latency.row(ns, features, None, 0.002, rate_hz, model="m", work=WORK)


def test_what_slow_steps_share_has_a_remedy() -> None:
    assert set(report._REMEDIES) == set(latency._FEATURES)
    latency_ns = [10_000.0] * 990 + [5e6] * 10
    late_us = {"µs of late start": np.array([1.0] * 990 + [4000.0] * 10)}
    (section,) = report.sections([row(Pace.PACED, latency_ns, **late_us)])
    assert section.notes[0].startswith("Slow ticks, paced: 4000 µs of late start")
    assert section.notes[1].startswith("µs of late start: other programs took the core")
    (unknown,) = report.sections([row(Pace.PACED, latency_ns)])
    assert unknown.notes[-1] == "`mjbench doctor` says what delays programs on this machine"


def test_latency_is_drawn_as_far_as_there_are_steps() -> None:
    ns = np.linspace(10_000, 20_000, 999).tolist()
    rows = [
        row(Pace.FREE, [*ns, 3e6]),
        row(Pace.PACED, [*ns, 20_000.0]),
    ]
    (section,) = report.sections(rows)
    assert [c.tone for c in section.conclusions] == [Tone.BAD, Tone.GOOD]
    assert "1 of 1,000 ticks missed 2 ms" in section.conclusions[0].text
    assert section.facts[-1].startswith(
        "Misses rarer than 1 in 333 (free-running), 1 in 333 (paced)"
    )
    (figure,) = section.figures
    steps = [row[0] for row in figure.data.rows]
    assert max(float(step or 0) for step in steps) == pytest.approx(1000, rel=0.3)
    assert "free-running" in drawn(section)[0]
