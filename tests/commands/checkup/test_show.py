"""The ranked list of a check-up: its order, its figures, and what it says without any gain."""

from dataclasses import replace
from typing import Any

import example_environment_records
import pytest
from example_races import BATCH_STEP, ROLLOUT, compared, raced
from set_files import run_of
from step_profiles import step_profile
from tuning_values import apart, blocks, present
from verdict_records import FASTER, SAME

from mjbench.commands.checkup import ranking
from mjbench.commands.checkup import show as checkup
from mjbench.commands.checkup.item import GainUnit, ResultChange
from mjbench.commands.checkup.result import CheckedPart, CheckupPart, Combination
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.compare import advice
from mjbench.commands.compare.results import derive_all
from mjbench.commands.lint.check import Finding
from mjbench.commands.run import show as program
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.launch import UncaughtException
from mjbench.commands.run.loop_time import LineTime, LoopTime
from mjbench.commands.run.remedies.remedy import Remedy, RemedyKind
from mjbench.commands.run.result import LoopReport, ProgramRow
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.commands.show import reports
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.result import (
    Accuracy,
    Attempt,
    Effect,
    Recommendation,
    TuneRecord,
    Withdrawal,
)
from mjbench.commands.tune.settings import Edit, LoopChange, Part, Setting
from mjbench.interval import Interval
from mjbench.results import terminal
from mjbench.results.content import Tone
from mjbench.results.runs import Record, Run
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER

CLOCK = Setting("timer", "timer off", loop=LoopChange(is_clock_off=True))
JACOBIAN = Setting("jacobian", "jacobian=sparse", (Edit(Part.OPTION, "jacobian", "sparse"),))
TIMESTEP = Setting("timestep", "timestep=0.004", (Edit(Part.OPTION, "timestep", "0.004"),))
SENSOR = Setting("sensor", "sensor=disable", loses="sensor data")
SLOW = Attempt((JACOBIAN,), Status.OK, time_ratio=1.1)
TARGET = "my robot.xml"


def part(name: CheckupPart, kind: TargetKind = TargetKind.MODEL, **fields: Any) -> CheckedPart:
    return CheckedPart(target=TARGET, kind=kind, part=name, **fields)


def run(*records: Record) -> Run:
    return run_of("checkup", *records)


def of_paths(*entrants: Any, **fields: Any) -> list[Record]:
    return [part(CheckupPart.PATHS), *compared(raced(entrants), nbatch=64, **fields)]


def recommended(effect: Effect, ratio: float, error: float, *settings: Setting) -> Recommendation:
    accuracy = Accuracy(effect, apart(error), apart(error), [error])
    interval = Interval(ratio, ratio - 0.01, ratio + 0.01)
    return Recommendation(settings, interval, apart(error), (), effect, accuracy)


def tuned(*front: Recommendation, **fields: Any) -> TuneRecord:
    return TuneRecord(model=TARGET, present=present(), front=front, **fields)


PATHS = of_paths((WITHOUT_TIMER, 1.3), (ROLLOUT, 3.0), (BATCH_STEP, 2.0))
FREE = recommended(Effect.FREE, 0.4, 0.0, CLOCK, JACOBIAN)
LONGER = recommended(Effect.APPROXIMATE, 0.2, 0.03, TIMESTEP)


def test_what_keeps_results_comes_before_what_changes_them_and_larger_gains_first() -> None:
    listed = ranking.items(run(*PATHS, part(CheckupPart.SETTINGS), tuned(FREE, LONGER)))
    assert [item.action for item in listed] == [
        "Batch.step on 2 threads (RL)",
        "mujoco.rollout on 2 threads (open loop)",
        "settings: timer off, jacobian=sparse",
        "settings: timestep=0.004",
    ]
    assert [item.change_text for item in listed] == [
        "none",
        "none",
        "none seen",
        "3 % of the motion",
    ]
    assert listed[3].error == 0.03


RK4 = Setting("integrator", "integrator=Euler", evidence="one evaluation", saves=0.75)


def test_what_halves_the_work_by_count_comes_first_though_it_is_not_timed() -> None:
    found = tuned(FREE, untried_halving=[RK4])
    measured = run(*PATHS, part(CheckupPart.SETTINGS), found)
    first, *others = ranking.items(measured)
    assert (first.action, first.is_halving) == ("settings: integrator=Euler", True)
    assert not any(each.is_halving for each in others)
    assert checkup.list_section(measured).conclusions[0].text == (
        f"{TARGET}: about 4 × as fast (not timed certainly) with settings: integrator=Euler;"
        " changes in results: of unknown size"
    )


def test_a_recommendation_that_halves_the_work_is_as_important_as_one_that_keeps_results() -> None:
    halving = recommended(Effect.APPROXIMATE, 0.2, 0.01, RK4)
    actions = [item.action for item in ranking.items(run(*PATHS, tuned(FREE, halving)))]
    assert actions[0] == "settings: integrator=Euler"
    far = replace(halving, is_allowed=False)  # its error is larger than allowed
    actions = [item.action for item in ranking.items(run(*PATHS, tuned(FREE, far)))]
    assert actions[-1] == "settings: integrator=Euler"


def test_what_is_measured_together_is_no_conclusion_where_less_gains_more() -> None:
    verdict = replace(FASTER, ratio=Interval(0.3, 0.29, 0.31))
    equivalent = tuned(recommended(Effect.EQUIVALENT, 0.25, 0.0, JACOBIAN))
    records = [*PATHS, equivalent, combined(verdict)]
    assert "4.00 × as fast" in checkup.list_section(run(*records)).conclusions[0].text
    records = [*PATHS, tuned(untried_halving=[RK4]), combined(verdict)]
    assert "about 4 × as fast" in checkup.list_section(run(*records)).conclusions[0].text
    faster = combined(replace(FASTER, ratio=Interval(0.2, 0.19, 0.21)))
    section = checkup.list_section(run(*records[:-1], faster))
    assert "5.00 × as fast" in section.conclusions[0].text


def test_a_stage_that_no_setting_shortens_comes_first_where_it_costs_more_than_is_gained() -> None:
    for share, is_first in ((0.8, True), (0.7, False)):
        record = tuned(stages={"collision": share, "constraint solver": 1 - share})
        paths = of_paths((BATCH_STEP, 4.0))
        texts = [each.text for each in checkup.list_section(run(*paths, record)).conclusions]
        stage = f"{100 * share:.0f} % of a step is collision"
        line = f"{TARGET}: {stage}: simpler or fewer geoms would help most"
        assert texts.index(line) == (0 if is_first else 1)


def test_settings_that_err_much_are_a_note_and_not_listed() -> None:
    far = recommended(Effect.APPROXIMATE, 0.1, 0.6, TIMESTEP)
    section = checkup.list_section(run(tuned(FREE, LONGER, far), part(CheckupPart.SETTINGS)))
    errors = [item.error for item in ranking.items(run(part(CheckupPart.SETTINGS), tuned(far)))]
    assert errors == []
    assert [row[3] for row in section.tables[0].rows] == [
        "settings: timer off, jacobian=sparse",
        "settings: timestep=0.004",
    ]
    assert (
        "Not listed: timestep=0.004: 10.00 × as fast, but with an error of 60 % of the motion:"
        " mjbench tune 'my robot.xml'"
    ) in section.notes
    assert not [
        note
        for note in checkup.list_section(run(*PATHS, tuned(FREE, LONGER))).notes
        if note.startswith("Not listed")
    ]


def test_effects_too_slow_for_short_runs_are_notes_of_what_is_listed() -> None:
    slip = Setting("noslip_iterations", "noslip_iterations=0")
    changing = recommended(Effect.APPROXIMATE, 0.2, 0.03, slip)
    notes = checkup.list_section(run(part(CheckupPart.SETTINGS), tuned(FREE, changing))).notes
    slow = "with noslip_iterations=0, what is held or stacked may slip over many seconds"
    assert any(f"Not shown by simulations this short: {slow}" in note for note in notes)


def test_figures_are_those_of_the_commands_that_look_closer() -> None:
    measured = run(*PATHS, tuned(FREE))
    (open_loop, closed_loop) = advice.advise(derive_all(measured.records)[0])
    first, second, settings = ranking.items(measured)
    assert (first.gain, second.gain) == (closed_loop.speedup, open_loop.speedup)
    assert first.unit == GainUnit.PLAIN_LOOP
    assert first.command == "mjbench compare 'my robot.xml'"
    assert settings.command == "mjbench tune 'my robot.xml'"
    assert settings.gain is not None
    assert f"{settings.gain.estimate:.2f} times as fast" in tuning.conclusion(tuned(FREE))


def test_the_first_sentence_says_what_is_probable_and_fits_100_characters() -> None:
    race = raced([(ROLLOUT, 1.5)], spread=0.3, launches=3)
    unsure = [part(CheckupPart.PATHS), *compared(race, nbatch=64)]
    text = checkup.list_section(run(*unsure)).conclusions[0].text
    assert ": probably 1." in text
    assert len(text) <= 100


def test_gains_say_below_the_table_what_they_are_multiples_of() -> None:
    notes = checkup.list_section(run(*PATHS, tuned(FREE))).notes
    assert "Gain of 1 and 2: × as fast as a plain Python loop, 64 simulations at once" in notes


def test_the_timer_is_one_item_unless_settings_turn_it_off() -> None:
    turned_off = [item for item in ranking.items(run(*PATHS)) if "Callbacks" in item.action]
    assert [item.gain_text for item in turned_off] == ["1.30 ×"]
    actions = [item.action for item in ranking.items(run(*PATHS, tuned(FREE)))]
    assert not any("Callbacks" in action for action in actions)
    changing = recommended(Effect.APPROXIMATE, 0.2, 0.03, CLOCK, TIMESTEP)
    assert [item for item in ranking.items(run(*PATHS, tuned(changing))) if "timer" in item.action]


def test_the_share_that_a_program_saves_lies_within_the_whole() -> None:
    line = Remedy(RemedyKind.COLLECTION, Activity.COLLECTION, None, "text", 0.8, 0.2)
    assert line.share_saved == Interval(0.8, 0.4, 1.0)


def test_a_line_is_named_by_its_place_and_not_by_what_it_mostly_does() -> None:
    place = Place("train.py", 7, "main", "env.step(action)")
    remedies = [
        Remedy(RemedyKind.LINE, activity, place, "time in gymnasium", 0.3, 0.01)
        for activity in (Activity.NUMPY, Activity.BINDINGS)
    ]
    assert {ranking.placed(each) for each in remedies} == {"train.py:7: time in gymnasium"}


def test_wrong_results_stand_first() -> None:
    records = of_paths((ROLLOUT, 3.0), diverged=4, divergence="BADQACC")
    first, second = ranking.items(run(*records))
    assert first.change == ResultChange.CORRECTED
    assert first.action.startswith("4 of 68 simulations diverge (BADQACC)")
    assert second.gain is not None
    conclusions = checkup.list_section(run(*records)).conclusions
    assert conclusions[0].tone == Tone.BAD
    assert "first, what is wrong: 4 of 68" in conclusions[0].text


def test_what_is_given_up_is_said() -> None:
    launches = [blocks(ratio) for ratio in (0.09, 0.1, 0.1, 0.11)]
    ratio = Interval(0.1, 0.09, 0.11)
    alone = Attempt((SENSOR,), Status.OK, time_ratio=0.1, ratio=ratio, launches=launches)
    (item,) = ranking.items(run(part(CheckupPart.SETTINGS), tuned(attempts=[alone])))
    assert (item.gain_text, item.change_text) == ("10.00 ×", "gives up sensor data")


def test_gains_of_one_kind_replace_each_other_and_none_add_up() -> None:
    notes = checkup.list_section(run(*PATHS, tuned(FREE, LONGER))).notes
    assert "Use one of 1 and 2 (ways of stepping)" in notes
    assert "Use one of 3 and 4 (settings)" in notes
    assert "Gains overlap: they neither add up nor multiply" in notes
    assert "Look closer at 1 and 2: mjbench compare 'my robot.xml'" in notes


def test_a_name_that_begins_with_a_dash_is_no_option_in_what_to_run() -> None:
    records = [*PATHS, tuned(FREE, LONGER)]
    dashed = [replace(r, target="-m.xml") if isinstance(r, CheckedPart) else r for r in records]
    notes = checkup.list_section(run(*dashed)).notes
    assert "Look closer at 1 and 2: mjbench compare ./-m.xml" in notes


def combined(verdict: Any) -> CheckedPart:
    combination = Combination(ROLLOUT, [JACOBIAN], has_timer=False)
    return part(CheckupPart.TOGETHER, combination=combination, verdict=verdict)


def test_what_was_measured_together_is_the_conclusion() -> None:
    verdict = replace(FASTER, ratio=Interval(0.25, 0.24, 0.26))
    section = checkup.list_section(run(*PATHS, tuned(FREE), combined(verdict)))
    assert section.conclusions[0].text == (
        f"{TARGET}: 4.00 × as fast (3.85–4.17) with mujoco.rollout on 2 threads, timer off,"
        " jacobian=sparse, same results"
    )
    assert (
        "Look closer at all of them: mjbench ab 'my robot.xml'"
        " tuned.xml,path=rollout,threads=2,pool=kept,timer=off"
    ) in section.notes


def test_a_combination_that_gains_less_than_one_change_or_does_other_work_is_no_advice() -> None:
    less = replace(FASTER, ratio=Interval(0.5, 0.49, 0.51))
    for verdict in (SAME, less, replace(FASTER, changed_work=True)):
        section = checkup.list_section(run(*PATHS, tuned(FREE), combined(verdict)))
        assert section.conclusions[0].text.endswith(" with Batch.step on 2 threads (RL)")
        assert not any("mjbench ab" in note for note in section.notes)


def test_nothing_to_gain_is_an_answer_with_its_reasons() -> None:
    profile = replace(step_profile(), model=TARGET)
    records = [part(CheckupPart.STEP), profile, *of_paths((ROLLOUT, 0.5)), tuned(attempts=[SLOW])]
    (conclusion,) = checkup.list_section(run(*records)).conclusions
    assert conclusion.text == (
        f"{TARGET}: nothing to gain here: 67 % of a step is the engine (other 75 %, kinematics"
        " 25 %); no other way of stepping is faster by 5 %; none of 1 setting is certainly faster"
        " with the same results"
    )


@pytest.mark.parametrize(
    ("fields", "left_out"),
    [
        (
            {"untried": 2, "untried_combinations": 1},
            "There was no time for 2 settings and 1 combination: give a longer --budget",
        ),
        (
            {"no_second_look": "it takes about 12 s, and 3 s were left"},
            "Not run again from new starts: it takes about 12 s, and 3 s were left",
        ),
    ],
)
def test_where_there_was_no_time_it_says_that_nothing_is_certain(
    fields: dict[str, Any], left_out: str
) -> None:
    records = [*of_paths((ROLLOUT, 0.5)), step_profile(), tuned(attempts=[SLOW], **fields)]
    section = checkup.list_section(run(*records))
    (conclusion,) = section.conclusions
    assert (
        "To decide what is not certain, in more time: mjbench compare 'my robot.xml', mjbench tune"
        " 'my robot.xml'"
    ) in section.notes
    assert conclusion.text.startswith(f"{TARGET}: no gain is certain yet: ")
    assert left_out in section.notes


def test_settings_that_could_not_be_judged_are_a_line() -> None:
    record = tuned(attempts=[SLOW], no_reference="crashed")
    record = replace(record, present=replace(present(), error=None))
    section = checkup.list_section(run(*PATHS, record))
    assert any(note.endswith("are not recommended: crashed") for note in section.notes)


def test_a_setting_that_is_not_decided_leaves_no_certainty() -> None:
    seems_faster = replace(SLOW, time_ratio=0.9)
    undecided = [
        tuned(attempts=[seems_faster]),
        tuned(attempts=[replace(seems_faster, ratio=Interval(0.9, 0.8, 1.01))]),
        tuned(attempts=[SLOW], withdrawn=[Withdrawal((JACOBIAN,), "not certainly faster")]),
    ]
    for record in undecided:
        (conclusion,) = checkup.list_section(run(*of_paths((ROLLOUT, 0.5)), record)).conclusions
        assert conclusion.text.startswith(f"{TARGET}: no gain is certain yet: ")


def test_a_part_that_failed_is_said() -> None:
    failed = part(CheckupPart.STEP, status=Status.CRASHED, detail="killed by signal 11")
    (conclusion,) = checkup.list_section(run(failed)).conclusions
    assert conclusion.text == f"{TARGET}: crashed: killed by signal 11"
    assert conclusion.tone == Tone.BAD


def test_what_is_not_installed_and_what_was_not_tried_are_lines() -> None:
    missing = part(
        CheckupPart.PROGRAM,
        TargetKind.PROGRAM,
        status=Status.UNAVAILABLE,
        detail="mjbench run needs py-spy",
    )
    source = part(CheckupPart.SOURCE, TargetKind.PROGRAM)
    assert "Not done: mjbench run: mjbench run needs py-spy" in (
        checkup.list_section(run(source, missing)).notes
    )
    quick = checkup.list_section(run(part(CheckupPart.STEP), step_profile(), *PATHS)).notes
    assert "Settings were not tried: mjbench tune 'my robot.xml'" in quick


def test_a_program_that_does_not_step_has_no_verdict() -> None:
    failed = ProgramRow("train.py", Status.OK, "", 1, False, 3.0, 100, 300, [], [])
    seen = run(part(CheckupPart.PROGRAM, TargetKind.PROGRAM), failed)
    assert [each.text for each in checkup.list_section(seen).conclusions] == [
        f"{TARGET}: it ended with exit code 1",
        f"{TARGET}: nothing was measured: no loop was seen that steps MuJoCo",
    ]


def test_after_an_error_only_that_comes_first() -> None:
    error = UncaughtException("ValueError: no", None)
    failed = ProgramRow("train.py", Status.OK, "", 1, False, 3.0, 100, 300, [], [], exception=error)
    findings = [Finding("n.py", 4, 1, "MJB002", "a name", 1300.0)]
    source = replace(part(CheckupPart.SOURCE, TargetKind.PROGRAM), findings=findings)
    seen = run(source, part(CheckupPart.PROGRAM, TargetKind.PROGRAM), failed)
    assert ranking.items(seen) == []
    (conclusion,) = checkup.list_section(seen).conclusions
    assert conclusion.text == f"{TARGET}: it raised ValueError: no"
    _, of_program = checkup.part_sections(seen)
    assert of_program.facts == ["it raised ValueError: no"]


def test_what_costs_most_and_has_no_remedy_comes_first_as_in_run() -> None:
    place = Place("train.py", 12, "main", "x = a @ b")
    lines = [LineTime(place, 0.6, {Activity.NUMPY: 0.6})]
    shares = {Activity.NUMPY: 0.6, Activity.PHYSICS: 0.4}
    whole, pids = SourceLoop("train.py", 5, 20), [1]
    time = LoopTime(whole, [], ["MainThread"], pids, True, 300, 3.0, shares, lines, [])
    loops = [LoopReport(time, [])]
    row = ProgramRow("train.py", Status.OK, "", 0, False, 3.0, 100, 300, loops, [])
    (first,) = checkup.list_section(
        run(part(CheckupPart.PROGRAM, TargetKind.PROGRAM), row)
    ).conclusions
    assert first.text == f"{TARGET}: {program.conclusion(row)}"
    assert "no change is known for this" in first.text


def test_where_the_first_loop_waits_the_list_has_what_its_workers_should_change() -> None:
    remedy = Remedy(RemedyKind.COLLECTION, Activity.COLLECTION, None, "text", 0.8, 0.2)
    loops = [
        LoopReport(
            LoopTime(SourceLoop("train.py", 5, 9), [], [name], [1], True, 300, 3.0, shares, [], []),
            remedies,
        )
        for name, shares, remedies in (
            ("MainThread", {Activity.PROCESSES: 1.0}, []),
            ("worker", {Activity.NUMPY: 1.0}, [remedy]),
        )
    ]
    row = ProgramRow("train.py", Status.OK, "", 0, False, 3.0, 100, 300, loops, [])
    (item,) = ranking.items(run(part(CheckupPart.PROGRAM, TargetKind.PROGRAM), row))
    assert item.action.endswith("text")


def test_a_list_that_was_interrupted_says_so_first() -> None:
    first = checkup.list_section(run(part(CheckupPart.STEP, status=Status.INTERRUPTED)))
    assert first.conclusions[0].text == f"{TARGET}: interrupted, so the list is not complete"


def test_of_a_source_there_is_what_lint_finds() -> None:
    wrong = Finding("n.py", 3, 1, "MJB001", "a view", None, is_wrong_result=True)
    slow = Finding("n.py", 4, 1, "MJB002", "a name", 1300.0)
    source = part(CheckupPart.SOURCE, TargetKind.PROGRAM, findings=[slow, wrong])
    first, second = ranking.items(run(source))
    assert first.action == "n.py:3:1: a view (MJB001)"
    assert first.change == ResultChange.CORRECTED
    assert second.gain is None
    texts = [each.text for each in checkup.list_section(run(source)).conclusions]
    assert texts[1].endswith("a name (MJB002); what it gains was not measured")


def test_of_an_environment_whole_steps_come_before_its_physics_alone() -> None:
    record = example_environment_records.record()
    here = part(CheckupPart.ENVIRONMENT, TargetKind.ENVIRONMENT)
    listed = ranking.items(run(here, record))
    assert [(item.action, item.gain_text, item.unit) for item in listed] == [
        ("step 2 environments in one AsyncVectorEnv", "1.50 ×", GainUnit.ONE_ENVIRONMENT),
        (
            "step its physics yourself: mujoco.rollout on 2 threads,"
            " with controls known beforehand",
            "5.00 ×",
            GainUnit.ENV_STEP,
        ),
        ("step its physics yourself: the plain loop", "2.00 ×", GainUnit.ENV_STEP),
    ]


def test_a_report_begins_with_the_list_and_has_the_details_below(tmp_path: Any) -> None:
    whole = run(part(CheckupPart.STEP), step_profile(), *PATHS, tuned(FREE))
    content = reports.build([NamedRun(tmp_path / "run.jsonl", whole)])
    headings = [section.heading for section in content.sections]
    assert headings[0] == f"{TARGET}: what to do first"
    assert "pole: where a step's time goes" in headings
    assert f"{TARGET}: settings" in headings
    assert [each.text for each in content.conclusions] == [
        each.text for each in checkup.list_section(whole).conclusions
    ]


def test_lines_of_parts_come_before_the_list() -> None:
    profile = replace(step_profile(), model=TARGET)
    text = terminal.text_of(checkup.part_sections(run(part(CheckupPart.STEP), profile)))
    assert text.startswith("Where a step's time goes\na step of a Python loop takes 3 µs")
