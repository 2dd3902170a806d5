"""The kernel's accounts of threads say how long each was blocked."""

import pytest

from mjbench.program.thread_times import ThreadTime, ThreadTimes


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
