"""What several machines answer: a column each, and what they differ and agree on."""

from dataclasses import replace
from typing import Any

import example_races
import pytest
from example_races import ROLLOUT
from example_records import model_record
from set_files import labelled, run_of
from verdict_records import FAILED, FASTER, OPEN, SAME, SLOWER, of_model

from mjbench.commands.show import machine_comparison
from mjbench.host.machine import Machine
from mjbench.paired.metrics import Metric
from mjbench.results.content import Section, Tone
from mjbench.results.runs import InputFile, Record, Run
from mjbench.status import Status
from mjbench.verification.records import ModelRecord


def run(machine: Machine | str, *records: Record, **header: object) -> Run:
    """Return a run of a machine, which may be a label."""
    machine = labelled(machine) if isinstance(machine, str) else machine
    return run_of("versions", *records, machine=machine, **header)


def section(*runs: Run) -> Section:
    section = machine_comparison.section(machine_comparison.of_runs(runs))
    assert section is not None
    return section


def sentences(*runs: Run) -> list[str]:
    return [conclusion.text for conclusion in section(*runs).conclusions]


def answers(*runs: Run) -> dict[str, dict[str, str]]:
    """Return what each machine answers, by question."""
    return {
        question: {answer.machine: answer.text for answer in of_question}
        for question, of_question in machine_comparison.of_runs(runs).by_question.items()
    }


def compared(speedup: float = 2.0, **race: Any) -> list[Record]:
    """Return records of a model on which rollout is this many times faster."""
    entrants = [(ROLLOUT, speedup)]
    return [*example_races.compared(example_races.raced(entrants, spread=0, **race), seed=0)]


# verdicts


def test_machines_that_differ_are_a_sentence_and_all_verdicts_are_one_family() -> None:
    together, sentence = sentences(*(run(name, SLOWER) for name in "abc"), run("d", SAME))
    assert sentence == "m, 1.0.0 → 2.0.0, 4 × 50 steps: slower on 3 of 4 machines, same on d"
    assert together == (
        "All 4 together: slower in 3 (m), faster in none, undecided in none. Of those named slower,"
        " at most 1 % are expected to be false alarms."
    )


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([SLOWER] * 2, "slower on both machines, for m, 1.0.0 → 2.0.0, 4 × 50 steps"),
        ([SLOWER], "slower on the only machine, for m, 1.0.0 → 2.0.0, 4 × 50 steps"),
        ([FAILED] * 3, "undecided on all 3 machines, for m, 1.0.0 → 2.0.0"),
        ([SAME, FAILED], "m, 1.0.0 → 2.0.0, 4 × 50 steps: same on 1 of 2 machines, undecided on b"),
    ],
)
def test_what_machines_agree_on_is_a_sentence(verdicts: list[Record], expected: str) -> None:
    runs = [run(name, verdict) for name, verdict in zip("abc", verdicts, strict=False)]
    assert sentences(*runs)[1] == expected


@pytest.mark.parametrize(
    ("verdicts", "tone"),
    [([SLOWER, FASTER], Tone.BAD), ([FASTER, OPEN], Tone.GOOD), ([SAME, SAME], Tone.NEUTRAL)],
)
def test_slower_on_one_machine_is_bad(verdicts: list[Record], tone: Tone) -> None:
    runs = [run(name, verdict) for name, verdict in zip("ab", verdicts, strict=True)]
    assert section(*runs).conclusions[1].tone == tone


def test_cells_have_ratio_interval_and_verdict() -> None:
    weak = replace(SLOWER, e_slower=100.0)
    changed = replace(SAME, changed_work=True)
    runs = [run(*each) for each in zip("abcd", (SLOWER, weak, FAILED, changed), strict=True)]
    (cells,) = answers(*runs).values()
    assert list(cells.values()) == [
        "+3.00 % (+2.00 to +4.00 %) slower",
        "+3.00 % (+2.00 to +4.00 %) undecided (slower if judged alone)",
        "undecided (signal 11)",
        "+0.00 % (-0.40 to +0.40 %) same, changed work",
    ]


def test_other_metrics_are_named() -> None:
    counted = replace(SLOWER, metric=Metric.INSTRUCTIONS, e_slower=None)
    (question,) = answers(run("a", counted), run("b", counted))
    assert question == "m, 1.0.0 → 2.0.0, instructions, 4 × 50 steps"


def test_machines_that_did_different_work_are_apart_and_it_is_said() -> None:
    runs = run("a", SAME), run("b", replace(SAME, nstep=100))
    assert section(*runs).notes == [
        "Not all machines answered the same questions about m. Give the same --nbatch, --nstep,"
        " --settle and files on all machines."
    ]
    assert section(run("a", SAME), run("b", SAME)).notes == []


def test_a_model_of_another_content_is_another_question() -> None:
    files = [{"files": (InputFile("m.xml", digest),)} for digest in "01"]
    record = of_model(SAME, "dir/m.xml")
    first, second = answers(run("a", record, **files[0]), run("b", record, **files[1]))
    assert second == f"{first} (2)"


# advised paths


def test_advised_paths_stand_side_by_side() -> None:
    by_question = answers(run("a", *compared()), run("b", *compared(1.0)))
    assert list(by_question) == ["m, 10 × 100 steps, open loop", "m, 10 × 100 steps, closed loop"]
    assert by_question["m, 10 × 100 steps, open loop"] == {
        "a": "✓ rollout threads=2 pool=kept 2.00× (2.00–2.00)",
        "b": "✓ python_loop",
    }


def test_machines_that_differ_come_before_what_all_agree_on() -> None:
    runs = [run("a", *compared()), run("b", *compared()), run("c", *compared(1.0))]
    assert sentences(*runs) == [
        "m, 10 × 100 steps, open loop: rollout on 2 of 3 machines, python_loop on c",
        "python_loop on all 3 machines, for m, 10 × 100 steps, closed loop",
    ]


@pytest.mark.parametrize(
    "change", [{"nbatch": 11}, {"nstep": 50}, {"returns": "sensors"}, {"hold": 2}, {"seed": 1}]
)
def test_sizes_and_products_are_kept_apart(change: dict[str, object]) -> None:
    first, *others = compared()
    assert isinstance(first, ModelRecord)
    by_question = answers(run("a", *compared()), run("b", replace(first, **change), *others))
    assert [len(cells) for cells in by_question.values()] == [1, 1, 1, 1]


def test_versions_of_mujoco_on_one_machine_are_kept_apart() -> None:
    new = labelled("a", versions={"mujoco": "4.1.0"})
    by_question = answers(run("a", *compared()), run(new, *compared()), run("b", *compared()))
    assert list(by_question["m, 10 × 100 steps, open loop"]) == [
        "a (MuJoCo 4.0.0)",
        "a (MuJoCo 4.1.0)",
        "b",
    ]


def test_a_machine_that_was_asked_twice_has_both_answers() -> None:
    runs = [run("a", *compared()), run("a", *compared(1.0)), run("b", *compared())]
    row = section(*runs).tables[0].rows[0]
    assert row[1] == "✓ rollout threads=2 pool=kept 2.00× (2.00–2.00); ✓ python_loop"


def test_what_disturbed_a_machine_is_said_and_makes_its_advice_uncertain() -> None:
    runs = run("a", *compared(cores=1.2)), run("b", *compared())
    cells = answers(*runs)["m, 10 × 100 steps, open loop"]
    assert [cells[name][0] for name in "ab"] == ["?", "✓"]
    (caution,) = machine_comparison.of_runs(runs).cautions
    assert caution == "a, m: Disturbed: threads had 1.20 of 2 cores. Measure again."


def test_a_model_that_failed_on_a_machine_says_so_there() -> None:
    failed = model_record(
        status=Status.CRASHED, detail="signal 11", nbatch=None, nstep=None, facts=None, work=None
    )
    by_question = answers(run("a", *compared()), run("b", failed))
    assert by_question["m, 10 × 100 steps, open loop"]["b"] == "crashed: signal 11"


# the table


def test_what_a_machine_did_not_measure_is_a_dash() -> None:
    runs = [run("a", SAME), run("b", of_model(SAME, "n"))]
    assert [row[1:] for row in section(*runs).tables[0].rows] == [
        ["+0.00 % (-0.40 to +0.40 %) same", "–"],
        ["–", "+0.00 % (-0.40 to +0.40 %) same"],
    ]


def test_a_table_that_is_too_wide_for_the_terminal_has_a_row_for_each_cell() -> None:
    few, many = (
        section(*(run(f"machine {n}", SAME) for n in range(count))).tables[0] for count in (2, 9)
    )
    assert [column.title for column in few.columns][1:] == ["machine 0", "machine 1"]
    assert [column.title for column in many.columns] == ["question", "machine", "answer"]
    assert len(many.rows) == 9


def test_runs_without_answers_have_no_section() -> None:
    assert machine_comparison.section(machine_comparison.of_runs([run("a"), run("b")])) is None
