"""What machines show side by side, in tables and in sentences."""

from dataclasses import replace
from typing import Any

import example_races
import pytest
from example_races import ROLLOUT
from example_records import model_record
from set_files import MACHINE, labelled
from verdict_records import FAILED, FASTER, OPEN, SAME, SLOWER, of_model

from mjbench.comparison.records import ModelRecord
from mjbench.host.machine import Machine
from mjbench.measuring.ratio import Ratio
from mjbench.paired.metrics import Metric
from mjbench.report import advice_across, machines_side_by_side
from mjbench.report.machines_side_by_side import side_by_side
from mjbench.status import Status
from mjbench.store.runs import SCHEMA, InputFile, Record, Run, RunHeader


def run(machine: Machine | str, *records: Record, **header: object) -> Run:
    """Return a run of a machine, which may be a label."""
    machine = labelled(machine) if isinstance(machine, str) else machine
    return Run(RunHeader(SCHEMA, "versions", machine, {}, **header), records)


def sentences(*runs: Run) -> list[str]:
    section = machines_side_by_side.section(side_by_side(runs))
    assert section is not None
    return [*(conclusion.text for conclusion in section.conclusions), *section.notes]


# verdicts


def test_a_mixed_verdict_is_a_sentence() -> None:
    together, sentence = sentences(*(run(n, SLOWER) for n in "abc"), run("d", SAME))
    assert sentence == (
        "m, 1.0.0 → 2.0.0: slower on 3 of 4 machines, same on 1 (d); machines differ beyond their"
        " intervals, from +0.00 % to +3.00 %"
    )
    assert together == (
        "4 verdicts on 4 machines, decided together: 3 slower, 1 same. Of those named slower, at"
        " most 1 % are expected to be false alarms."
    )


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([SLOWER] * 2, "slower on both machines; from +3.00 % to +3.00 %"),
        ([SLOWER], "slower on a, the only machine that measured it"),
        ([FAILED, FAILED], "undecided on both machines"),
        ([SAME, OPEN], "same on 1 of 2 machines, undecided on 1 (b); from +0.00 % to +0.00 %"),
        (
            [SAME] * 5 + [FASTER] * 4,
            "same on 5 of 9 machines, faster on 4; machines differ beyond their intervals, from"
            " -3.00 % to +0.00 %",
        ),
    ],
)
def test_sentences_name_machines_where_they_are_few(verdicts: list[Record], expected: str) -> None:
    runs = [run(name, verdict) for name, verdict in zip("abcdefghi", verdicts, strict=False)]
    assert sentences(*runs)[1] == f"m, 1.0.0 → 2.0.0: {expected}"


def test_changed_work_is_said_and_on_how_many() -> None:
    changed = replace(SLOWER, changed_work=True)
    assert sentences(run("a", changed), run("b", changed))[1].endswith("; changed work")
    assert sentences(run("a", changed), run("b", SAME))[1].endswith("; changed work on 1")


def test_both_directions_have_a_rate_each_and_counts_have_none() -> None:
    together = sentences(run("a", SLOWER), run("b", FASTER))[0]
    assert "named slower and faster, at most 1 % each" in together
    counted = replace(SLOWER, metric=Metric.INSTRUCTIONS, e_slower=None)
    together, sentence = sentences(run("a", counted), run("b", counted))
    assert "false alarms" not in together
    assert sentence.startswith("m, 1.0.0 → 2.0.0, instructions: slower on both")


def test_changes_come_first_and_sizes_tell_comparisons_apart() -> None:
    larger = replace(SLOWER, nbatch=8)
    records = SAME, larger
    _, first, second = sentences(run("a", *records), run("b", *records))
    assert first.startswith("m, 1.0.0 → 2.0.0, 8 × 50 steps: slower")
    assert second.startswith("m, 1.0.0 → 2.0.0, 4 × 50 steps: same")


def test_machines_that_chose_other_sizes_stand_apart_and_it_is_said() -> None:
    runs = run("a", SAME), run("b", replace(SAME, nstep=100))
    assert "different work: m, 1.0.0 → 2.0.0. Give the same --nbatch" in sentences(*runs)[-1]
    # one machine that has both sizes chose them
    both = run("a", SAME, replace(SAME, nstep=100)), run("b", SAME)
    assert not any("different work" in sentence for sentence in sentences(*both))


def test_a_model_of_another_content_is_another_comparison() -> None:
    files = [{"files": (InputFile("m.xml", digest),)} for digest in "01"]
    record = of_model(SAME, "dir/m.xml")
    results = side_by_side([run("a", record, **files[0]), run("b", record, **files[1])])
    assert len(results.verdicts.comparisons) == 2


def test_cells_have_ratio_interval_and_outcome() -> None:
    weak = replace(SLOWER, e_slower=100.0)
    no_interval = replace(SAME, ratio=Ratio(1.0, None, None))
    records = (SLOWER, weak, FAILED, no_interval)
    runs = [run(name, record) for name, record in zip("abcd", records, strict=True)]
    (table,) = machines_side_by_side.tables_by_machine(side_by_side(runs))
    assert [row[1:] for row in table.rows] == [
        [
            "+3.00 % (+2.00 to +4.00 %) slower",
            "+3.00 % (+2.00 to +4.00 %) undecided (slower if judged alone)",
            "undecided (signal 11)",
            "+0.00 % same",
        ]
    ]


def test_what_a_machine_did_not_measure_is_a_dash() -> None:
    runs = [run("a", SAME), run("b", of_model(SAME, "n"))]
    (table,) = machines_side_by_side.tables_by_machine(side_by_side(runs))
    assert [row[1:] for row in table.rows] == [
        ["+0.00 % (-0.40 to +0.40 %) same", "–"],
        ["–", "+0.00 % (-0.40 to +0.40 %) same"],
    ]


def test_a_table_that_is_too_wide_for_the_terminal_has_a_row_for_each_cell() -> None:
    few, many = (
        next(
            machines_side_by_side.tables_by_machine(
                side_by_side([run(f"machine {n}", SAME) for n in range(n)])
            )
        )
        for n in (2, 9)
    )
    assert [column.title for column in few.columns][1:] == ["machine 0", "machine 1"]
    assert [column.title for column in many.columns] == ["comparison", "machine", "result"]
    assert len(many.rows) == 9


# advised paths


def compared(speedup: float = 2.0, **race: Any) -> list[Record]:
    """Return records of a model on which rollout is so many times faster."""
    entrants = [(ROLLOUT, speedup)]
    return [*example_races.compared(example_races.raced(entrants, spread=0, **race), seed=0)]


def answers(*runs: Run) -> dict[str, dict[str, str]]:
    """Return the cells of advised paths by question and machine."""
    return {
        across.question.name: {m.machine: advice_across.cell(m) for m in across.machines}
        for across in side_by_side(runs).advice
    }


def test_advised_paths_stand_side_by_side() -> None:
    found = answers(run("a", *compared()), run("b", *compared(1.0)))
    assert list(found) == ["m, 10 × 100 steps, open loop", "m, 10 × 100 steps, closed loop"]
    cells = found["m, 10 × 100 steps, open loop"]
    assert cells["a"] == "✓ rollout threads=2 pool=kept 2.00× (2.00 to 2.00)"
    assert cells["b"] == "✓ python_loop"


def test_machines_that_differ_are_named_before_what_all_agree_on() -> None:
    runs = [run("a", *compared()), run("b", *compared()), run("c", *compared(1.0))]
    assert list(advice_across.describe(side_by_side(runs).advice)) == [
        "m, 10 × 100 steps, open loop: rollout on 2 of 3 machines, python_loop on 1",
        "Closed loop: python_loop on all 3 machines, for m",
    ]


@pytest.mark.parametrize(
    "change", [{"nbatch": 11}, {"nstep": 50}, {"returns": "sensors"}, {"hold": 2}, {"seed": 1}]
)
def test_sizes_and_products_are_kept_apart(change: dict[str, object]) -> None:
    first, *others = compared()
    assert isinstance(first, ModelRecord)
    other = [replace(first, **change), *others]
    advice = side_by_side([run("a", *compared()), run("b", *other)]).advice
    assert [len(across.machines) for across in advice] == [1, 1, 1, 1]


def test_software_of_one_machine_is_kept_apart() -> None:
    new = labelled("a", versions={"mujoco": "4.1.0"})
    found = answers(run("a", *compared()), run(new, *compared()), run("b", *compared()))
    assert list(found["m, 10 × 100 steps, open loop"]) == [
        "a (mujoco 4.0.0)",
        "a (mujoco 4.1.0)",
        "b",
    ]


def test_runs_of_one_machine_that_advise_different_paths_are_undecided() -> None:
    runs = [run("a", *compared()), run("a", *compared(1.0)), run("b", *compared())]
    cells = answers(*runs)["m, 10 × 100 steps, open loop"]
    assert cells["a"].startswith("✓ rollout threads=2 pool=kept 2.00× (2.00 to 2.00); ✓ python")
    sentence = next(iter(advice_across.describe(side_by_side(runs).advice)))
    assert sentence.endswith("undecided on 1 of 2 machines, rollout on 1")


def test_what_disturbed_a_machine_comes_first_and_makes_its_advice_uncertain() -> None:
    runs = run("a", *compared(cores=1.2)), run("b", *compared())
    cells = answers(*runs)["m, 10 × 100 steps, open loop"]
    assert [cells[name][0] for name in "ab"] == ["?", "✓"]
    (caution,) = advice_across.cautions(side_by_side(runs).advice)
    assert caution == "a, m: Disturbed: threads had 1.20 of 2 cores. Measure again."


def test_a_model_that_failed_on_a_machine_says_so_there() -> None:
    failed = model_record(
        status=Status.CRASHED, detail="signal 11", nbatch=None, nstep=None, facts=None, work=None
    )
    found = answers(run("a", *compared()), run("b", failed))
    assert found["m, 10 × 100 steps, open loop"]["b"] == "crashed: signal 11"


def test_the_machines_of_runs_are_told_apart() -> None:
    hosts = [replace(MACHINE, host=host) for host in ("1", "2", "1")]
    results = side_by_side([run(machine) for machine in hosts])
    assert [m.name for m in results.machines] == [
        "AMD EPYC 7763 A",
        "AMD EPYC 7763 B",
        "AMD EPYC 7763 A",
    ]
    assert results.has_several
    assert not side_by_side([run("a"), run("a")]).has_several
