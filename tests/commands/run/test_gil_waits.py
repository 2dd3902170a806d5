"""A thread that is blocked, and waits for nothing else, waits for the GIL."""

import pytest

from mjbench.commands.run.gil_waits import Holders, ThreadTime, ThreadTimes, gil_waits
from mjbench.commands.run.py_spy import Frame, Thread, ThreadSamples

SLEEP = Frame("wait", "/usr/lib/python3.11/threading.py", 320)
STEP = Frame("simulate", "/home/me/train.py", 12)
PLAN = Frame("plan", "/home/me/train.py", 30)


def samples(tid, *stacks, pid=1):
    return ThreadSamples(Thread(pid, tid, f"thread {tid}"), stacks, 0.01)


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


def account(folder, tid, ran_ns, queued_ns, pid=7):
    task = folder / str(pid) / "task" / str(tid)
    task.mkdir(parents=True, exist_ok=True)
    (task / "schedstat").write_text(f"{ran_ns} {queued_ns} 12\n")


def test_what_a_thread_did_is_the_difference_of_two_looks(tmp_path):
    times = ThreadTimes()
    account(tmp_path, 8, 10**9, 5 * 10**8)
    times.look([7], tmp_path)
    account(tmp_path, 8, 3 * 10**9, 10**9)
    times.look([7, 404], tmp_path)
    (time,) = times.times()
    assert (time.pid, time.tid) == (7, 8)
    assert time.processor_s == pytest.approx(2.0)
    assert time.queued_s == pytest.approx(0.5)


def test_a_thread_that_neither_runs_nor_queues_is_blocked():
    assert ThreadTime(1, 1, 10.0, 2.0, 3.0).blocked_share == pytest.approx(0.5)
    assert ThreadTime(1, 1, 0.0, 0.0, 0.0).blocked_share == 0.0


def test_two_busy_threads_of_one_process_contend(monkeypatch):
    busy, idle = ThreadTime(1, 1, 10.0, 5.0, 0.0), ThreadTime(1, 2, 10.0, 0.1, 0.0)
    other = ThreadTime(2, 3, 10.0, 5.0, 0.0)
    times = ThreadTimes()
    several = [busy, idle, busy, other]
    for listed, expected in (([busy, idle, other], None), (several, 1), ([], None)):
        monkeypatch.setattr(times, "times", lambda listed=listed: listed)
        assert times.contending() == expected
