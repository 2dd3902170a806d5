"""What `mjbench compare` prints of models: conclusions, one table of all sizes, and notes."""

import io
from dataclasses import replace
from typing import Any

import pytest
from example_races import BATCH_STEP, CLEAR, ROLLOUT, derived, raced
from example_records import measurement
from rich.console import Console

from mjbench.cli.progress import progress
from mjbench.commands.compare import show as comparison
from mjbench.commands.compare.results import ModelResults
from mjbench.paired.race_record import MAX_LAUNCHES, UnableVariant
from mjbench.results import terminal
from mjbench.session import Observer
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER

LONG = replace(BATCH_STEP, path="batch_rollout", options={"threads": 2, "data": "persistent"})


def printed(*models: ModelResults) -> str:
    return terminal.text_of(comparison.sections(models))


def sized(nbatch: int, **race: Any) -> ModelResults:
    return derived(raced(nbatch_asked=nbatch, **race), nbatch=nbatch)


def test_a_model_is_its_name_its_conclusions_its_table_and_then_the_details() -> None:
    lines = printed(derived(raced())).splitlines()
    assert lines[0] == "m: 10 simulations × 100 steps"
    assert lines[1].startswith("For RL (closed loop): Batch.step")
    assert lines[2].startswith("For controls known beforehand (open loop): mujoco.rollout")
    assert lines[3].split() == ["path", "ns/step", "speed-up", "95", "%", "×", "real", "loop"]
    assert lines[4].split()[:3] == ["python_loop", "998", "1.00"]
    assert lines[5].startswith("✓  rollout threads=2 pool=kept")
    assert lines[-1].startswith("nv 2, euler, newton; per step 1.0 contacts")


def test_several_sizes_have_a_conclusion_each_and_share_a_table() -> None:
    text = printed(sized(8, cores=1.2), sized(64))
    lines = text.splitlines()
    assert lines[0].startswith("8 simulations: Disturbed: ")
    for nbatch in (8, 64):
        size = f"{nbatch} simulations"
        assert f"m: {size} × 100 steps" in lines
        sure = "" if nbatch == 64 else "probably "
        assert f"For RL (closed loop), {size}: {sure}Batch.step on 2 threads" in text
    assert text.count("ns/step") == 1
    rows = [line for line in lines if str(BATCH_STEP) in line]
    assert [row.split()[0] for row in rows] == ["?", "✓"]
    assert [row.split()[4] for row in rows] == ["8", "64"]


def test_several_models_end_with_a_table_of_what_is_advised() -> None:
    other = derived(raced(model="other", cores=1.0))
    summary = printed(derived(raced()), other).split("Advice: ")[1].splitlines()
    assert summary[1].endswith("times as fast as the plain loop; 2 of 4 are certain")
    assert " to " in summary[1]
    assert summary[3].split()[:4] == ["m", "closed", "✓", "batch_step"]
    *_, last, hint = [line for line in summary if line]
    assert last.split()[:4] == ["other", "open", "?", "rollout"]
    assert hint.endswith("of each model; for one against the other: mjbench ab m other")


def test_models_that_gain_the_same_have_one_number() -> None:
    plain = [derived(raced([(ROLLOUT, 0.5)], model=name)) for name in ("m", "other")]
    summary = printed(*plain).split("Advice: ")[1].splitlines()
    assert summary[1] == "1.00 times as fast as the plain loop; 4 of 4 are certain"


def test_a_table_fits_into_a_terminal_of_80_columns() -> None:
    sizes = [derived(raced([*CLEAR, (LONG, 2.5)], nbatch_asked=n), nbatch=n) for n in (8, 64)]
    for shown in (sizes[:1], sizes):
        out = Console(file=io.StringIO(), width=80)
        terminal.print_lines(out, terminal.table_parts(comparison.path_table(shown), 80))
        lines = out.file.getvalue().splitlines()  # type: ignore[attr-defined]
        assert max(map(len, lines)) <= 80
        assert "data=persistent" in "".join(lines)
        assert lines[0].rstrip().endswith("loop")


def test_agreement_is_a_line_where_all_agree_and_else_a_column() -> None:
    assert "All paths agree with the plain loop." in printed(derived(raced()))
    wrong = measurement(path="processes", agrees=False, status=Status.DISAGREES)
    text = printed(derived(raced(), more=[wrong]))
    assert "All paths agree" not in text
    (headings,) = (line for line in text.splitlines() if "ns/step" in line)
    assert headings.endswith("agrees")
    assert any(line.startswith("   processes") and line.endswith("NO") for line in text.split("\n"))


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        (
            {"is_cut_short": True, "launches": raced().launches[:1]},
            "The budget ended the race after 1 launch: a longer --budget makes it more certain.",
        ),
        (
            {"status": Status.CRASHED, "detail": "signal 9"},
            "The race ended early: crashed: signal 9",
        ),
        (
            {"unable": [UnableVariant(3, Status.FAILED, "out of memory")]},
            "threads threads=2: failed: out of memory",
        ),
    ],
)
def test_how_a_race_ended_is_said_below_the_table(fields: dict[str, Any], line: str) -> None:
    model_results = derived(replace(raced(), **fields))
    assert any(each.startswith(line) for each in printed(model_results).splitlines())
    if "status" in fields:
        assert Status.CRASHED in model_results.statuses


def test_a_race_that_had_all_its_launches_does_not_ask_for_more_time() -> None:
    launches = raced().launches * MAX_LAUNCHES
    record = replace(raced(), launches=launches[:MAX_LAUNCHES], is_cut_short=True)
    text = printed(derived(record))
    assert f"The race ended undecided after {MAX_LAUNCHES} launches, its most." in text
    assert "--budget" not in text


def test_a_path_that_compiles_is_said_to_be_timed_in_one_process() -> None:
    compiled = measurement(
        path="mjx", samples_s=[0.001] * 3, precision=Precision.FLOAT32, compile_s=3.0
    )
    text = printed(derived(raced(), more=[compiled]))
    assert "mjx: timed in one process, so its speed-up has no interval" in text


def test_what_turning_the_timer_off_gains_is_a_conclusion_and_how_a_note() -> None:
    text = printed(derived(raced([*CLEAR, (WITHOUT_TIMER, 1.2)])))
    assert "Any path: turn off the timer of MuJoCo's Python package" in text
    assert "\nCall mujoco.mj_resetCallbacks() after creating MjData." in text


# while it is measured


def shown_by(observer: Observer, *models: ModelResults) -> None:
    observer("m", 0.5)
    observer.show(lambda: comparison.section_so_far(models))
    observer.show(None)


def test_results_so_far_stand_above_the_bar_of_a_terminal() -> None:
    out = Console(file=io.StringIO(), width=100, force_terminal=True)
    with progress(out) as bar:
        shown_by(bar, derived(raced(cores=1.2)))
    text = out.file.getvalue()  # type: ignore[attr-defined]
    assert text.index("Disturbed: ") < text.index("For RL") < text.index(str(ROLLOUT))


def test_nothing_is_advised_before_a_race_has_a_few_launches() -> None:
    record = raced()
    first = comparison.section_so_far([derived(replace(record, launches=record.launches[:1]))])
    assert first is not None and first.tables[0].rows
    assert (first.conclusions, first.tables[0].columns[0].title) == ([], "path")


def test_nothing_is_shown_before_there_is_a_speed() -> None:
    assert comparison.section_so_far([derived(replace(raced(), launches=()))]) is None


def test_rows_of_the_flat_table_say_what_is_advised() -> None:
    rows = comparison.flat_rows([derived(raced())])
    advised = {row["path"]: row["advised"] for row in rows if row["advised"]}
    assert advised.keys() == {ROLLOUT.path, BATCH_STEP.path}
    assert advised[ROLLOUT.path] == "certain"
    disturbed = comparison.flat_rows([derived(raced(cores=1.0))])
    assert {row["advised"] for row in disturbed} == {"", "not certain"}
