"""The search, with measurements that are planted."""

import math
from dataclasses import replace

import pytest
from tuning_values import PRESENT_ERROR, apart, blocks, present

from mjbench.commands.tune import notes as tuning_notes
from mjbench.commands.tune import pareto_front
from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.c_search import (
    FEW_NRUN,
    LEAST_LAUNCHES,
    MOST_LAUNCHES,
    CSearch,
    SearchPlan,
)
from mjbench.commands.tune.knobs import KNOBS
from mjbench.commands.tune.result import Accuracy, Attempt, Effect, Limits, TuneRecord, log_ratio
from mjbench.commands.tune.settings import LoopChange, Setting
from mjbench.errors import MachineError
from mjbench.interval import Interval
from mjbench.status import Status


def setting(label, **keywords):
    return Setting(label.partition("=")[0], label, **keywords)


class Planted:
    """Measurements in which settings have times that multiply, and errors that add up."""

    def __init__(self, **effects):
        """Take (effect, time ratio, error) of each setting, by its label with `_` for `=`."""
        self.effects = {label.replace("_", "="): value for label, value in effects.items()}
        self.asked = []
        self.fails = {}
        self.fresh = {}
        self.present_errors = (PRESENT_ERROR, PRESENT_ERROR)
        self.is_comparable = True
        self.limited = 0.0
        self.changed_sensors = {}
        self.changes = {}
        self.references = 0
        self.failing_references = ()
        self.reference_s = self.really_s = self.present_s = 0.0
        self.seed = None
        self.now_s = 0.0
        self.settings = [setting(label) for label in self.effects]

    def survey(self, seed, computing_s):
        return self.settings

    def present(self, plan):
        self.seed, self.has_reference = plan.seed, False
        self.now_s += self.present_s
        return replace(self._facts(), error=None), {}, None, self.reference_s

    def reference(self, horizon_ncontrol=None):
        self.references += 1
        self.now_s += self.really_s
        if self.seed in self.failing_references:
            raise MachineError("robot: crashed")
        self.has_reference = True
        return self._facts()

    def _facts(self):
        error = self.present_errors[self.seed > 0]
        return present(error, self.is_comparable, self.limited)

    def launch(self, request):
        self.now_s += 0.5
        attempts = []
        begin_s = self.now_s
        for settings in request.settings:
            if self.now_s - begin_s > request.stop_after_s:
                break
            attempts.append(self.attempt(settings, request))
        return attempts

    def attempt(self, settings, request):
        self.now_s += 0.1 + (1.0 if request.nrun is None else 0.0)
        labels = tuple(each.label for each in settings)
        self.asked.append((self.seed, labels, request.nrun))
        for label in labels:
            if label in self.fails:
                return Attempt(settings, Status.CRASHED, self.fails[label])
        effects = self.fresh if self.seed == 1 else {}
        of_each = [effects.get(label, self.effects[label]) for label in labels]
        attempt = Attempt(settings, Status.OK)
        if request.nrun != 0:
            effect = max((each[0] for each in of_each), key=lambda each: each.rank)
            error = PRESENT_ERROR + sum(each[2] for each in of_each)
            changed = max(self.changed_sensors.get(label, 0) for label in labels)
            apart_from = apart(error) if self.has_reference else None
            pairs = zip(labels, of_each, strict=True)
            moved = sum(self.changes.get(label, each[2]) for label, each in pairs)
            accuracy = Accuracy(effect, apart_from, apart(moved), [error] * 64, changed)
            attempt = replace(attempt, accuracy=accuracy)
        if request.timed_s:
            noise = 1 + 0.002 * (len(self.asked) % 3)
            samples = blocks(noise * math.prod(each[1] for each in of_each))
            attempt = replace(attempt, time_ratio=math.exp(log_ratio(samples)), launches=[samples])
        return attempt


def searched(planted, **plan):
    of_plan = SearchPlan(**{"budget_s": 1000.0, **plan})
    record = TuneRecord(model="robot")
    return CSearch(record, of_plan, planted, clock=lambda: planted.now_s).result()


def labels(recommendation):
    return sorted(each.label for each in recommendation.settings)


FREE, EQUIVALENT, APPROXIMATE = Effect


def test_settings_that_help_are_combined_by_what_they_change():
    record = searched(
        Planted(
            jacobian_dense=(FREE, 0.9, 0.0),
            island_disable=(FREE, 0.95, 0.0),
            solver_CG=(EQUIVALENT, 0.8, 0.0),
            timestep_2=(APPROXIMATE, 0.5, 0.02),
            cone_elliptic=(FREE, 1.2, 0.0),
        )
    )
    free, equivalent, approximate = record.front
    assert labels(free) == ["island=disable", "jacobian=dense"]
    assert labels(equivalent) == ["island=disable", "jacobian=dense", "solver=CG"]
    assert "timestep=2" in labels(approximate) and "solver=CG" in labels(approximate)
    assert free.ratio.estimate == pytest.approx(0.855, rel=0.01)
    assert record.best() == equivalent  # the timestep doubles the error


def test_a_larger_error_is_recommended_where_it_is_allowed():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.02))
    assert labels(searched(planted, limits=Limits(0.05)).best()) == ["timestep=2"]
    assert searched(planted, limits=Limits(0.03)).best() is None


def test_a_change_of_the_present_motion_is_bounded_whatever_the_error_is():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.3), tolerance_3=(APPROXIMATE, 0.8, 0.0))
    planted.changes = {"timestep=2": 0.02, "tolerance=3": 0.001}
    (best,) = searched(planted, limits=Limits(max_change=0.01)).front
    assert labels(best) == ["tolerance=3"]
    both = searched(planted, limits=Limits(max_change=0.05)).best()
    assert "timestep=2" in labels(both)
    assert both.accuracy.distance.share == pytest.approx(0.021)
    assert labels(searched(planted, limits=Limits(0.1, 0.05)).best()) == ["tolerance=3"]


def test_a_change_that_new_starts_do_not_confirm_is_withdrawn():
    planted = Planted(solver_CG=(EQUIVALENT, 0.5, 0.0))
    planted.fresh = {"solver=CG": (EQUIVALENT, 0.5, 0.02)}
    record = searched(planted, limits=Limits(max_change=0.01))
    assert not record.front
    assert record.withdrawn[0].reason == (
        "a change of 2 % of the motion from new starts, where 1 % is allowed"
    )


def test_only_settings_that_are_named_are_tried():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(FREE, 0.5, 0.0))
    record = searched(planted, knobs=("jacobian",))
    assert [each.settings[0].label for each in record.attempts] == ["jacobian=dense"]


def test_an_approximate_setting_with_the_same_error_is_recommended():
    record = searched(Planted(tolerance_3=(APPROXIMATE, 0.8, 0.0001)))
    assert labels(record.best()) == ["tolerance=3"]


def test_only_what_may_change_is_tried_together():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    record = searched(planted, allow=Effect.FREE)
    assert [labels(each) for each in record.front] == [["jacobian=dense"]]


def test_what_new_starts_do_not_confirm_is_withdrawn():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0))
    planted.fresh = {"jacobian=dense": (APPROXIMATE, 0.9, 0.0)}
    record = searched(planted)
    assert not record.front
    assert "free in the search, approximate from new starts" in record.withdrawn[0].reason


def test_an_error_that_grows_beyond_the_limit_is_withdrawn():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.01))
    planted.fresh = {"timestep=2": (APPROXIMATE, 0.5, 0.04)}
    record = searched(planted, limits=Limits(0.04))
    assert "an error of 6 %" in record.withdrawn[0].reason


def test_the_promised_error_is_the_larger_of_both_looks():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.01))
    planted.fresh = {"timestep=2": (APPROXIMATE, 0.5, 0.005)}
    assert searched(planted, limits=Limits(0.5)).front[0].error.share == pytest.approx(0.03)


def test_a_setting_that_gives_something_up_is_listed_and_not_recommended():
    planted = Planted(sensor_disable=(FREE, 0.5, 0.0))
    planted.settings = [setting("sensor=disable", loses="sensor data")]
    record = searched(planted)
    assert not record.front
    assert record.attempts[0].ratio.estimate == pytest.approx(0.5, rel=0.01)


def test_a_setting_that_changes_sensor_data_is_listed_and_not_recommended():
    planted = Planted(multiccd_disable=(APPROXIMATE, 0.2, 0.0))
    planted.changed_sensors = {"multiccd=disable": 284}
    record = searched(planted)
    assert not record.front
    assert record.attempts[0].accuracy.changed_sensors == 284


def test_a_setting_that_crashes_is_one_row_and_the_rest_goes_on():
    planted = Planted(solver_CG=(FREE, 0.8, 0.0), jacobian_dense=(FREE, 0.9, 0.0))
    planted.fails = {"solver=CG": "killed by SIGSEGV"}
    record = searched(planted)
    assert labels(record.best()) == ["jacobian=dense"]
    (failed,) = [row for row in record.attempts if row.status != Status.OK]
    assert failed.detail == "killed by SIGSEGV"


@pytest.mark.parametrize("failing_nrun", [None, 0])
def test_a_setting_that_crashes_later_is_no_candidate_any_more(failing_nrun):
    class CrashesLater(Planted):
        def attempt(self, settings, request):
            is_known = any(nrun == FEW_NRUN for _, _, nrun in self.asked)
            attempt = super().attempt(settings, request)
            if is_known and request.nrun == failing_nrun:
                return Attempt(settings, Status.CRASHED, "killed by SIGSEGV")
            return attempt

    record = searched(CrashesLater(jacobian_dense=(FREE, 0.5, 0.0)))
    (failed,) = record.attempts
    assert failed.status == Status.CRASHED
    assert failed.accuracy is failed.ratio is failed.time_ratio is None
    assert not record.front and not record.withdrawn
    assert tuning.faster_alone(record) == []


def test_no_gain_is_no_recommendation():
    record = searched(Planted(jacobian_dense=(FREE, 0.998, 0.0), solver_PGS=(FREE, 1.4, 0.0)))
    assert not record.front and not record.withdrawn and record.best() is None


def test_the_second_look_has_other_starts():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0))
    searched(planted, seed=0)
    assert planted.asked[-1][:2] == (1, ("jacobian=dense",))


def test_settings_for_which_there_is_no_time_are_counted():
    effects = {f"timestep_{i}": (FREE, 0.9, 0.0) for i in range(400)}
    record = searched(Planted(**effects), budget_s=60.0)
    assert record.untried > 0
    assert record.front


def test_what_is_not_certainly_faster_together_leaves_what_is_alone():
    class OnceFaster(Planted):
        def attempt(self, settings, request):
            of_pair = len(settings) > 1 and request.nrun == 0
            self.effects["island=disable"] = (FREE, 1.2 if of_pair else 0.95, 0.0)
            return super().attempt(settings, request)

    planted = OnceFaster(jacobian_dense=(FREE, 0.9, 0.0), island_disable=(FREE, 0.95, 0.0))
    planted.present_s = 10.0
    record = searched(planted, budget_s=30.0)
    assert labels(record.best()) == ["jacobian=dense"] and not record.withdrawn


def test_all_settings_are_screened_in_a_short_search():
    effects = {f"iterations_{i}": (FREE, 1.0, 0.0) for i in range(25)}
    planted = Planted(**effects, timestep_8=(APPROXIMATE, 0.1, 0.0))
    record = searched(planted, budget_s=15.0)
    assert record.untried == 0
    assert len(record.attempts) == 26
    best = min(record.attempts, key=lambda each: each.time_ratio)
    assert best.settings[0].label == "timestep=8" and best.ratio.high < 0.2


def test_likely_gains_come_first():
    planted = Planted(jacobian_sparse=(FREE, 0.9, 0.0), timestep_8=(APPROXIMATE, 0.2, 0.0))
    planted.settings = [setting("jacobian=sparse"), setting("timestep=8", saves=0.875)]
    searched(planted)
    assert planted.asked[0][1] == ("timestep=8",)


def test_what_halves_the_work_by_count_is_named_where_there_was_no_time_for_it():
    planted = Planted(jacobian_sparse=(FREE, 0.9, 0.0), timestep_8=(APPROXIMATE, 0.2, 0.0))
    planted.settings = [setting("jacobian=sparse"), setting("timestep=8", saves=0.875)]
    planted.present_s = 5.0
    record = searched(planted, budget_s=5.0)
    assert record.untried == 2
    assert [each.label for each in record.untried_halving] == ["timestep=8"]


def test_the_reference_is_run_only_where_a_faster_setting_changes_the_motion():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 1.2, 0.0))
    record = searched(planted)
    assert planted.references == 0
    assert record.present.error is record.front[0].error is None
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    searched(planted)
    assert planted.references == 2  # of each look


def test_the_figures_are_of_launches_that_have_not_chosen_the_setting():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0))
    (attempt,) = searched(planted).attempts
    chosen_by, *timed = [nrun for seed, _, nrun in planted.asked if seed == 0 and nrun != FEW_NRUN]
    assert chosen_by == 0
    assert len(attempt.launches) == len(timed)


def test_where_the_solver_does_not_converge_its_error_excuses_no_other():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.0))
    assert searched(planted).best() is not None
    planted.limited = 0.98
    record = searched(planted)
    assert record.best() is None
    assert not record.present.is_converged
    assert labels(searched(planted, limits=Limits(0.03)).best()) == ["timestep=2"]


def test_without_a_reference_settings_that_need_no_error_are_recommended():
    planted = Planted(
        jacobian_dense=(FREE, 0.9, 0.0),
        solver_CG=(EQUIVALENT, 0.8, 0.0),
        timestep_2=(APPROXIMATE, 0.5, 0.0),
    )
    planted.failing_references = (0,)
    record = searched(planted)
    assert (record.status, record.no_reference) == (Status.OK, "crashed")
    assert [labels(each) for each in record.front] == [
        ["jacobian=dense"],
        ["jacobian=dense", "solver=CG"],
    ]
    limited = searched(planted, limits=Limits(0.1))
    assert [labels(each) for each in limited.front] == [["jacobian=dense"]]
    assert "no reference from which to measure" in "\n".join(tuning_notes.notes(record))


def test_without_a_reference_from_new_starts_errors_are_those_of_the_search():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    planted.failing_references = (1,)
    record = searched(planted)
    assert record.status == Status.OK and not record.withdrawn
    free, approximate = record.front
    assert labels(free) == ["jacobian=dense"]
    assert labels(approximate) == ["jacobian=dense", "timestep=2"]
    assert approximate.error.share == pytest.approx(PRESENT_ERROR)
    (line,) = tuning_notes.left_out(record)
    assert line.endswith("so errors are those of the search: crashed")


def test_a_reference_for_which_there_is_no_time_is_not_begun():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    planted.reference_s = 2000.0
    record = searched(planted)
    assert planted.references == 0
    assert record.no_reference.startswith("it takes about 2000 s, and 99")
    assert [labels(each) for each in record.front] == [["jacobian=dense"]]


def test_a_reference_that_took_long_is_not_run_again_without_time_for_it():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    planted.really_s = 700.0
    record = searched(planted)
    assert planted.references == 1
    assert record.no_reference.startswith("it takes about 700 s")
    assert labels(record.best()) == ["jacobian=dense", "timestep=2"]


def test_an_error_limit_of_the_user_has_the_reference_run_for_equivalent_settings():
    planted = Planted(solver_CG=(EQUIVALENT, 0.5, 0.01))
    (found,) = searched(planted, limits=Limits(0.05)).front
    assert planted.references == 2  # of each look
    assert found.error.share == pytest.approx(0.03)
    planted.fresh = {"solver=CG": (EQUIVALENT, 0.5, 0.1)}
    record = searched(planted, limits=Limits(0.05))
    assert not record.front and "an error of 12 %" in record.withdrawn[0].reason


def test_a_setting_that_errs_by_more_than_half_of_the_motion_from_new_starts_is_withdrawn():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.3))
    (beyond,) = searched(planted).front
    assert not beyond.is_allowed
    planted.fresh = {"timestep=2": (APPROXIMATE, 0.5, 0.6)}
    record = searched(planted)
    assert not record.front and "where 50 % is allowed" in record.withdrawn[0].reason


class Slow(Planted):
    """Measurements whose launches of full runs, from some starts, have time for one setting."""

    def __init__(self, seed, **effects):
        super().__init__(**effects)
        self.slow_seed = seed

    def launch(self, request):
        if request.nrun is None and self.seed == self.slow_seed:
            assert math.isfinite(request.stop_after_s)
            request = replace(request, stop_after_s=0.0)
        return super().launch(request)


def test_a_setting_whose_error_there_was_no_time_for_is_untried():
    slow = Slow(0, jacobian_x=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    record = searched(slow)
    assert (record.untried, record.untried_combinations) == (1, 0)
    assert labels(record.best()) == ["timestep=2"]


def test_combinations_for_which_there_was_no_time_are_counted_apart():
    names = [knob.name for knob in KNOBS if "_" not in knob.name][:6]
    effects = {f"{name}_x": (APPROXIMATE, 0.9 - 0.01 * i, 0.0) for i, name in enumerate(names)}

    class HasTimeForOne(Planted):
        def launch(self, request):
            if self.seed == 0 and any(len(each) > 1 for each in request.settings):
                request = replace(request, stop_after_s=0.0)
            return super().launch(request)

    record = searched(HasTimeForOne(**effects))
    assert record.untried == 0
    assert record.untried_combinations > 0
    text = "\n".join(tuning_notes.notes(record))
    assert f"no time for {record.untried_combinations} combinations" in text


def test_settings_for_which_there_is_no_time_from_new_starts_are_untried():
    slow = Slow(1, jacobian_x=(FREE, 0.9, 0.0), timestep_2=(APPROXIMATE, 0.5, 0.0))
    record = searched(slow)
    assert labels(record.front[0]) == ["jacobian=x"]
    assert record.untried_combinations == 1
    assert not record.withdrawn


@pytest.mark.parametrize("after", [4, 1])
@pytest.mark.parametrize("failure", [KeyboardInterrupt, MachineError])
def test_what_new_starts_confirm_is_recommended_although_the_last_launches_fail(after, failure):
    class Fails(Planted):
        nlaunch = 0

        def launch(self, request):
            if self.seed == 1:
                self.nlaunch += 1
                if self.nlaunch > after:
                    raise failure("crashed")
            return super().launch(request)

    record = searched(Fails(jacobian_dense=(FREE, 0.9, 0.0)))
    assert record.status in (Status.INTERRUPTED, Status.FAILED)
    assert [labels(each) for each in record.front] == [["jacobian=dense"]]
    assert not record.withdrawn


def test_ctrl_c_keeps_what_was_tried():
    class Interrupted(Planted):
        def launch(self, request):
            if len(self.asked) > 5:
                raise KeyboardInterrupt
            return super().launch(request)

    record = searched(Interrupted(jacobian_dense=(FREE, 0.9, 0.0), solver_PGS=(FREE, 1.4, 0.0)))
    assert record.status == Status.INTERRUPTED
    assert {each.settings[0].label for each in record.attempts} == {"solver=PGS", "jacobian=dense"}


def test_a_search_that_runs_out_of_time_keeps_what_was_confirmed_alone():
    names = [knob.name for knob in KNOBS if "_" not in knob.name][:6]
    effects = {f"{name}_x": (APPROXIMATE, 0.9 - 0.01 * i, 0.0) for i, name in enumerate(names)}
    for budget_s in range(60, 200, 10):
        planted = Planted(**effects)
        record = searched(planted, budget_s=float(budget_s))
        alone = [row for row in record.attempts if row.ratio is not None]
        assert bool(record.front) == bool(alone), budget_s
        tried = {tuple(each.label for each in row.settings) for row in record.attempts}
        for each in record.front:
            assert tuple(one.label for one in each.settings) in tried


def test_what_comes_next_is_looked_at_where_settings_are_withdrawn():
    planted = Planted(excludes_5=(FREE, 0.7, 0.0), jacobian_sparse=(FREE, 0.9, 0.0))
    planted.fresh = {"excludes=5": (APPROXIMATE, 0.7, 0.5)}
    record = searched(planted)
    assert labels(record.best()) == ["jacobian=sparse"]
    (withdrawn,) = record.withdrawn
    assert labels(withdrawn) == ["excludes=5", "jacobian=sparse"]


def test_what_comes_next_has_an_error_where_it_needs_one():
    class NotTogether(Planted):
        def launch(self, request):
            alone = [each for each in request.settings if len(each) == 1]
            return super().launch(replace(request, settings=alone))

    planted = NotTogether(excludes_5=(FREE, 0.5, 0.0), timestep_2=(APPROXIMATE, 0.7, 0.0))
    planted.fresh = {"excludes=5": (APPROXIMATE, 0.5, 0.5)}
    assert labels(searched(planted).best()) == ["timestep=2"]


def test_each_look_has_a_limit_of_its_own():
    planted = Planted(timestep_2=(APPROXIMATE, 0.5, 0.07))
    planted.present_errors = (0.1, 0.02)
    record = searched(planted)
    assert record.best() is None
    assert "where 2.1 % is allowed" in record.withdrawn[0].reason


def test_an_equivalent_setting_has_to_keep_to_a_limit_of_the_user():
    planted = Planted(solver_CG=(EQUIVALENT, 0.5, 0.4))
    assert searched(planted).best() is not None
    assert searched(planted, limits=Limits(0.01)).best() is None


def test_where_errors_cannot_be_compared_nothing_that_changes_the_motion_is_recommended():
    planted = Planted(
        jacobian_dense=(FREE, 0.9, 0.0),
        solver_CG=(EQUIVALENT, 0.5, 0.0),
        timestep_2=(APPROXIMATE, 0.5, 0.0),
    )
    planted.is_comparable = False
    front = [labels(each) for each in searched(planted).front]
    assert front == [["jacobian=dense"], ["jacobian=dense", "solver=CG"]]


def faster(label, effect, ratio, **keywords):
    accuracy = Accuracy(effect, apart(0.1), apart(0.1), [0.1] * 64)
    settings = (setting(label, **keywords),)
    timed = Interval(ratio, None, None)
    return Attempt(settings, Status.OK, accuracy=accuracy, time_ratio=ratio, ratio=timed)


def test_combinations_have_one_setting_of_each_knob():
    of_knobs = [
        faster("solver=CG", EQUIVALENT, 0.9),
        faster("solver=PGS", APPROXIMATE, 0.7),
        faster("timestep=2", APPROXIMATE, 0.5),
        faster("timestep=4", APPROXIMATE, 0.25),
        faster("cone=pyramidal", APPROXIMATE, 0.9),
    ]
    drawn = pareto_front.combinations(of_knobs)
    for combination in drawn:
        knobs = [each.knob for each in combination]
        assert len(knobs) == len(set(knobs)) > 1
    as_labels = {tuple(each.label for each in combination) for combination in drawn}
    assert len(as_labels) == len(drawn)
    assert ("cone=pyramidal", "solver=PGS", "timestep=4") in as_labels
    assert ("solver=CG", "timestep=2") in as_labels
    assert ("cone=pyramidal", "solver=CG", "timestep=2") in as_labels


def test_settings_of_the_loop_exclude_each_other():
    of_loop = [
        faster("clock off", FREE, 0.9, loop=LoopChange(is_clock_off=True)),
        faster("engine_threads", FREE, 0.8, loop=LoopChange(engine_threads=2)),
    ]
    assert pareto_front.combinations(of_loop) == []


def test_settings_are_launched_until_time_is_up_and_at_least_some_times():
    planted = Planted(jacobian_dense=(FREE, 0.9, 0.0))
    for budget_s, most in ((5.0, LEAST_LAUNCHES), (1000.0, MOST_LAUNCHES)):
        (attempt,) = searched(planted, budget_s=budget_s).attempts
        assert len(attempt.launches) == most


def test_a_setting_that_seems_slower_is_launched_once():
    planted = Planted(jacobian_dense=(FREE, 1.2, 0.0), island_disable=(FREE, 1.02, 0.0))
    attempts = {row.settings[0].label: row for row in searched(planted).attempts}
    assert len(attempts["jacobian=dense"].launches) == 1
    assert len(attempts["island=disable"].launches) == 2


def test_without_time_for_a_second_look_what_is_certain_is_recommended_and_that_is_said_once():
    planted = Planted(jacobian_dense=(FREE, 0.5, 0.0), island_off=(FREE, 0.7, 0.0))
    planted.present_s = 5.0
    record = searched(planted, budget_s=18.0)
    assert labels(record.best()) == ["island=off", "jacobian=dense"]
    assert record.best().ratio.estimate == pytest.approx(0.35, rel=0.01)
    assert not record.withdrawn
    assert planted.seed == 0, "the second look, which has the next seed, did not begin"
    assert len(record.front[0].samples) == LEAST_LAUNCHES, "without the launch that chose them"
    (line,) = [each for each in tuning_notes.left_out(record) if "new starts" in each]
    assert line.startswith("Not run again from new starts: it takes about ")


def test_no_search_takes_longer_than_its_budget_but_for_what_it_has_begun():
    effects = {f"{knob.name.replace('_', '-')}_x": (APPROXIMATE, 0.8, 0.0) for knob in KNOBS}
    for budget_s in (10.0, 20.0, 40.0, 80.0):
        planted = Planted(**effects)
        planted.present_s, planted.reference_s, planted.really_s = 3.0, 2.0, 4.0
        assert searched(planted, budget_s=budget_s).seconds <= budget_s + 4.0
