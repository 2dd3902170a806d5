"""What may be gained by settings that were not judged, and by simpler models."""

from dataclasses import replace

import pytest
from tuning_values import apart, blocks, present

from mjbench.commands.tune import expected_gains
from mjbench.commands.tune.result import Accuracy, Attempt, Effect, Recommendation, TuneRecord
from mjbench.commands.tune.settings import Setting, option
from mjbench.interval import Interval
from mjbench.status import Status

RK4 = Setting("integrator", "integrator=Euler", evidence="one evaluation", saves=0.75)
JACOBIAN, NATIVECCD = option("jacobian", "sparse"), option("nativeccd", "enable")
COLLISION = {"narrow-phase collision": 0.5, "broad-phase collision": 0.2, "constraint solver": 0.3}
RECORD = TuneRecord(model="robot", present=present(), stages={})
ERRING = Accuracy(Effect.APPROXIMATE, apart(0.3), apart(0.3), [])
SAME = Accuracy(Effect.FREE, None, apart(0.0), [])


def test_what_saves_half_by_count_is_named_though_there_was_no_time_for_it():
    (known,) = expected_gains.unjudged(replace(RECORD, untried_halving=[RK4]))
    assert known.text == "about 4 × as fast (not timed certainly)"
    strict = replace(RECORD, untried_halving=[RK4], allow=Effect.FREE)
    assert expected_gains.unjudged(strict) == []


def test_what_was_timed_without_a_reference_says_that_its_error_is_unknown():
    timed = Attempt((RK4,), Status.OK, time_ratio=0.25, ratio=Interval(0.25, 0.24, 0.26))
    (known,) = expected_gains.unjudged(replace(RECORD, attempts=[timed]))
    assert known.text == "about 4 × as fast (its error was not measured)"
    slower = replace(timed, ratio=Interval(1.2, 1.1, 1.3))
    for judged in (slower, replace(timed, accuracy=ERRING), replace(timed, status=Status.CRASHED)):
        assert expected_gains.unjudged(replace(RECORD, attempts=[judged])) == []


def test_what_saves_by_count_is_of_a_stage_where_it_says_so():
    noslip = Setting("noslip_iterations", "n", evidence="60", saves=0.9, stages=("solver",))
    of_all = replace(RECORD, untried_halving=[noslip])
    assert expected_gains.unjudged(replace(of_all, stages={"solver": 0.3})) == []
    (known,) = expected_gains.unjudged(replace(of_all, stages={"solver": 0.8}))
    assert known.factor == pytest.approx(1 / 0.28)


def test_what_halves_the_time_in_each_launch_is_named_with_no_more_than_its_stages_take():
    launches = [blocks(0.1), blocks(0.4)]
    timed = Attempt((NATIVECCD,), Status.OK, accuracy=SAME, time_ratio=0.2, launches=launches)
    of_all = replace(RECORD, attempts=[timed])
    (known,) = expected_gains.unjudged(replace(of_all, stages={"narrow-phase collision": 0.9}))
    assert (known.factor, known.effect) == (pytest.approx(2.5), Effect.FREE)
    (known,) = expected_gains.unjudged(replace(of_all, stages={"narrow-phase collision": 0.5}))
    assert known.factor == pytest.approx(2.0)
    for other in (
        replace(timed, accuracy=replace(SAME, effect=Effect.APPROXIMATE)),
        replace(timed, ratio=Interval(0.2, 0.1, 0.3)),  # certain, and on the front if it is best
        replace(timed, launches=launches[:1]),
        replace(timed, launches=[*launches, blocks(0.6)]),
    ):
        found = replace(RECORD, attempts=[other], stages={"narrow-phase collision": 0.9})
        assert expected_gains.unjudged(found) == []


def test_a_stage_that_takes_most_of_a_step_and_that_no_setting_shortens_much_is_said():
    of_all = replace(RECORD, stages=COLLISION)
    untouched = expected_gains.untouched_stage(of_all)
    assert untouched is not None
    assert untouched.most_gain == pytest.approx(1 / 0.3)
    ratio, longer = Interval(0.8, 0.79, 0.81), option("timestep", "0.004", saves=0.5)
    shortened = replace(of_all, front=[Recommendation((NATIVECCD,), ratio, None)])
    assert expected_gains.untouched_stage(shortened) is None
    for other in (
        replace(of_all, front=[Recommendation((longer,), ratio, None)]),  # of the whole step
        replace(of_all, front=[Recommendation((JACOBIAN,), ratio, None)]),
        replace(of_all, front=[Recommendation((NATIVECCD,), ratio, None, is_allowed=False)]),
        replace(of_all, front=[Recommendation((NATIVECCD,), Interval(0.95, 0.9, 1), None)]),
    ):
        assert expected_gains.untouched_stage(other) == untouched
    small = replace(of_all, stages={"constraint solver": 0.5})
    assert expected_gains.untouched_stage(small) is None


def test_no_gain_is_expected_from_a_stage_that_the_motion_needs():
    untouched = expected_gains.untouched_stage(replace(RECORD, stages={"constraint solver": 0.8}))
    assert untouched is not None and untouched.most_gain == 1.0
