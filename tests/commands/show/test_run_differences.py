"""Two runs held against each other."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from example_records import measurement, model_record
from set_files import run_of

from mjbench.commands.show.run_differences import RunDifference, differences, differences_section
from mjbench.host import machine
from mjbench.paired.outcomes import Verdict
from mjbench.paths.accelerated import CPU
from mjbench.results.runs import Run
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status

MACHINE = replace(machine.describe(), cpu="c", versions={"jax": "1"}, flags={})


def run(jax: str = "1", model: Mapping[str, Any] | None = None, **fields: Any) -> Run:
    accelerated = {"path": "mjx", "precision": Precision.FLOAT32, "device": CPU}
    record = measurement(**{"samples_s": [1.0] * 9, **accelerated, **fields})
    machine = replace(MACHINE, versions={"jax": jax})
    return run_of("compare", model_record(**(model or {})), record, machine=machine)


def difference(old: Run, new: Run, across: bool = False) -> RunDifference:
    (row,) = differences(old, new, across)
    return row


def test_the_ratio_is_new_time_of_a_step_over_old() -> None:
    row = difference(run(), run(samples_s=[1.5] * 9))
    assert row.ratio is not None
    assert row.ratio.estimate == pytest.approx(1.5)
    half_the_steps = difference(run(), run(samples_s=[1.5] * 9, model={"nstep": 200}))
    assert half_the_steps.ratio is not None
    assert half_the_steps.ratio.estimate == pytest.approx(0.75)


def test_runs_of_another_jax_are_compared_only_when_asked() -> None:
    refused = difference(run("1"), run("2"))
    assert (refused.status, refused.ratio) == (Status.INPUT, None)
    assert "they differ in jax (2, 1)" in refused.detail
    assert difference(run("1"), run("2"), across=True).ratio is not None


def test_other_work_is_never_compared() -> None:
    row = difference(run(), run(model={"workload_digest": "other"}), across=True)
    assert row.status == Status.INPUT
    assert "workloads differ" in row.detail


def test_rows_that_only_one_run_has_are_left_out() -> None:
    assert differences(run(), run(path="mjx64"), across=True) == []
    assert differences(run(), run(status=Status.FAILED), across=True) == []


def run_of_paths(times: Mapping[str, float], **machine: Any) -> Run:
    records = [measurement(path=path, samples_s=[s] * 9) for path, s in times.items()]
    return run_of("compare", model_record(), *records, machine=replace(MACHINE, **machine))


ONE_EACH = {"python_loop": 1.0, "rollout": 1.0, "threads": 1.0}


def test_rows_that_all_move_by_one_factor_are_the_machine() -> None:
    slower = dict.fromkeys(ONE_EACH, 1.3) | {"rollout": 1.31}
    rows = differences(run_of_paths(ONE_EACH), run_of_paths(slower), across=False)
    _, then = differences_section(rows).conclusions
    assert then.text == (
        "All 3 rows take 1.30 times as long, and MuJoCo is the same: that is probably the machine"
    )


@pytest.mark.parametrize(
    ("times", "machine"),
    [
        (dict.fromkeys(ONE_EACH, 1.3), {"versions": {"mujoco": "4.1.0"}}),
        (dict.fromkeys(ONE_EACH, 1.3) | {"rollout": 1.0}, {}),
        ({"python_loop": 1.3, "rollout": 1.3}, {}),
        (dict.fromkeys(ONE_EACH, 1.02), {}),
    ],
)
def test_what_may_be_the_code_is_not_said_to_be_the_machine(
    times: Mapping[str, float], machine: Mapping[str, Any]
) -> None:
    rows = differences(run_of_paths(ONE_EACH), run_of_paths(times, **machine), across=False)
    assert len(differences_section(rows).conclusions) == 1


def test_a_machine_that_became_slower_itself_decides_no_row() -> None:
    old = run_of_paths(ONE_EACH, reference_ns=100.0)
    new = run_of_paths({**ONE_EACH, "rollout": 1.5}, reference_ns=150.0)
    rows = differences(old, new, across=False)
    assert {row.verdict for row in rows} == {Verdict.INCONCLUSIVE}
    first, *_ = differences_section(rows).conclusions
    assert first.text.startswith("A reference loop takes 1.50 times as long in NEW")


def test_a_reason_that_holds_for_all_rows_is_said_once() -> None:
    rows = differences(run_of_paths(ONE_EACH), run_of_paths(ONE_EACH, cpu="other"), across=False)
    section = differences_section(rows)
    reason = "not comparable, they differ in device (other, c)"
    assert section.conclusions[-1].text == f"Of 3 rows: 3 not comparable; {reason}"
    assert section.tables[0].rows[0][-1] in ("", None)
