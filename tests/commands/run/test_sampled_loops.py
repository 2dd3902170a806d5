"""Samples become shares of a loop's time."""

import importlib
import multiprocessing.queues
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from mjbench.commands.lint import rules as lint_rules
from mjbench.commands.run import activities, sampled_loops, source_loops
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import step_clock
from mjbench.commands.run.hook.call_clock import COMPILE, DISPATCH, PROCESS_START
from mjbench.commands.run.py_spy import Frame, Thread, ThreadSamples
from mjbench.commands.run.source_loops import SourceLoop

SOURCE = """\
def observe():
    total = 0
    return total

def main():
    setup()
    for _ in range(3):
        step()
        observe()

main()
"""
ENGINE = Frame("step", step_clock.__file__, 100)


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    activities.shown_path.cache_clear()
    (tmp_path / "program.py").write_text(SOURCE)
    return str(tmp_path / "program.py")


def stacks(file):
    """Return stacks of the program: setting up, stepping, observing."""
    module, main = Frame("<module>", file, 11), Frame("main", file, 8)
    return {
        "setup": [module, Frame("main", file, 6)],
        "step": [module, main, ENGINE],
        "observe": [module, Frame("main", file, 9), Frame("observe", file, 2)],
    }


def samples(stacks, pid=1, tid=1):
    return ThreadSamples(Thread(pid, tid, "MainThread"), stacks, 0.1)


def test_shares_of_a_loop_sum_to_one(file):
    of = stacks(file)
    seen = [of["setup"]] * 5 + [of["step"]] * 7 + [of["observe"]] * 3
    (time,) = sampled_loops.loop_times([samples(seen)], main_pid=1)
    assert (time.loop.file, time.loop.first, time.loop.last) == ("program.py", 7, 9)
    assert time.samples == 10
    assert time.seconds == pytest.approx(1.0)
    assert time.in_main
    assert time.activities == pytest.approx({Activity.PHYSICS: 0.7, Activity.PYTHON: 0.3})
    assert time.own_files == ["program.py"]
    assert time.error(0.3) == pytest.approx((0.3 * 0.7 / 10) ** 0.5)


@pytest.mark.parametrize("module", [step_clock, lint_rules])
def test_loops_of_mjbench_are_never_the_programs(file, module):
    lines = Path(module.__file__).read_text().count("\n")
    line = next(i for i in range(lines) if source_loops.outermost_loop(module.__file__, i))
    within = [Frame("<module>", file, 6), Frame("loops", module.__file__, line), ENGINE]
    assert sampled_loops.loop_times([samples([within] * 9)], main_pid=1) == []
    (outside,) = sampled_loops.outside_loops([samples([within] * 9)], 1, [], wall_s=0.9)
    assert outside.place.position == ("program.py", 6)


def test_a_file_of_two_installs_of_a_package_is_one_file(tmp_path):
    seen = []
    for pid, environment in enumerate(("first", "second"), start=1):
        file = tmp_path / environment / "site-packages" / "package" / "program.py"
        file.parent.mkdir(parents=True)
        file.write_text(SOURCE)
        seen.append(samples([stacks(str(file))["step"]] * 2, pid, pid))
    (time,) = sampled_loops.loop_times(seen, main_pid=1)
    assert (time.loop.file, time.pids, time.samples) == ("package/program.py", [1, 2], 4)


def test_lines_are_those_of_the_users_code_with_their_text(file):
    of = stacks(file)
    (time,) = sampled_loops.loop_times([samples([of["step"]] * 7 + [of["observe"]] * 3)], 1)
    step, observe = time.lines
    assert (str(step.place), step.place.text) == ("program.py:8", "step()")
    assert step.share == pytest.approx(0.7)
    assert (observe.place.function, observe.place.line) == ("observe", 2)
    assert observe.main_activity == Activity.PYTHON


def test_a_line_names_the_package_that_it_calls(file):
    package = Frame("step", "/env/lib/python3.11/site-packages/gymnasium/core.py", 5)
    inner = Frame("f", "/env/lib/python3.11/site-packages/numpy/x.py", 7)
    call = [Frame("main", file, 8), package, inner]
    (time,) = sampled_loops.loop_times([samples([call] * 3 + [stacks(file)["step"]])], 1)
    assert time.lines[0].package == "gymnasium"
    assert [str(line.place) for line in time.inner_functions] == ["numpy/x.py:7"]
    assert time.inner_functions[0].share == pytest.approx(0.75)


def test_a_loop_without_physics_is_left_out(file):
    of = stacks(file)
    assert sampled_loops.loop_times([samples([of["observe"]] * 5)], 1) == []


def test_a_process_that_is_known_to_step_has_its_longest_loop(file):
    (time,) = sampled_loops.loop_times([samples([stacks(file)["observe"]] * 30)], 1, {1})
    assert not time.has_physics
    few = [samples([stacks(file)["observe"]] * 29)]
    assert sampled_loops.loop_times(few, 1, {1}) == []


def test_a_loop_that_waits_for_processes_that_step_comes_first(file):
    waiting = [Frame("main", file, 9), Frame("recv", _connection(), 250)]
    workers = [samples([stacks(file)["step"]] * 4, pid, pid) for pid in (2, 3)]
    other = samples([[Frame("other", file, 8), Frame("recv", _connection(), 250)]] * 5)
    (both,) = sampled_loops.loop_times([other, *workers], 1)
    assert both.pids == [1, 2, 3]
    assert both.activities[Activity.PROCESSES] == pytest.approx(5 / 13)
    assert waiting[0].file == file


@pytest.mark.parametrize("forks", [True, False])
def test_a_pool_of_threads_is_none_of_processes(file, forks):
    """The caller of `ThreadPool.map` waits as that of `Pool.map` does."""
    pool, process = (
        importlib.import_module(f"multiprocessing.{name}").__file__ for name in ("pool", "process")
    )
    waiting = [Frame("main", file, 9), Frame("ApplyResult.wait", pool, 762)]
    begins = [Frame("BaseProcess._bootstrap", process, 314)] if forks else []
    steps = [Frame("worker", pool, 125), *stacks(file)["step"][1:]]
    worker = samples([[*begins, *steps]] * 4, 2 if forks else 1, 2)
    (time,) = sampled_loops.loop_times([samples([waiting] * 5), worker], 1)
    waits_for = Activity.PROCESSES if forks else Activity.THREADS
    assert time.activities == pytest.approx({waits_for: 5 / 9, Activity.PHYSICS: 4 / 9})


@pytest.mark.parametrize(
    ("text", "loops"), [("step()", [(7, 9), (13, 14)]), ("worker.join()", [(13, 14)])]
)
def test_a_loop_that_waits_for_threads_that_step_comes_first_unless_it_joins_them(
    file, text, loops
):
    Path(file).write_text(f"{SOURCE.replace('step()', text)}\nfor _ in range(9):\n    step()\n")
    waiting = [Frame("main", file, 8), Frame("wait", threading.__file__, 320)]
    stepping = [Frame("work", file, 14), ENGINE]
    threads = [samples([waiting] * 40), samples([stepping] * 40, 1, 2)]
    times = sampled_loops.loop_times(threads, 1, {1})
    assert [(time.loop.first, time.loop.last) for time in times] == loops


def test_many_workers_do_not_hide_a_short_loop_of_the_main_process(file):
    Path(file).write_text(f"{SOURCE}\nfor _ in range(9):\n    step()\n")
    stepping = [Frame("work", file, 14), ENGINE]
    workers = [samples([stepping] * 40, pid, pid) for pid in range(2, 10)]
    times = sampled_loops.loop_times([samples([stacks(file)["step"]] * 4), *workers], 1)
    assert [time.in_main for time in times] == [True, False]


def test_a_forked_process_has_loops_of_its_own(file):
    import multiprocessing.process

    start = Frame("main", file, 9)
    bootstrap = Frame("BaseProcess._bootstrap", multiprocessing.process.__file__, 314)
    forked = [start, bootstrap, *stacks(file)["step"]]
    elsewhere = [start, bootstrap, Frame("other", file, 2), ENGINE]
    (time,) = sampled_loops.loop_times([samples([forked, elsewhere], 2, 2)], 1)
    assert (time.samples, time.loop.first) == (1, 7)


def test_a_model_is_built_by_the_outermost_line_that_does_not_step(file):
    building = "/lib/python3/site-packages/dm_control/mjcf/element.py"
    module, main = Frame("<module>", file, 11), Frame("main", file, 9)
    built = [module, main, Frame("observe", file, 2), Frame("add", building, 5)]
    (time,) = sampled_loops.loop_times([samples([built] * 3 + [stacks(file)["step"]])], 1)
    assert time.building.place.line == 9
    assert time.building.share == pytest.approx(0.75)


def test_a_line_that_also_waits_for_others_does_more_than_build(file):
    element = Frame("add", "/lib/python3/site-packages/dm_control/mjcf/element.py", 5)
    whole = [Frame("main", file, 9)]
    built = [*whole, Frame("observe", file, 2), element]
    waits = [*whole, Frame("step", file, 3), Frame("_recv", _connection(), 9)]
    seen = [built] * 30 + [waits] * 70 + [stacks(file)["step"]] * 10
    (time,) = sampled_loops.loop_times([samples(seen)], 1)
    assert time.building.place.line == 2


def test_time_of_a_line_that_builds_for_several_lines_counts_once(file):
    """Line 2 builds for line 9, which does nothing else, and for line 8, which also steps."""
    element = Frame("add", "/lib/python3/site-packages/dm_control/mjcf/element.py", 5)
    built = [Frame("observe", file, 2), element]
    for_itself, for_step = ([Frame("main", file, line), *built] for line in (9, 8))
    seen = [for_itself] * 40 + [for_step] * 60 + [stacks(file)["step"]] * 100
    (time,) = sampled_loops.loop_times([samples(seen)], 1)
    assert time.building.place.line == 2
    assert time.building.activities == {Activity.BUILDING: pytest.approx(0.5)}


def test_samples_at_several_rates_count_for_their_time(file):
    of = stacks(file)
    dense = ThreadSamples(Thread(1, 1, "MainThread"), [of["step"]] * 6, 0.1)
    sparse = ThreadSamples(Thread(1, 1, "MainThread"), [of["observe"]], 0.2)
    (time,) = sampled_loops.loop_times([dense, sparse], 1)
    assert time.activities[Activity.PYTHON] == pytest.approx(0.25)
    assert time.samples == round(0.8**2 / (6 * 0.1**2 + 0.2**2))


def call(callee, line, seconds, begin_s=0.0, end_s=1.0, calls=10, **more):
    """Return calls that were timed from a line of the loop."""
    values = {"pid": 1, "thread": 1, "steps": 0, "all_steps": 0, **more}
    return CallTime(
        callee,
        place=Place("program.py", line, "main"),
        loop=SourceLoop("program.py", 7, 9),
        calls=calls,
        seconds=seconds,
        first_ns=round(1e9 * begin_s),
        last_ns=round(1e9 * end_s),
        **values,
    )


STEP = {"steps": 10, "all_steps": 10}


def test_what_calls_take_is_known_and_samples_divide_the_rest(file):
    """20 of 40 samples are physics; the calls took 0.6 of the 4 seconds."""
    of = stacks(file)
    seen = [of["step"], of["observe"]] * 20
    timed = [call("mj_step", 8, 0.6, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.activities == pytest.approx({Activity.PHYSICS: 0.15, Activity.PYTHON: 0.85})
    assert {line.place.line: line.share for line in time.lines} == pytest.approx({2: 0.85, 8: 0.15})
    assert time.is_timed(Activity.PHYSICS)
    assert not time.is_timed(Activity.PYTHON)


@pytest.mark.parametrize(("error", "share"), [(0.0, 0.5), (0.05, 0.5), (0.2, 0.8)])
def test_samples_tell_what_bursts_that_differ_much_do_not(file, error, share):
    of = stacks(file)
    seen = [*([of["step"]] * 4), of["observe"]] * 80
    timed = [call("mj_step", 8, 20.0, 0, 40, **STEP)]
    loops = sampled_loops.loop_times([samples(seen)], 1, calls=timed, step_errors={1: error})
    assert loops[0].activities[Activity.PHYSICS] == pytest.approx(share)
    assert sum(loops[0].activities.values()) == pytest.approx(1.0)


def test_what_an_environment_computes_on_the_line_that_steps_it_is_no_step(file):
    of = stacks(file)
    package = Frame("reward", "/env/lib/python3.11/site-packages/gymnasium/env.py", 5)
    seen = [*([of["step"]] * 3), [*of["step"][:-1], package], of["observe"]] * 80
    timed = [call("mj_step", 8, 20.0, 0, 40, **STEP)]
    (loop,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed, step_errors={1: 0.2})
    assert loop.activities[Activity.PHYSICS] == pytest.approx(0.6)


@pytest.mark.parametrize(("before", "seconds"), [(0, 4.0), (2, 4.0), (40, 8.0)])
def test_a_loop_is_longer_than_from_its_first_call_to_its_last_if_samples_certainly_say_so(
    file, before, seconds
):
    of = stacks(file)
    seen = [of["observe"]] * before + [of["step"], of["observe"]] * 20
    timed = [call("mj_step", 8, 0.6, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.seconds == pytest.approx(seconds, rel=0.05)


def test_samples_that_saw_few_calls_say_how_long_a_loop_runs(file):
    of = stacks(file)
    seen = [of["observe"]] * 30 + [of["step"]] + [of["observe"]] * 29
    timed = [call("mj_step", 8, 0.01, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.seconds == pytest.approx(6.0)


def test_calls_that_take_longer_after_the_last_that_was_timed_are_as_long_as_samples_say(file):
    seen = [stacks(file)["step"], stacks(file)["observe"]] * 30
    timed = [call("mj_step", 8, 0.6, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.seconds == pytest.approx(6.0)


def test_what_a_line_with_one_step_seems_to_call_belongs_to_the_line_that_calls_it(file):
    array = Frame("vstack", "/env/lib/python3.11/site-packages/numpy/shape.py", 7)
    beside, torn = [Frame("main", file, 9), array], [Frame("main", file, 8), array]
    timed = call("mj_step", 8, 1.0, 0, 5, **STEP)
    timed = replace(timed, place=replace(timed.place, text="step()"))
    seen = [beside] * 30 + [torn] * 10 + [stacks(file)["step"]] * 10
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=[timed])
    assert {line.place.line: line.share for line in time.lines} == pytest.approx({9: 0.8, 8: 0.2})


def test_what_a_compiled_function_compares_is_apart_from_its_calls(file):
    fields = "/env/lib/python3.11/site-packages/mujoco/mjx/_src/dataclasses.py"
    compare = [Frame("main", file, 8), Frame("_Wrapper.__eq__", fields, 5)]
    seen = [compare] * 10 + [[Frame("main", file, 8)]] * 20 + [stacks(file)["observe"]] * 10
    timed = [call(DISPATCH, 8, 3.0, 0, 4)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    parts = {Activity.DISPATCH: 0.5, Activity.COMPARING: 0.25, Activity.PYTHON: 0.25}
    assert time.activities == pytest.approx(parts)
    assert not time.is_timed(Activity.COMPARING)


def test_what_frees_the_result_of_a_slow_call_is_of_its_line(file):
    seen = [stacks(file)["step"]] * 36 + [stacks(file)["observe"]] * 4
    timed = [call("MjData", 8, 2.0, 0, 4), call("mj_step", 9, 0.4, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.activities[Activity.BINDINGS] == pytest.approx(0.4 * 0.8)
    assert time.activities[Activity.PYTHON] == pytest.approx(0.4 * 0.2)


def test_lines_outside_loops_stand_for_all_that_they_call(file):
    of = stacks(file)
    imported = [
        Frame("<module>", file, 10),
        Frame("_find_and_load", "<frozen importlib._bootstrap>", 1),
    ]
    seen = [samples([of["setup"]] * 5 + [imported] * 20 + [of["step"]] * 15)]
    loops = sampled_loops.loop_times(seen, 1)
    imports, setup = sampled_loops.outside_loops(seen, 1, loops, wall_s=5.0)
    assert (imports.main_activity, imports.share) == (Activity.IMPORT, pytest.approx(0.4))
    assert (str(setup.place), setup.share) == ("program.py:6", pytest.approx(0.1))


def test_lines_that_lead_to_a_loop_without_samples_are_not_outside_it(file):
    of = stacks(file)
    seen = [samples([of["setup"]] * 5)]
    lines = [("program.py", 8), ("program.py", 11)]
    timed = [replace(call("mj_step", 8, 0.5, **STEP), lines=lines)]
    loops = sampled_loops.loop_times([], 1, calls=timed)
    (setup,) = sampled_loops.outside_loops(seen, 1, loops, wall_s=5.0)
    assert str(setup.place) == "program.py:6"


def test_without_a_loop_the_lines_that_main_calls_are_named(file):
    of = stacks(file)
    seen = [samples([of["setup"]] * 5 + [of["observe"]] * 10)]
    observe, setup = sampled_loops.outside_loops(seen, 1, [], wall_s=5.0)
    assert (observe.place.line, setup.place.line) == (9, 6)


def test_a_loop_of_which_there_are_no_samples_has_its_calls(file):
    timed = [call("mj_step", 8, 0.5, **STEP), call("MjData", 9, 0.25)]
    (time,) = sampled_loops.loop_times([], 1, calls=timed)
    assert (time.samples, time.seconds, time.in_main) == (0, pytest.approx(1.0), True)
    assert time.activities == pytest.approx(
        {Activity.PHYSICS: 0.5, Activity.COPYING: 0.25, Activity.REST: 0.25}
    )


def test_samples_on_the_line_of_a_slow_call_are_of_the_call(file):
    of = stacks(file)
    seen = [of["step"]] * 30 + [of["observe"]] * 10
    timed = [call("Renderer", 8, 3.0, 0, 4), call("mj_step", 9, 0.4, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, calls=timed)
    assert time.activities == pytest.approx(
        {Activity.RENDERING: 0.75, Activity.PHYSICS: 0.1, Activity.PYTHON: 0.15}
    )


def test_where_samples_saw_only_the_calls_the_rest_is_what_python_does_to_make_them(file):
    timed = [call("mj_step", 8, 3.0, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples([stacks(file)["step"]] * 40)], 1, calls=timed)
    assert time.activities == pytest.approx({Activity.PHYSICS: 0.75, Activity.BINDINGS: 0.25})


def test_a_loop_that_compiles_is_shown_though_it_does_not_step(file):
    timed = [call(COMPILE, 8, 0.9)]
    (time,) = sampled_loops.loop_times([], 1, calls=timed)
    assert time.activities[Activity.COMPILING] == pytest.approx(0.9)


def test_functions_of_jax_take_no_more_of_the_policy_than_is_not_timed(file):
    site = "/env/lib/python3.11/site-packages"
    compiler = Frame("backend_compile", f"{site}/jax/_src/compiler.py", 353)
    tracer = Frame("trace", f"{site}/jax/_src/core.py", 5)
    step = [Frame("main", file, 8)]
    observe = [Frame("main", file, 9), Frame("observe", file, 2)]
    seen = [samples([[*step, compiler]] * 45 + [[*observe, tracer]] * 15)]
    timed = [call(COMPILE, 8, 4.2, 0, 5), call(DISPATCH, 8, 0.3, 5, 6)]
    (time,) = sampled_loops.loop_times(seen, 1, calls=timed)
    assert time.activities[Activity.POLICY] == pytest.approx(0.25)
    (function,) = time.inner_functions
    assert (function.place.function, function.main_activity) == ("trace", Activity.POLICY)
    assert function.share == pytest.approx(time.activities[Activity.POLICY])


def test_what_jax_compiles_outside_loops_is_an_activity_of_its_own(file):
    of = stacks(file)
    seen = [samples([of["setup"]] * 10 + [of["step"]] * 10)]
    (time,) = sampled_loops.loop_times(seen, 1)
    (setup,) = sampled_loops.outside_loops(seen, 1, [time], 2.0, [call(COMPILE, 6, 0.9)])
    assert (setup.place.line, setup.main_activity) == (6, Activity.COMPILING)


def test_a_loop_that_starts_processes_is_shown_where_they_step(file):
    workers = [samples([stacks(file)["step"]] * 4, pid, pid) for pid in (2, 3)]
    started = replace(call(PROCESS_START, 12, 0.9), loop=SourceLoop("program.py", 12, 13))
    first, _ = sampled_loops.loop_times(workers, 1, {2, 3}, [started])
    assert (first.loop.first, first.in_main) == (12, True)


def test_calls_on_several_threads_add_up(file):
    timed = [call("mj_step", 8, 0.5, thread=thread, **STEP) for thread in (1, 2)]
    (time,) = sampled_loops.loop_times([], 1, calls=timed)
    assert time.seconds == pytest.approx(2.0)
    assert time.activities[Activity.PHYSICS] == pytest.approx(0.5)


def test_garbage_collections_are_an_activity_of_their_own(file):
    of = stacks(file)
    seen = [of["step"], of["observe"]] * 20
    timed = [call("mj_step", 8, 2.0, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times([samples(seen)], 1, (), timed, {1: 1.0})
    assert time.activities == pytest.approx(
        {Activity.PHYSICS: 0.5, Activity.PYTHON: 0.25, Activity.COLLECTION: 0.25}
    )


def test_a_line_on_the_stack_has_the_steps_of_the_functions_that_it_calls(file):
    calls = [Frame("main", file, 9), Frame("observe", file, 2)]
    seen = [[*calls, ENGINE]] * 6 + [calls] * 2 + [stacks(file)["step"]] * 2
    (time,) = sampled_loops.loop_times([samples(seen)], 1)
    shares = {line.place.line: line.activities for line in time.lines_on_stack}
    called = {Activity.PHYSICS: pytest.approx(0.6), Activity.PYTHON: pytest.approx(0.2)}
    assert shares[9] == shares[2] == called


def test_which_of_two_loops_collections_interrupt_is_not_known(file):
    Path(file).write_text(f"{SOURCE}\nfor _ in range(9):\n    step()\n")
    seen = [[Frame("<module>", file, 14), ENGINE], stacks(file)["step"]] * 20
    both = sampled_loops.loop_times([samples(seen)], 1, collections_s={1: 1.0})
    assert [time.activities for time in both] == [{Activity.PHYSICS: 1.0}] * 2


def test_a_comprehension_is_a_part_of_its_line(file):
    inner = [Frame("main", file, 9), Frame("<listcomp>", file, 9)]
    seen = [inner] * 2 + [inner[:1]] + [stacks(file)["step"]] * 7
    _, observe = sampled_loops.loop_times([samples(seen)], 1)[0].lines
    assert (observe.place.function, observe.share) == ("main", pytest.approx(0.3))


def test_timed_calls_may_leave_nothing_to_samples(file):
    of = stacks(file)
    timed = [call("mj_step", 8, 4.0, 0, 4, **STEP)]
    (time,) = sampled_loops.loop_times(
        [samples([of["step"]] * 30 + [of["observe"]] * 10)], 1, (), timed
    )
    assert time.activities == pytest.approx({Activity.PHYSICS: 1.0})


def _connection():
    import multiprocessing.connection

    return multiprocessing.connection.__file__


def test_a_call_that_was_first_made_before_the_loop_is_of_the_loop_in_which_samples_see_it(file):
    module = Frame("<module>", file, 11)
    before = [module, Frame("main", file, 6), Frame("observe", file, 2)]
    seen = samples([before] + [stacks(file)["observe"]] * 3)
    made = replace(call("compile", 2, 0.1), place=Place("program.py", 2, "observe"), loop=None)
    (compiled,) = sampled_loops.with_sampled_loops([seen], [made])
    assert compiled.loop == SourceLoop("program.py", 7, 9)
    assert compiled.lines == [("program.py", 2), ("program.py", 9)]
    assert sampled_loops.with_sampled_loops([seen], [replace(made, pid=2)])[0].loop is None
    of_main = replace(made, place=Place("program.py", 6, "main"))
    assert sampled_loops.with_sampled_loops([seen], [of_main])[0].loop is None
    in_loop = call("mj_step", 8, 0.5, 4.0, 9.0, **STEP)
    again, _ = sampled_loops.with_sampled_loops([seen], [made, in_loop])
    assert again.first_ns == in_loop.first_ns, "the first call came before the loop"


def test_the_process_that_unpickles_most_counts_and_one_that_waits_does_not(file):
    queues = multiprocessing.queues.__file__
    text = Path(queues).read_text().splitlines()
    line = next(i for i, each in enumerate(text, 1) if "_ForkingPickler.loads(" in each)
    taking, waiting = Frame("get", queues, line), Frame("get", queues, line - 1)
    workers = [samples([[taking]] * n + [[waiting]] * 9, pid, pid) for n, pid in ((3, 2), (4, 3))]
    seen = [samples([stacks(file)["step"]] * 10), *workers]
    (time,) = sampled_loops.loop_times(seen, 1)
    assert time.unpickling_share == pytest.approx(0.4)


@pytest.mark.parametrize("calls", [2, 3])
def test_what_a_task_of_a_pool_does_again_and_again_is_of_its_function(file, calls):
    pool = Frame("worker", str(Path(multiprocessing.__file__).with_name("pool.py")), 125)
    main = Frame("main", file, 8)
    seen = [samples([[pool, replace(main, line=6)], [pool, main, ENGINE], [pool, main, ENGINE]])]
    loading = replace(call("compile", 6, 0.1, calls=calls), loop=None)
    made = sampled_loops.with_sampled_loops(seen, [loading, call("mj_step", 8, 0.1, **STEP)])
    (time,) = sampled_loops.loop_times(seen, 2, calls=made)
    assert (time.loop.first, time.loop.last) == ((5, 9) if calls == 3 else (7, 9))
    assert len(time.calls) == (2 if calls == 3 else 1)
