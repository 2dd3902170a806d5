"""What a check-up lists, judged by what longer commands measure."""

from dataclasses import replace
from typing import Any

import example_environment_records as environments
import pytest
from example_races import BATCH_STEP, ROLLOUT, THREADS, Entrant, compared, raced
from set_files import run_of
from tuning_values import apart, present

from benchmarks.studies.checkup_tally import CheckupTally, CheckupTrial, trial
from mjbench.commands.checkup.result import CheckedPart, CheckupPart
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.lint.check import Finding
from mjbench.commands.tune.result import Accuracy, Attempt, Effect, Recommendation, TuneRecord
from mjbench.commands.tune.settings import Edit, Part, Setting
from mjbench.interval import Interval
from mjbench.results.runs import Record, Run
from mjbench.status import Status

JACOBIAN = Setting("jacobian", "jacobian=sparse", (Edit(Part.OPTION, "jacobian", "sparse"),))
CONE = Setting("cone", "cone=pyramidal", (Edit(Part.OPTION, "cone", "pyramidal"),))
BEGUN = CheckupTrial(name="robot", kind=TargetKind.MODEL, seconds=58.0)
FAST, SLOWER = (ROLLOUT, 3.0), (BATCH_STEP, 2.0)


def run(*records: Record, kind: TargetKind = TargetKind.MODEL) -> Run:
    part = CheckedPart(target="robot", kind=kind, part=CheckupPart.PATHS)
    return run_of("checkup", part, *records)


def paths(*entrants: Entrant) -> list[Record]:
    return compared(raced(entrants), nbatch=64)


def tuned(*front: Recommendation, **fields: Any) -> TuneRecord:
    return TuneRecord(model="robot", present=present(), front=front, **fields)


def free(times: float, *settings: Setting, effect: Effect = Effect.FREE) -> Recommendation:
    ratio = Interval(1 / times, 0.99 / times, 1.01 / times)
    accuracy = Accuracy(effect, apart(0.0), apart(0.0), [0.0])
    return Recommendation(settings, ratio, apart(0.0), (), effect, accuracy)


def attempt(times: float, setting: Setting, reach: float = 0.01) -> Attempt:
    ratio = Interval(1 / times, (1 - reach) / times, (1 + reach) / times)
    return Attempt((setting,), Status.OK, ratio=ratio)


def test_another_way_of_stepping_that_is_as_good_is_right() -> None:
    judged = trial(BEGUN, run(*paths(FAST)), run(*paths(FAST, (THREADS, 3.1))))
    assert judged.is_right
    assert judged.again == pytest.approx(3.0, rel=0.02)


def test_one_that_is_slower_than_the_best_is_not() -> None:
    judged = trial(BEGUN, run(*paths(SLOWER)), run(*paths(FAST, SLOWER)))
    assert not judged.is_first_best
    assert judged.again == pytest.approx(2.0, rel=0.02)
    assert "rollout" in judged.best


def test_nothing_to_gain_is_right_unless_the_longer_run_gains() -> None:
    nothing = run(*paths((ROLLOUT, 0.9)))
    assert trial(BEGUN, nothing, nothing).is_right
    missed = trial(BEGUN, nothing, run(*paths(FAST)))
    assert not missed.is_first_best
    assert missed.again == 1.0


def test_settings_that_gain_nothing_in_the_longer_run_are_contradicted() -> None:
    short = run(tuned(free(1.3, JACOBIAN)))
    judged = trial(BEGUN, short, run(tuned(attempts=[attempt(1.02, JACOBIAN, reach=0.05)])))
    assert len(judged.contradicted) == 1
    assert "1.02" in judged.contradicted[0]
    assert not judged.is_right
    assert not trial(BEGUN, short, run(tuned(attempts=[attempt(1.3, JACOBIAN)]))).contradicted


def test_settings_that_were_given_up_are_contradicted_and_undecided_ones_unknown() -> None:
    short = run(tuned(free(1.3, JACOBIAN)))
    given_up = Attempt((JACOBIAN,), Status.OK, time_ratio=1.0)
    assert trial(BEGUN, short, run(tuned(attempts=[given_up]))).contradicted
    undecided = trial(BEGUN, short, run(tuned(attempts=[replace(given_up, time_ratio=0.8)])))
    assert not undecided.contradicted
    assert trial(BEGUN, short, run(tuned())).unknown == [undecided.first]


def test_a_gain_that_the_longer_run_leaves_open_is_unknown_unless_it_is_less_than_was_said() -> (
    None
):
    short = run(tuned(free(1.3, JACOBIAN)))
    undecided = trial(BEGUN, short, run(tuned(attempts=[attempt(1.25, JACOBIAN, reach=0.4)])))
    assert (undecided.contradicted, undecided.unknown) == ([], [undecided.first])
    less = trial(BEGUN, short, run(tuned(attempts=[attempt(1.02, JACOBIAN, reach=0.05)])))
    assert (len(less.contradicted), less.unknown) == (1, [])


def test_settings_that_change_more_in_the_longer_run_are_contradicted() -> None:
    short = run(tuned(free(1.3, JACOBIAN)))
    judged = trial(BEGUN, short, run(tuned(free(1.3, JACOBIAN, effect=Effect.APPROXIMATE))))
    assert judged.contradicted[0].endswith("approximate")


def test_settings_that_were_not_tried_together_have_the_best_gain_of_one() -> None:
    short = run(tuned(free(1.5, JACOBIAN, CONE)))
    longer = run(tuned(attempts=[attempt(1.2, JACOBIAN), attempt(1.1, CONE)]))
    assert trial(BEGUN, short, longer).again == pytest.approx(1.2)


def test_wrong_results_that_only_one_of_them_sees_are_not_right() -> None:
    short = run(*compared(raced([FAST]), nbatch=64, diverged=3))
    assert trial(BEGUN, short, short).is_right
    assert trial(BEGUN, short, run(*paths(FAST))).again is None


def test_of_a_program_the_first_item_is_the_same() -> None:
    begun = replace(BEGUN, kind=TargetKind.PROGRAM)
    one, other = (Finding("a.py", i, 1, "MJB001", f"fault {i}", None) for i in (1, 2))
    parts = [
        replace(
            CheckedPart(target="a.py", kind=begun.kind, part=CheckupPart.SOURCE), findings=found
        )
        for found in ([one], [other, one], [])
    ]
    first, both, none = (Run(run().header, (part,)) for part in parts)
    assert trial(begun, first, first).is_right
    assert trial(begun, none, none).is_right
    assert trial(begun, both, none).again is None


@pytest.mark.parametrize(("rollout_ns", "right"), [(20_500.0, True), (30_000.0, False)])
def test_a_path_of_an_environment_that_is_not_in_the_longer_list_has_the_gain_that_it_measured(
    rollout_ns: float, right: bool
) -> None:
    paths_of = environments.record().paths
    rollout, batch = paths_of[1], replace(paths_of[2], closed_loop=False)
    of_rollout, of_both = (
        environments.record(paths=[paths_of[0], *others], vectors=[])
        for others in (
            [rollout],
            [
                replace(rollout, ns=environments.steady(rollout_ns)),
                replace(batch, ns=environments.steady(20_000.0)),
            ],
        )
    )
    begun = replace(BEGUN, name="Robot-v0", kind=TargetKind.ENVIRONMENT)
    runs = [run(each, kind=TargetKind.ENVIRONMENT) for each in (of_rollout, of_both)]
    judged = trial(begun, *runs)
    assert "rollout" in judged.first
    assert "Batch.step" in judged.best
    assert judged.again == pytest.approx(100_000.0 / rollout_ns)
    assert judged.is_right == right


def test_the_page_counts_what_is_right_by_kind() -> None:
    right = replace(BEGUN, first="rollout", again=3.0, best="rollout", best_gain=3.0)
    slow = replace(right, name="arm", seconds=70.0, again=2.0, contradicted=["cone: 1.00"])
    failed = CheckupTrial(name="train.py", kind=TargetKind.PROGRAM, detail="no file")
    tally = CheckupTally("4.0.0", "a CPU", 2, ())
    assert "Nothing has been measured" in "".join(tally.lines())
    for each in (slow, right, failed):
        tally = tally.with_trial(each)
    text = "\n".join(tally.with_trial(slow).lines())
    assert (
        "**models**: the first advice has 0.95 of the best gain or more for 1 of 2; 1 took" in text
    )
    assert "`arm` is contradicted: cone: 1.00" in text
    assert "`train.py` was not measured: no file" in text
    assert text.count("`arm` is contradicted") == 1
