"""`mjbench.timer`, with a clock that the test turns."""

from types import SimpleNamespace

import pytest
from still_clock import StillClock

import mjbench
from mjbench.errors import InputError


@pytest.fixture
def clock() -> StillClock:
    return StillClock(5_000)


def test_a_block_has_seconds_and_steps_per_second(clock: StillClock) -> None:
    with mjbench.timer(steps=500, clock=clock) as timer:
        clock.now += 250_000_000
    assert timer.elapsed_s == 0.25
    assert timer.timing.steps_per_s == 2000.0
    assert timer.timing.realtime_factor is None
    assert str(timer) == "250 ms, 500 steps, 2,000 per second"


def test_time_runs_on_within_the_block_and_stands_still_after_it(clock: StillClock) -> None:
    with mjbench.timer(clock=clock) as timer:
        clock.now += 1_000_000_000
        assert timer.elapsed_s == 1.0
        assert repr(timer) == "<mjbench timer: running for 1 s>"
        clock.now += 1_000_000_000
    clock.now += 9_000_000_000
    assert timer.elapsed_s == 2.0


def test_steps_may_be_known_only_at_the_end(clock: StillClock) -> None:
    with mjbench.timer(clock=clock) as timer:
        clock.now += 1_000_000_000
        timer.steps = 7
    assert timer.timing.steps_per_s == 7.0


def data(time: float, timestep: float = 0.002) -> SimpleNamespace:
    """Return what the timer reads of an MjData."""
    model = SimpleNamespace(opt=SimpleNamespace(timestep=timestep))
    return SimpleNamespace(time=time, model=model)


def test_data_give_simulated_time_and_steps(clock: StillClock) -> None:
    stepped = data(3.0)
    with mjbench.timer(data=stepped, clock=clock) as timer:
        clock.now += 500_000_000
        stepped.time += 2.0
    assert timer.timing.simulated_s == pytest.approx(2.0)
    assert timer.timing.steps == 1000
    assert timer.timing.realtime_factor == pytest.approx(4.0)
    assert "4 times real time" in str(timer)


def test_with_steps_a_reset_of_data_does_no_harm(clock: StillClock) -> None:
    stepped = data(3.0)
    with mjbench.timer(steps=1000, data=stepped, clock=clock) as timer:
        clock.now += 1_000_000_000
        stepped.time = 0.5
    assert timer.timing.realtime_factor == pytest.approx(2.0)


def test_data_whose_time_went_back_give_no_real_time_factor(clock: StillClock) -> None:
    stepped = data(3.0)
    with mjbench.timer(data=stepped, clock=clock) as timer:
        clock.now += 1_000_000_000
        stepped.time = 0.5
    assert timer.timing.realtime_factor is None
    assert timer.timing.steps is None


def test_laps_are_parts_of_the_block(clock: StillClock) -> None:
    with mjbench.timer(clock=clock) as timer:
        for number in range(100):
            clock.now += 5_000 if number == 30 else 1_000
            timer.lap()
    laps = timer.timing.laps
    assert laps is not None
    assert laps.count == 100
    assert (laps.p50_ns, laps.max_ns) == (1_000.0, 5_000.0)
    assert 1_000.0 < laps.p99_ns < 5_000.0
    assert laps.ns.sum() == 1e9 * timer.elapsed_s
    with pytest.raises(ValueError, match="read-only"):
        laps.ns[0] = 1
    assert "100 laps: p50 1 µs" in str(timer)


def test_a_block_that_raises_is_timed_and_raises(clock: StillClock) -> None:
    timer = mjbench.timer(clock=clock)
    with pytest.raises(ZeroDivisionError), timer:
        clock.now += 1_000_000
        raise ZeroDivisionError
    assert timer.elapsed_s == 0.001


def test_misuse_is_refused_in_a_line(clock: StillClock) -> None:
    timer = mjbench.timer(clock=clock)
    for wrong in (lambda: timer.elapsed_s, timer.lap, lambda: timer.timing):
        with pytest.raises(InputError, match=r"mjbench\.timer"):
            wrong()
    with timer:
        clock.now += 1
    with pytest.raises(InputError, match="within the block"):
        timer.lap()
    with pytest.raises(InputError, match="times one block"):
        timer.__enter__()


def test_a_block_without_time_has_no_rate(clock: StillClock) -> None:
    with mjbench.timer(steps=3, clock=clock) as timer:
        pass
    assert timer.timing.steps_per_s is None
    assert str(timer) == "0 ns"


def test_a_notebook_shows_the_conclusion_and_a_table_of_laps(clock: StillClock) -> None:
    with mjbench.timer(steps=2, clock=clock) as timer:
        clock.now += 2_000
        timer.lap()
    html = timer._repr_html_()
    assert html.index("2 steps") < html.index("<table")
    assert "<td" in html
    assert "not started" in mjbench.timer()._repr_html_().replace("&lt;", "<")
