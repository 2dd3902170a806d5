"""The profiler takes fewer samples, or leaves out libraries, where it would cost too much."""

import pytest

from mjbench.host import machine
from mjbench.program import py_spy, sampling
from mjbench.program.sampling import ProcessorClock, ProcessorUse, Profiling, Sampling


class FakeSampler:
    """A profiler that never ends by itself."""

    def __init__(self, folder):
        self.is_running = True
        self.file = folder / "samples.json"
        self.has_begun = True

    def cpu_s(self):
        return 0.25

    def stop(self):
        self.has_begun = False


@pytest.mark.parametrize(("paused", "rate"), [(3, 10), (30, 3), (6, 5)])
def test_the_rate_is_lowered_once_where_samples_cost_too_much(tmp_path, monkeypatch, paused, rate):
    started = []

    def start(pid, folder, rate_hz, has_native, seconds=None):
        started.append(rate_hz)
        return FakeSampler(folder)

    monkeypatch.setattr(py_spy, "start", start)
    states = iter([b"t"] * paused + [b"R"] * 10_000)
    monkeypatch.setattr(sampling, "process_state", lambda pid: next(states))
    beside = Profiling.begin(1, tmp_path, Sampling(has_native=True))
    for _ in range(2 * sampling.LOOKS_TO_ADAPT):
        beside.look_for_pause()
    assert beside.rate_hz == rate
    assert started == ([10] if rate == 10 else [10, rate])


def test_a_rate_that_was_asked_for_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(py_spy, "start", lambda pid, folder, *_: FakeSampler(folder))
    monkeypatch.setattr(sampling, "process_state", lambda pid: b"t")
    beside = Profiling.begin(1, tmp_path, Sampling(50, has_native=True))
    for _ in range(2 * sampling.LOOKS_TO_ADAPT):
        beside.look_for_pause()
    assert beside.rate_hz == 50
    assert beside.paused_share == 1.0


@pytest.mark.parametrize(
    ("children", "sampling", "started"),
    [
        (1, Sampling(), [(100, False)]),
        (2, Sampling(), [(100, False), (20, False)]),
        (2, Sampling(has_native=True), [(10, True)]),
        (2, Sampling(rate_hz=50), [(50, False)]),
        (0, Sampling(has_native=True), [(10, True)]),
    ],
)
def test_of_many_processes_samples_are_fewer(tmp_path, monkeypatch, children, sampling, started):
    samplers = []

    def start(pid, folder, rate_hz, native, seconds=None):
        samplers.append((rate_hz, native))
        return FakeSampler(folder)

    monkeypatch.setattr(py_spy, "start", start)
    for pid in range(1, children + 2):
        (tmp_path / f"{pid}.steps").touch()
    beside = Profiling.begin(1, tmp_path, sampling)
    for _ in range(3):
        beside.look()
    assert samplers == started
    assert (beside.rate_hz, beside.sampling.has_native) == started[-1]
    assert beside.cpu_s == 0.25 * len(started)


def test_a_profiler_that_stops_nothing_has_no_pauses(tmp_path, monkeypatch):
    monkeypatch.setattr(py_spy, "start", lambda pid, folder, *_: FakeSampler(folder))
    assert Profiling.begin(1, tmp_path, Sampling()).paused_share == 0.0


@pytest.mark.parametrize(
    ("program_cores", "usable_cores", "share"),
    [
        (0.9, 2, 0.0),
        (1.0, 2, 0.0),
        (1.6, 2, 0.0225),
        (2.0, 2, 0.03),
        (0.5, 1, 0.06),
        (1.0, 1, 0.06),
    ],
)
def test_observing_displaces_a_program_that_leaves_no_core_free(program_cores, usable_cores, share):
    use = ProcessorUse(program_cores, observer_cores=0.06, usable_cores=usable_cores)
    assert use.displaced_share == pytest.approx(share)


def test_processor_time_is_of_the_program_without_earlier_profilers(tmp_path, monkeypatch):
    monkeypatch.setattr(py_spy, "start", lambda pid, folder, *_: FakeSampler(folder))
    monkeypatch.setattr(machine, "usable_cores", lambda: 4)
    beside = Profiling.begin(1, tmp_path, Sampling())
    beside.earlier_cpu_s = 1.0
    begin = ProcessorClock(time_s=100.0, own_s=2.0, children_s=5.0)
    use = ProcessorClock(time_s=110.0, own_s=2.5, children_s=26.0).use(begin, beside)
    assert use == ProcessorUse(program_cores=2.0, observer_cores=0.175, usable_cores=4)
    assert begin.use(begin, beside) is None
