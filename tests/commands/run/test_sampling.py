"""The profiler takes fewer samples where it would cost too much."""

import pytest

from mjbench.commands.run import py_spy
from mjbench.commands.run.sampling import ProcessorClock, ProcessorUse, Profiling
from mjbench.host import machine


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


@pytest.mark.parametrize(
    ("children", "rate_hz", "started"), [(1, None, [100]), (2, None, [100, 20]), (2, 50, [50])]
)
def test_of_many_processes_samples_are_fewer(tmp_path, monkeypatch, children, rate_hz, started):
    rates = []

    def start(pid, folder, rate_hz):
        rates.append(rate_hz)
        return FakeSampler(folder)

    monkeypatch.setattr(py_spy, "start", start)
    for pid in range(1, children + 2):
        (tmp_path / f"{pid}.steps").touch()
    beside = Profiling.begin(1, tmp_path, rate_hz)
    for _ in range(3):
        beside.look()
    assert rates == started
    assert beside.rate_hz == started[-1]
    assert beside.cpu_s == 0.25 * len(started)


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
    beside = Profiling.begin(1, tmp_path, None)
    beside.earlier_cpu_s = 1.0
    begin = ProcessorClock(time_s=100.0, own_s=2.0, children_s=5.0)
    use = ProcessorClock(time_s=110.0, own_s=2.5, children_s=26.0).use(begin, beside)
    assert use == ProcessorUse(program_cores=2.0, observer_cores=0.175, usable_cores=4)
    assert begin.use(begin, beside) is None
