"""What a program does elsewhere while one of its loops waits, and what a second run shows."""

import math
from dataclasses import replace

import pytest

from mjbench.commands.run import measure
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.launch import Program, ProgramObservation
from mjbench.commands.run.loop_time import LoopTime
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.commands.run.step_times import Durations, StepTimes
from mjbench.commands.run.thread_pools import ThreadPools

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


POOLS = ThreadPools([2, 3], 2, 2, {Activity.NUMPY: "OPENBLAS_NUM_THREADS"})


def seen(steps_per_s, pools=None):
    iteration = Durations(100, 1e6, 1e6, 1e6, mean_error=steps_per_s / 1000)
    times = StepTimes(2, 1.0, 1, steps_per_s, 1.0, None, iteration, False, {}, 0.0, 0, 0.0, 0.0)
    return ProgramObservation(10.0, 1, [], [times, replace(times, pid=3)], 100, pools=pools)


def test_a_program_with_too_many_threads_runs_again_with_one_in_each_process(monkeypatch):
    runs = iter([seen(100.0, POOLS), seen(250.0)])
    asked = []

    def run(*arguments):
        asked.append(arguments)
        return next(runs)

    monkeypatch.setattr(measure.launch, "run", run)
    program = Program(["train.py"])
    pools = measure.observed(program, 3.0).pools
    assert pools.speedup == pytest.approx(2.5)
    assert pools.relative_error == pytest.approx(math.hypot(0.1, 0.25))
    assert [arguments[1] for arguments in asked] == [3.0, 3.0]
    assert asked[1][-1] == {"OPENBLAS_NUM_THREADS": "1"}


@pytest.mark.parametrize("first", [seen(100.0), seen(0.0, POOLS)])
def test_no_other_program_runs_twice(monkeypatch, first):
    monkeypatch.setattr(measure.launch, "run", lambda *arguments: first)
    assert measure.observed(Program(["train.py"]), None) is first
