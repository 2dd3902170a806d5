"""The search for settings of MJX and Warp, with measurements that are planted, and its report."""

import math
from dataclasses import dataclass, field

import pytest
from tuning_values import apart

from mjbench.errors import UnavailableError
from mjbench.pages import terminal
from mjbench.paired.records import LaunchRow
from mjbench.report import tuning
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.starts import Starts
from mjbench.status import Status
from mjbench.tuning.accelerated_search import (
    LEAST_PROCESSES,
    EngineSearch,
    combinations,
)
from mjbench.tuning.records import (
    Attempt,
    Batch,
    BatchFacts,
    TunedProgram,
    TuneRecord,
    fresh_ratio,
    log_ratio,
)
from mjbench.tuning.search_base import SearchPlan
from mjbench.tuning.settings import Edit, Part, Setting, label

PRESENT_ERROR, ROUNDING_ERROR = 0.01, 1e-6


def program(share):
    return TunedProgram(None if share is None else apart(share), 1.0, 5.0, {})


def setting(text):
    name, _, value = text.partition("=")
    if name == "njmax":
        return Setting(name, text, evidence="32 at most in C", buffer_sizes={name: int(value)})
    return Setting(name, text, (Edit(Part.OPTION, name, value),))


def blocks(ratio, noise=0.0):
    present, other = 1_000_000, round(1_000_000 * ratio * (1 + noise))
    quads = [[present, other, other, present], [other, present, present, other]]
    return LaunchRow(None, None, ["ABBA", "BAAB"], quads)


@dataclass
class Planted:
    """Each setting has a time ratio and an error; ratios multiply, errors add."""

    effects: dict[str, tuple[float, float]]
    fresh_errors: dict[str, float] = field(default_factory=dict)
    fresh_ratios: dict[str, float] = field(default_factory=dict)
    fails: dict[str, str] = field(default_factory=dict)
    unsuited: str = ""
    compile_s: float = 5.0
    present_error: float = PRESENT_ERROR
    seed: int | None = None
    now_s: float = 0.0
    launches: list[tuple[int | None, tuple[str, ...], bool]] = field(default_factory=list)

    def baseline(self, plan):
        self.seed = plan.seed
        if self.unsuited:
            raise UnavailableError(self.unsuited)
        settings = [setting(text) for text in self.effects]
        rounding = apart(ROUNDING_ERROR)
        return BatchFacts(
            "cpu", Precision.FLOAT32, 64, 0.5, 31, Starts(0.1, 0.1), rounding, settings
        )

    def launch(self, settings, on_attempt, stop_after_s=None, has_errors=True):
        self.launches.append((self.seed, tuple(label(each) for each in settings), has_errors))
        self.now_s += self.compile_s
        begin_s = self.now_s
        for each in settings:
            if stop_after_s is not None and self.now_s - begin_s > stop_after_s:
                break
            self.now_s += self.compile_s
            on_attempt(self.attempt(each, has_errors))
        return program(self.present_error)

    def attempt(self, settings, has_errors):
        texts = [each.label for each in settings]
        for text in texts:
            if text in self.fails:
                return Attempt(settings, Status.TIMEOUT, self.fails[text])
        is_fresh = self.seed == 1
        ratios = [
            self.fresh_ratios.get(t, self.effects[t][0]) if is_fresh else self.effects[t][0]
            for t in texts
        ]
        errors = [
            self.fresh_errors.get(t, self.effects[t][1]) if is_fresh else self.effects[t][1]
            for t in texts
        ]
        error = self.present_error + sum(errors) if has_errors else None
        noise = 0.002 * math.sin(len(self.launches))
        samples = blocks(math.prod(ratios), noise)
        ratio = math.exp(log_ratio(samples))
        return Attempt(
            settings, Status.OK, time_ratio=ratio, program=program(error), samples=samples
        )


def searched(planted, engine="warp", **plan):
    record = TuneRecord(model="robot", engine=engine, batch=Batch(64))
    of_plan = SearchPlan(**{"budget_s": 1000.0, **plan})
    return EngineSearch(record, of_plan, planted, clock=lambda: planted.now_s).result()


def printed(record):
    return terminal.text_of(tuning.sections([record]))


def test_settings_that_help_are_combined_and_measured_in_fresh_processes_from_new_starts():
    planted = Planted(
        {"iterations=4": (0.7, 0.0), "iterations=8": (0.8, 0.0), "ls_iterations=8": (0.9, 0.0)}
    )
    record = searched(planted)
    best = record.best()
    assert label(best.settings) == "iterations=4, ls_iterations=8"
    assert best.ratio.estimate == pytest.approx(0.63, rel=0.01)
    assert best.ratio.low < best.ratio.estimate < best.ratio.high < 1
    fresh = [launch for launch in planted.launches if launch[0] == 1]
    assert len(fresh) == len(best.samples) >= LEAST_PROCESSES
    assert [has_errors for _, _, has_errors in fresh].count(True) == 1
    assert "1.59 times as fast without a larger transfer error" in printed(record)
    assert '<option iterations="4" ls_iterations="8"/>' in printed(record)


def test_a_faster_setting_that_does_not_transfer_is_in_the_table_and_not_recommended():
    record = searched(Planted({"iterations=1": (0.3, 0.2), "ls_iterations=8": (0.9, 0.0)}))
    assert [label(each.settings) for each in record.front] == ["ls_iterations=8"]
    (line,) = [line for line in printed(record).splitlines() if line.endswith("iterations=1")]
    assert line.split()[:2] == ["0.3005", "21"]  # time, and error in percent of the motion


def test_a_larger_transfer_error_is_recommended_where_it_is_allowed():
    record = searched(Planted({"iterations=1": (0.3, 0.2)}), max_error=0.25)
    assert label(record.best().settings) == "iterations=1"


def test_an_error_that_rounding_alone_makes_is_no_error():
    exact = {"present_error": 1e-9}
    assert searched(Planted({"iterations=4": (0.7, 5e-7)}, **exact)).front
    assert not searched(Planted({"iterations=4": (0.7, 5e-6)}, **exact)).front


def test_a_setting_that_adds_no_certain_gain_is_left_out():
    planted = Planted({"iterations=4": (0.7, 0.0), "solver=CG": (0.98, 0.0)})
    planted.fresh_ratios = {"solver=CG": 1.0}
    record = searched(planted)
    assert [label(each.settings) for each in record.front] == ["iterations=4"]
    assert record.withdrawn[0].reason == "not certainly faster than iterations=4 alone"


def test_what_new_starts_or_fresh_processes_do_not_confirm_is_withdrawn():
    by_error = searched(Planted({"iterations=4": (0.7, 0.0)}, fresh_errors={"iterations=4": 0.05}))
    assert not by_error.front
    assert "transfer error of 6 % of the motion" in by_error.withdrawn[0].reason
    by_time = searched(Planted({"iterations=4": (0.7, 0.0)}, fresh_ratios={"iterations=4": 1.0}))
    assert not by_time.front
    assert "not certainly faster" in by_time.withdrawn[0].reason
    assert "Withdrawn by the second look: iterations=4: not certainly faster" in printed(by_time)


def test_a_setting_that_hangs_or_overflows_is_one_line():
    planted = Planted({"njmax=40": (0.7, 0.0), "solver=CG": (0.8, 0.0)})
    planted.fails = {"njmax=40": "buffers of Warp overflowed in 3 worlds: NEFC"}
    record = searched(planted)
    assert label(record.best().settings) == "solver=CG"
    assert "Failed: njmax=40: buffers of Warp overflowed in 3 worlds: NEFC" in printed(record)


def test_buffers_are_printed_as_python_with_what_c_needs():
    text = printed(searched(Planted({"njmax=64": (0.8, 0.0)})))
    assert "mujoco_warp.make_data(model, nworld=nworld, njmax=64)" in text
    assert "njmax=64: 32 at most in C." in text
    assert "<option" not in text


def test_settings_for_which_there_is_no_time_are_counted():
    effects = {f"iterations={count}": (0.9, 0.0) for count in range(1, 40)}
    record = searched(Planted(effects, compile_s=10.0), budget_s=200.0)
    assert 0 < len([a for a in record.attempts if len(a.settings) == 1]) < len(effects)
    assert record.untried > 0
    assert record.front
    assert f"no time for {record.untried} settings" in printed(record)


def test_no_gain_is_no_recommendation():
    record = searched(Planted({"solver=CG": (1.3, 0.0)}))
    assert record.best() is None
    assert "no settings are certainly faster without a larger transfer error" in printed(record)


def test_a_model_that_the_engine_does_not_take_ends_the_search():
    planted = Planted({}, unsuited="MJX does not take this model: no PGS")
    record = searched(planted, engine="mjx")
    assert record.status == Status.UNAVAILABLE
    assert printed(record).strip() == (
        "robot on MJX: unavailable: MJX does not take this model: no PGS"
    )


def test_the_fastest_of_each_knob_is_combined_one_after_the_other():
    helpful = [
        Attempt((setting(text),), Status.OK)
        for text in ("iterations=4", "iterations=8", "solver=CG", "jacobian=dense")
    ]
    assert [label(each) for each in combinations(helpful)] == [
        "iterations=4, solver=CG",
        "iterations=4, solver=CG, jacobian=dense",
    ]
    assert combinations(helpful[:2]) == []


def test_the_interval_includes_what_differs_from_process_to_process():
    noisy, steady = (
        fresh_ratio([blocks(0.9, sign * noise) for sign in (-1, 1, -1, 1)])
        for noise in (0.05, 0.01)
    )
    assert noisy.estimate == pytest.approx(steady.estimate, rel=0.01)
    # Student's t with three degrees of freedom: 3.182 standard errors
    half_width = math.log(steady.high / steady.estimate)
    assert half_width == pytest.approx(3.182 * 0.01 * math.sqrt(4 / 3) / 2, rel=0.01)
    assert noisy.high - noisy.low > 4 * (steady.high - steady.low)
