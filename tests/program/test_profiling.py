"""The profiler takes fewer samples, or leaves out libraries, where it would cost too much."""

import pytest

from mjbench.program import profiling, sampler
from mjbench.program.profiling import Profiling, Sampling


class FakeSampler:
    """A profiler that never ends by itself."""

    def __init__(self, folder):
        self.is_running = True
        self.file = folder / "samples.json"
        self.has_begun = True

    def stop(self):
        self.has_begun = False


@pytest.mark.parametrize(("paused", "rate"), [(3, 10), (30, 3), (6, 5)])
def test_the_rate_is_lowered_once_where_samples_cost_too_much(tmp_path, monkeypatch, paused, rate):
    started = []

    def start(pid, folder, rate_hz, has_native, seconds=None):
        started.append(rate_hz)
        return FakeSampler(folder)

    monkeypatch.setattr(sampler, "start", start)
    states = iter([b"t"] * paused + [b"R"] * 10_000)
    monkeypatch.setattr(profiling, "process_state", lambda pid: next(states))
    beside = Profiling.begin(1, tmp_path, Sampling())
    for _ in range(2 * profiling.LOOKS_TO_ADAPT):
        beside.look_for_pause()
    assert beside.rate_hz == rate
    assert started == ([10] if rate == 10 else [10, rate])


def test_a_rate_that_was_asked_for_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(sampler, "start", lambda pid, folder, *_: FakeSampler(folder))
    monkeypatch.setattr(profiling, "process_state", lambda pid: b"t")
    beside = Profiling.begin(1, tmp_path, Sampling(50))
    for _ in range(2 * profiling.LOOKS_TO_ADAPT):
        beside.look_for_pause()
    assert beside.rate_hz == 50
    assert beside.paused_share == 1.0


@pytest.mark.parametrize(
    ("children", "has_native", "started"),
    [(1, None, [True]), (2, None, [True, False]), (2, True, [True]), (0, False, [False])],
)
def test_stacks_of_libraries_are_left_out_of_many_processes_unless_asked_for(
    tmp_path, monkeypatch, children, has_native, started
):
    modes = []

    def start(pid, folder, rate_hz, native, seconds=None):
        modes.append(native)
        return FakeSampler(folder)

    monkeypatch.setattr(sampler, "start", start)
    for pid in range(1, children + 2):
        (tmp_path / f"{pid}.steps").touch()
    beside = Profiling.begin(1, tmp_path, Sampling(None, has_native))
    for _ in range(3):
        beside.look()
    assert modes == started
    assert beside.has_native == started[-1]
    assert beside.rate_hz == sampler.DEFAULT_RATE_HZ
