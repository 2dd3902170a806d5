"""What a program does elsewhere while one of its loops waits."""

from dataclasses import replace

import pytest

from mjbench.commands.run import measure
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.loop_time import LoopTime
from mjbench.commands.run.source_loops import SourceLoop

LOOP = SourceLoop("train.py", 10, 20)


def waiting(seconds):
    return LoopTime(LOOP, [], ["MainThread"], [1], True, 400, seconds, {}, {}, [], [])


def steps(pid, seconds, span_s, thread=1, loop=None):
    place = Place("worker.py", 3, "work")
    return CallTime("mj_step", pid, thread, place, loop, 9, seconds, 0, int(1e9 * span_s), 9, 9)


def test_steps_that_others_take_before_or_after_a_loop_do_not_count_for_it(monkeypatch):
    monkeypatch.setattr(measure.machine, "usable_cores", lambda: 2)
    others = [steps(pid, 8.0, span_s=20.0) for pid in (2, 3, 4)]
    assert measure.others_busy_s(waiting(30.0), [], others, {LOOP}) == pytest.approx(12.0)
    assert measure.others_busy_s(waiting(5.0), [], others, {LOOP}) == pytest.approx(3.0)
    assert measure.others_busy_s(waiting(5.0), [], others[:1], {LOOP}) == pytest.approx(2.0)


def test_threads_that_step_while_a_loop_waits_count_and_the_loop_itself_does_not(monkeypatch):
    monkeypatch.setattr(measure.machine, "usable_cores", lambda: 2)
    threads = [steps(1, 4.0, 10.0, thread) for thread in (2, 3, 4)]
    own = steps(1, 6.0, 10.0, loop=LOOP)
    assert measure.others_busy_s(waiting(10.0), [], [own], {LOOP}) == 0
    assert measure.others_busy_s(waiting(10.0), [], [own, *threads], {LOOP}) == pytest.approx(6.0)


def test_what_another_process_computes_counts_without_any_step():
    of_worker = {Activity.NUMPY: 0.75, Activity.PROCESSES: 0.25}
    worker = replace(waiting(8.0), pids=[2], in_main=False, activities=of_worker)
    main = waiting(10.0)
    assert measure.others_busy_s(main, [main, worker], [], {LOOP}) == pytest.approx(6.0)
