"""Samples become shares of a loop's time."""

import pytest

from mjbench.program import activities, attribution
from mjbench.program.activities import Activity
from mjbench.program.samples import Frame, Thread, ThreadSamples

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
ENGINE = Frame("mj_step", "/lib/libmujoco.so", 0)
MEMORY = Frame("memcpy", "/lib/libc.so.6", 0)
PIPE = Frame("read", "/lib/libc.so.6", 0)


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
        "copy": [module, main, MEMORY],
        "observe": [module, Frame("main", file, 9), Frame("observe", file, 2)],
    }


def samples(stacks, pid=1, tid=1):
    return ThreadSamples(Thread(pid, tid, "MainThread"), stacks, 0.1)


def test_shares_of_a_loop_sum_to_one(file):
    of = stacks(file)
    seen = [of["setup"]] * 5 + [of["step"]] * 6 + [of["observe"]] * 3 + [of["copy"]]
    (time,) = attribution.loop_times([samples(seen)], main_pid=1)
    assert (time.loop.file, time.loop.first, time.loop.last) == ("program.py", 7, 9)
    assert time.samples == 10
    assert time.seconds == pytest.approx(1.0)
    assert time.in_main
    assert time.activities == pytest.approx({Activity.PHYSICS: 0.7, Activity.PYTHON: 0.3})
    assert time.packages == {"": pytest.approx(0.3)}
    assert time.own_files == ["program.py"]
    assert time.error(0.3) == pytest.approx((0.3 * 0.7 / 10) ** 0.5)


def test_lines_are_those_of_the_users_code_with_their_text(file):
    of = stacks(file)
    (time,) = attribution.loop_times([samples([of["step"]] * 7 + [of["observe"]] * 3)], 1)
    step, observe = time.lines
    assert (str(step.place), step.place.text) == ("program.py:8", "step()")
    assert step.share == pytest.approx(0.7)
    assert (observe.place.function, observe.place.line) == ("observe", 2)
    assert observe.main_activity == Activity.PYTHON


def test_time_in_a_library_of_c_counts_for_what_its_line_does(file):
    of = stacks(file)
    (time,) = attribution.loop_times([samples([of["step"], of["copy"], of["copy"]])], 1)
    assert time.activities == {Activity.PHYSICS: 1.0}


def test_a_line_names_the_package_that_it_calls(file):
    package = Frame("step", "/env/lib/python3.11/site-packages/gymnasium/core.py", 5)
    inner = Frame("f", "/env/lib/python3.11/site-packages/numpy/x.py", 7)
    call = [Frame("main", file, 8), package, inner]
    (time,) = attribution.loop_times([samples([call] * 3 + [stacks(file)["step"]])], 1)
    assert time.lines[0].package == "gymnasium"
    assert [str(line.place) for line in time.inner_functions] == ["numpy/x.py:7"]
    assert time.inner_functions[0].share == pytest.approx(0.75)


def test_a_loop_without_physics_is_left_out(file):
    of = stacks(file)
    assert attribution.loop_times([samples([of["observe"]] * 5)], 1) == []


def test_a_process_that_is_known_to_step_has_its_longest_loop(file):
    (time,) = attribution.loop_times([samples([stacks(file)["observe"]] * 30)], 1, {1})
    assert not time.has_physics
    few = [samples([stacks(file)["observe"]] * 29)]
    assert attribution.loop_times(few, 1, {1}) == []


def test_a_loop_that_waits_for_processes_that_step_comes_first(file):
    waiting = [Frame("main", file, 9), Frame("recv", _connection(), 250), PIPE]
    workers = [samples([stacks(file)["step"]] * 4, pid, pid) for pid in (2, 3)]
    other = samples([[Frame("other", file, 8), Frame("recv", _connection(), 250), PIPE]] * 5)
    (both,) = attribution.loop_times([other, *workers], 1)
    assert both.pids == [1, 2, 3]
    assert both.activities[Activity.PROCESSES] == pytest.approx(5 / 13)
    assert waiting[0].file == file


def test_a_forked_process_has_loops_of_its_own(file):
    import multiprocessing.process

    start = Frame("main", file, 9)
    bootstrap = Frame("BaseProcess._bootstrap", multiprocessing.process.__file__, 314)
    forked = [start, bootstrap, *stacks(file)["step"]]
    elsewhere = [start, bootstrap, Frame("other", file, 2), ENGINE]
    (time,) = attribution.loop_times([samples([forked, elsewhere], 2, 2)], 1)
    assert (time.samples, time.loop.first) == (1, 7)


def test_samples_at_several_rates_count_for_their_time(file):
    of = stacks(file)
    dense = ThreadSamples(Thread(1, 1, "MainThread"), [of["step"]] * 6, 0.1)
    sparse = ThreadSamples(Thread(1, 1, "MainThread"), [of["observe"]], 0.2)
    (time,) = attribution.loop_times([dense, sparse], 1)
    assert time.activities[Activity.PYTHON] == pytest.approx(0.25)
    assert time.samples == round(0.8**2 / (6 * 0.1**2 + 0.2**2))


def _connection():
    import multiprocessing.connection

    return multiprocessing.connection.__file__
