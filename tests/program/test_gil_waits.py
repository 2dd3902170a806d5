"""A thread that is blocked, and waits for nothing else, waits for the GIL."""

import pytest

from mjbench.program.gil_waits import Holders, gil_waits
from mjbench.program.samples import Frame, Thread, ThreadSamples
from mjbench.program.thread_times import ThreadTime

SLEEP = Frame("wait", "/usr/lib/python3.11/threading.py", 320)
STEP = Frame("simulate", "/home/me/train.py", 12)
PLAN = Frame("plan", "/home/me/train.py", 30)


def samples(tid, *stacks, pid=1):
    return ThreadSamples(Thread(pid, tid, f"thread {tid}"), stacks, 0.01, has_native=False)


PLANNER, SIMULATOR = 10, 11
THREADS = [samples(PLANNER, *[[PLAN]] * 100), samples(SIMULATOR, *[[STEP]] * 80, *[[SLEEP]] * 20)]
TIMES = [ThreadTime(1, PLANNER, 10.0, 9.0, 1.0), ThreadTime(1, SIMULATOR, 10.0, 1.0, 2.0)]
HOLDERS = Holders(1, [samples(PLANNER, *[[PLAN]] * 90), samples(SIMULATOR, *[[STEP]] * 5)], 100)


def test_what_is_blocked_and_does_not_wait_for_anything_else_waits_for_the_gil():
    (wait,) = gil_waits(TIMES, THREADS, HOLDERS)
    assert wait.thread == "thread 11"
    assert wait.share == pytest.approx(0.7 - 0.2)
    assert (wait.holder, wait.holder_share) == ("thread 10", pytest.approx(0.9))
    assert (wait.place.line, wait.place.function) == (30, "plan")


def test_no_thread_waits_longer_than_others_hold_the_gil():
    rarely = Holders(1, [samples(PLANNER, *[[PLAN]] * 30)], 100)
    (wait,) = gil_waits(TIMES, THREADS, rarely)
    assert wait.share == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("times", "holders"),
    [
        (TIMES, None),
        (TIMES, Holders(1, [samples(PLANNER, [PLAN])], 100)),
        (TIMES, Holders(2, HOLDERS.threads, 100)),
        ([TIMES[0], ThreadTime(1, SIMULATOR, 10.0, 0.1, 0.0)], HOLDERS),
    ],
    ids=["one busy thread", "few samples", "another process", "an idle thread"],
)
def test_what_is_not_known_is_not_said(times, holders):
    assert gil_waits(times, THREADS, holders) == []


def test_the_engines_own_threads_need_no_gil():
    rollout = Frame("rollout", "/venv/lib/python3.11/site-packages/mujoco/rollout.py", 9)
    threads = [THREADS[0], samples(SIMULATOR, *[[STEP, rollout]] * 100)]
    assert gil_waits(TIMES, threads, HOLDERS) == []
