"""What is computed from ticks, with a clock that the test turns."""

import json
import math
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import mjbench
from hdrh.histogram import HdrHistogram

from mjbench.commands.latency import measure as latency
from mjbench.commands.latency.measure import (
    LEAST_NTICK,
    RUN_NSTEP,
    WARM_UP_NTICK,
    LatencyRow,
    Pace,
)
from mjbench.commands.latency.options import LatencyOptions
from mjbench.errors import InputError
from mjbench.host import isolate
from mjbench.simulation import models, workload
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

WORK = Work(contacts=1.0, constraints=4.0, solver_iterations=2.0)


def row(
    latency_ns: np.ndarray, deadline_s: float | None = None, **features: np.ndarray
) -> LatencyRow:
    return latency.row(latency_ns, features, deadline_s, 0.002, model="m", work=WORK)


class Clock:
    """A clock that each reading, and each sleep, puts forward; one reading may take 5 ms."""

    def __init__(self, reading_ns: int, pause_at_ns: float = math.inf) -> None:
        self.now, self.slept_s = 0, 0.0
        self.reading_ns, self.pause_at_ns = reading_ns, pause_at_ns

    def __call__(self) -> int:
        self.now += self.reading_ns
        if self.now > self.pause_at_ns:
            self.now += 5_000_000
            self.pause_at_ns = math.inf
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept_s += seconds
        self.now += round(1e9 * seconds)


def test_quantiles_missed_deadlines_and_the_longest_tick() -> None:
    latency_ns = np.arange(1, 10_001) * 1e3
    of_ticks = row(latency_ns, deadline_s=0.009)
    assert [quantile.quantile for quantile in of_ticks.quantiles] == [0.5, 0.99, 0.999]
    assert of_ticks.quantiles[1].ns == pytest.approx(9.9e6, rel=1e-3)
    assert (of_ticks.missed, of_ticks.max_ns) == (1_000, 1e7)


@pytest.mark.parametrize(
    ("rate_hz", "pace", "deadline_s"), [(None, Pace.FREE, 0.006), (250.0, Pace.PACED, 0.004)]
)
def test_the_deadline_is_the_time_to_the_next_tick(
    rate_hz: float | None, pace: Pace, deadline_s: float
) -> None:
    latency_ns = np.full(2_000, 1e6)
    of_ticks = latency.row(latency_ns, {}, None, 0.006, rate_hz, model="m", work=WORK)
    assert of_ticks.deadline_s == pytest.approx(deadline_s)
    assert (of_ticks.pace, of_ticks.missed) == (pace, 0)


def test_what_slow_ticks_have_in_common_is_found() -> None:
    latency_ns, faults = np.full(1_000, 1e4), np.zeros(1_000)
    latency_ns[::200], faults[::200] = 1e6, 2.0
    of_ticks = row(latency_ns, faults=faults, calm=np.ones(1_000))
    shares = {feature.name: (feature.slow, feature.all) for feature in of_ticks.slow}
    assert shares == {"faults": (2.0, pytest.approx(0.01)), "calm": (1.0, 1.0)}


def test_the_histogram_is_one_that_others_can_read() -> None:
    of_ticks = row(np.array([1e3, 2e3, 2e3, 5e6]))
    histogram = HdrHistogram.decode(of_ticks.histogram.encode())
    assert histogram.get_total_count() == 4
    assert histogram.get_max_value() == pytest.approx(5e6, rel=1e-3)


def recorded(
    clock: Clock, ntick: int, period_ns: float, tick: int = 1
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    model = models.load(models.resolve("cartpole"))
    work = workload.make(model, nbatch=2, nstep=RUN_NSTEP, hold=tick)
    return latency.record_ticks(work, ntick, period_ns, clock, clock.sleep)


def test_every_free_running_tick_is_recorded_and_the_warm_up_is_not() -> None:
    latency_ns, features = recorded(Clock(10), 30, 0.0)
    np.testing.assert_array_equal(latency_ns, 10)
    assert {values.shape for values in features.values()} == {(30,)}
    assert set(features) >= {"contacts", "page faults"}


def test_ticks_end_with_the_time_once_there_are_enough() -> None:
    model = models.load(models.resolve("cartpole"))
    work = workload.make(model, nbatch=2, nstep=RUN_NSTEP, hold=1)
    clock = Clock(10)
    latency_ns, features = latency.record_ticks(
        work, 10_000, 0.0, clock, clock.sleep, end_ns=clock() + 1.0
    )
    assert len(latency_ns) == len(features["contacts"]) == LEAST_NTICK


def test_a_paced_tick_is_waited_for_and_its_latency_counts_from_when_it_was_due() -> None:
    clock = Clock(1_000)
    latency_ns, _ = recorded(clock, 20, 1e6)
    assert clock.slept_s > 0.5 * 1e-3 * (20 + WARM_UP_NTICK)
    assert latency_ns.max() <= 4_000  # three readings of the clock, each of which takes 1 µs


def test_a_tick_takes_its_steps_under_the_same_controls(monkeypatch: pytest.MonkeyPatch) -> None:
    controls: list[float] = []
    real_step = mujoco.mj_step

    def step(model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        if nstep == 4:
            controls.append(float(data.ctrl[0]))
        real_step(model, data, nstep)

    monkeypatch.setattr(mujoco, "mj_step", step)
    latency_ns, _ = recorded(Clock(10), 30, 0.0, tick=4)
    assert latency_ns.shape == (30,)
    assert len(controls) == 30 + WARM_UP_NTICK
    assert len(set(controls)) > 10


def test_a_rate_is_of_ticks_and_steps_are_whole_ticks(inline: None) -> None:
    given = LatencyOptions(tick=4, nstep=400)
    source, end_s = models.resolve("cartpole"), time.monotonic() + 1.0
    free, paced = isolate.call(
        latency.measure_in_child, source, given.starts, given, end_s, limit_s=60.0
    )
    assert (free.tick, free.ntick, free.deadline_s) == (4, 100, pytest.approx(0.008))
    assert paced.rate_hz == pytest.approx(125)
    with pytest.raises(InputError, match="--nstep 401 is not a multiple of --tick 4"):
        latency.measurement([], replace(given, nstep=401))


@pytest.mark.parametrize(
    ("missed", "status", "findings", "code"),
    [
        (1, Status.OK, ["missed"], 1),
        (1, Status.OK, None, 0),
        (0, Status.OK, ["missed"], 0),
        (1, Status.TIMEOUT, ["missed"], 3),
    ],
)
def test_missed_deadlines_are_a_finding_where_it_is_asked_for(
    missed: int, status: Status, findings: list[str] | None, code: int
) -> None:
    of_ticks = row(np.full(10, 1e6), 1.0)
    rows = [replace(of_ticks, missed=missed), replace(of_ticks, status=status)]
    assert LatencyOptions(findings=findings).exit_code(rows) == code


def test_ticks_that_wait_for_a_late_one_are_late_as_well() -> None:
    clock = Clock(1_000, pause_at_ns=1e6 * (WARM_UP_NTICK + 30))
    latency_ns, _ = recorded(clock, 80, 1e6)
    late = latency_ns[latency_ns > 100_000]
    assert len(late) >= 4
    assert (np.diff(late) < 0).all()


def test_latency_prints_both_paces_and_what_slow_ticks_share(tmp_path: Path, inline: None) -> None:
    words = ["--nstep", "1000", "--rate", "5000", "--deadline", "1us", "--json", "out.json"]
    done = mjbench("latency", "cartpole", *words, "--fail-on", "missed", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "free-running" in done.stdout
    assert "paced at 5000 Hz" in done.stdout
    assert done.stdout.count("Slow ticks") == 2
    again = mjbench("show", "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == json.loads((tmp_path / "out.json").read_text())
    assert "free-running" in mjbench("show", cwd=tmp_path).stdout


def test_quantiles_are_read_back_from_the_histogram() -> None:
    latency_ns = np.arange(1_000, 101_000, 100)
    median, slow = latency.histogram_quantiles(latency._histogram(latency_ns), [0.5, 0.99])
    assert median == pytest.approx(np.quantile(latency_ns, 0.5), rel=0.01)
    assert slow == pytest.approx(np.quantile(latency_ns, 0.99), rel=0.01)
    with pytest.raises(InputError, match="not an HdrHistogram"):
        latency.histogram_quantiles("damaged", [0.5])


def test_a_histogram_that_would_take_minutes_to_read_is_refused() -> None:
    encoded = "HISTFAAAACF4nJNpmSzMwMDAygABMJrRAcqw/wCh//8/z8oEAFglBZU="
    with pytest.raises(InputError, match="range or precision"):
        latency.histogram_quantiles(encoded, [0.5])


def test_a_model_that_cannot_be_loaded_is_one_line(tmp_path: Path) -> None:
    done = mjbench("latency", "nothing.xml", cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
