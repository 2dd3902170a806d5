"""What a program's row says of its loops."""

import pytest

from mjbench.program import records
from mjbench.program.activities import Place
from mjbench.program.calls import CallTime
from mjbench.program.loop_time import LoopTime
from mjbench.program.source_loops import SourceLoop

LOOP = SourceLoop("train.py", 10, 20)


def waiting(seconds):
    return LoopTime(LOOP, [], ["MainThread"], [1], True, 400, seconds, {}, {}, [], [], 0.0)


def steps(pid, seconds, span_s):
    place = Place("worker.py", 3, "work")
    return CallTime("mj_step", pid, 1, place, None, 9, seconds, 0, int(1e9 * span_s), 9, 9)


def test_steps_that_others_take_before_or_after_a_loop_do_not_count_for_it(monkeypatch):
    monkeypatch.setattr(records.machine, "usable_cores", lambda: 2)
    others = [steps(pid, 8.0, span_s=20.0) for pid in (2, 3, 4)]
    assert records.others_busy_s(waiting(30.0), others) == pytest.approx(12.0)
    assert records.others_busy_s(waiting(5.0), others) == pytest.approx(3.0)
    assert records.others_busy_s(waiting(5.0), others[:1]) == pytest.approx(2.0)
    assert records.others_busy_s(waiting(5.0), [steps(1, 4.0, 5.0)]) == 0
