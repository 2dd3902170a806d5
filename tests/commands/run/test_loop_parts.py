"""The time of a loop is divided once, however short what was timed is."""

import multiprocessing.pool
from dataclasses import replace

import pytest

from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import step_clock
from mjbench.commands.run.loop_parts import Sample, longest_stay, loop_seconds, parts_of, untorn
from mjbench.commands.run.loop_time import shares_of
from mjbench.commands.run.py_spy import Frame, Thread, ThreadSamples
from mjbench.commands.run.source_loops import SourceLoop

LOOP = SourceLoop("train.py", 10, 20)
# What a clock says of calls that are shorter than what it costs to time them.
UNSEEN = CallTime("mj_step", 1, 1, Place("train.py", 12, "main"), LOOP, 9, 0.0, 0, 0, 9, 9)
STACK = [Frame("main", "train.py", 11)]
SAMPLE = Sample(ThreadSamples(Thread(1, 1, "MainThread"), [], 0.02), STACK, STACK, Activity.PYTHON)


@pytest.mark.parametrize(
    ("samples", "rest"), [(0, Activity.REST), (3, Activity.REST), (100, Activity.PYTHON)]
)
def test_calls_that_the_clock_did_not_see_leave_the_loop_to_the_rest(samples, rest):
    sampled = [SAMPLE] * samples
    seconds = loop_seconds(sampled, [UNSEEN])
    assert seconds > 0
    parts = [(part.activity, part.seconds) for part in parts_of(sampled, [UNSEEN], seconds, 0.0)]
    assert shares_of(parts, seconds) == pytest.approx({Activity.PHYSICS: 0.0, rest: 1.0})
    collected = parts_of(sampled, [UNSEEN], seconds, 0.1)
    assert sum(part.seconds for part in collected) == pytest.approx(seconds)


def test_between_tasks_of_a_pool_the_loop_of_its_worker_does_not_run() -> None:
    worker = Frame("worker", multiprocessing.pool.__file__, 125)
    of_map = [replace(worker, function="mapstar", line=48), *STACK]
    task = replace(SAMPLE, stack=[worker, *of_map], inner=of_map)
    stepping = replace(UNSEEN, last_ns=8_000_000_000)
    assert loop_seconds([SAMPLE] * 100, [stepping]) == pytest.approx(8.0)
    assert loop_seconds([task] * 100, [stepping]) == pytest.approx(2.0)


def test_a_profiler_that_fell_behind_says_little_of_how_long_a_loop_runs() -> None:
    thread = replace(SAMPLE.thread, least_s=0.01)
    timed = replace(UNSEEN, last_ns=1_000_000_000)
    assert loop_seconds([replace(SAMPLE, thread=thread)] * 100, [timed]) == pytest.approx(1.0)
    assert loop_seconds([SAMPLE] * 100, [timed]) == pytest.approx(2.0)


def test_what_a_function_frees_when_it_returns_is_of_the_line_that_created_it() -> None:
    load, caller = Place("episode.py", 3, "episode"), Place("train.py", 11, "main")
    lines = [load.position, caller.position]
    loaded = replace(UNSEEN, callee="compile", place=load, seconds=1.0, lines=lines)
    within = replace(SAMPLE, inner=[*STACK, Frame("episode", "episode.py", 5)])
    calls_numpy = replace(SAMPLE, activity=Activity.NUMPY)
    seen = [SAMPLE] * 60 + [within] * 20 + [calls_numpy] * 20
    parts = parts_of(seen, [loaded], 2.0, 0.0)
    shares = shares_of(((part.place and part.place.position, part.seconds) for part in parts), 2.0)
    assert shares[load.position] == pytest.approx(0.5 + 0.3)
    assert shares[caller.position] == pytest.approx(0.1)


def test_a_run_of_samples_on_one_line_is_a_stay_unless_the_line_is_often_seen() -> None:
    saving = replace(SAMPLE, inner=[Frame("main", "train.py", 14)])
    resting = replace(SAMPLE, activity=Activity.SLEEPING)
    stay = longest_stay([resting] * 50 + [saving] * 4 + [resting] * 50)
    assert stay is not None
    assert (stay.place.line, stay.seconds) == (14, pytest.approx(0.08))
    assert longest_stay([saving] * 4 + [resting] * 2) is None


def test_a_line_that_the_program_came_to_while_its_stack_was_read_does_not_step() -> None:
    engine = Frame("call", step_clock.__file__, 100)

    def seen(line: int) -> Sample:
        stack = [Frame("main", "train.py", line), engine]
        return replace(SAMPLE, stack=stack, inner=stack, activity=Activity.PHYSICS)

    before, step, after = untorn([seen(11), seen(12), seen(13)], [UNSEEN])
    assert [each.activity for each in (before, step, after)] == [
        Activity.PYTHON,
        Activity.PHYSICS,
        Activity.PYTHON,
    ]
    assert [len(each.inner) for each in (before, step, after)] == [1, 2, 1]
    assert untorn([seen(11)], []) == [seen(11)], "which lines step is not known"
