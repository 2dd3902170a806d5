"""What is measured together: the fastest way of stepping, the timer, and free settings."""

from example_races import PLAIN, ROLLOUT, raced
from tuning_values import apart

from mjbench.commands.checkup import combination
from mjbench.commands.tune.result import Accuracy, Effect, Recommendation, TuneRecord
from mjbench.commands.tune.settings import Edit, LoopChange, Part, Setting
from mjbench.interval import Interval
from mjbench.verification.plan import WITHOUT_TIMER, Variant

CLOCK = Setting("timer", "timer off", loop=LoopChange(is_clock_off=True))
JACOBIAN = Setting("jacobian", "jacobian=sparse", (Edit(Part.OPTION, "jacobian", "sparse"),))
PROCESSES = Variant("processes", {"processes": 2})


def recommended(effect: Effect, *settings: Setting) -> Recommendation:
    accuracy = Accuracy(effect, apart(0.0), apart(0.0), [0.0])
    return Recommendation(settings, Interval(0.8, 0.7, 0.9), apart(0.0), (), effect, accuracy)


def test_it_has_the_fastest_path_without_the_timer_and_with_free_settings() -> None:
    race = raced([(WITHOUT_TIMER, 1.3), (ROLLOUT, 3.0)])
    free = recommended(Effect.FREE, CLOCK, JACOBIAN)
    error = recommended(Effect.APPROXIMATE, Setting("timestep", "timestep=0.01"))
    combined = combination.combined(race, TuneRecord(model="m", front=[free, error]))
    assert combined.variant == ROLLOUT
    assert not combined.has_timer
    assert combined.settings == [JACOBIAN]
    assert combined.count == 3


def test_without_a_gain_it_is_the_plain_loop() -> None:
    race = raced([(WITHOUT_TIMER, 1.0), (ROLLOUT, 0.5)])
    combined = combination.combined(race, TuneRecord(model="m"))
    assert combined.variant == PLAIN
    assert combined.has_timer
    assert combined.count == 0
    assert combination.combined(None, None).count == 0


def test_a_setting_of_the_loop_turns_the_timer_off_as_well() -> None:
    free = recommended(Effect.FREE, CLOCK)
    combined = combination.combined(raced([(ROLLOUT, 0.5)]), TuneRecord(model="m", front=[free]))
    assert not combined.has_timer
    assert combined.settings == []
    assert combined.count == 1


def test_processes_have_a_timer_of_their_own() -> None:
    race = raced([(WITHOUT_TIMER, 1.3), (PROCESSES, 3.0)])
    assert combination.combined(race, None).has_timer


def test_settings_that_change_states_are_left_out() -> None:
    equivalent = recommended(Effect.EQUIVALENT, JACOBIAN)
    assert combination.free(TuneRecord(model="m", front=[equivalent])) is None
    assert combination.combined(None, TuneRecord(model="m", front=[equivalent])).count == 0


def test_sleep_is_left_out_where_simulations_share_mjdata() -> None:
    sleep = Setting("sleep", "sleep=enable", (Edit(Part.FLAG, "sleep", "enable"),))
    tuned = TuneRecord(model="m", front=[recommended(Effect.FREE, JACOBIAN, sleep)])
    assert combination.combined(raced([(ROLLOUT, 3.0)]), tuned).settings == [JACOBIAN]
    plain = combination.combined(raced([(ROLLOUT, 0.5)]), tuned)
    assert plain.variant == PLAIN
    assert plain.settings == [JACOBIAN, sleep]
