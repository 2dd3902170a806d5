"""Verdicts as sentences."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.commands.versions import family
from mjbench.commands.versions import show as verdicts
from mjbench.commands.versions.show import describe_ratio
from mjbench.interval import Interval
from mjbench.measuring.calls import Compilation
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Cause, ResultsOutcome, Verdict
from mjbench.paired.records import (
    CompilationFigures,
    ControlRow,
    PackageVersions,
    Pair,
    PlacementEffect,
    TargetRow,
    VerdictRow,
)
from mjbench.results import terminal
from mjbench.simulation.reference_run import Work
from mjbench.simulation.starts import SettleLimit, Starts
from mjbench.simulation.state_drift import RunDrift
from mjbench.status import Status

OLD = TargetRow("3.3.0", "humanoid", "python_loop", {}, {})
NEW = replace(OLD, release="4.0.0")
WORK = Work(contacts=1.0, constraints=4.0, solver_iterations=2.0)
ROW = VerdictRow(
    model="humanoid",
    path="python_loop",
    old="3.3.0",
    new="4.0.0",
    sides=(OLD, NEW),
    status=Status.OK,
    verdict=Verdict.SLOWER,
    ratio=Interval(1.014, 1.011, 1.017),
    changed_work=False,
    work=Pair(WORK, WORK),
    drift=0.0,
    diverged=Pair(0, 0),
)


def test_a_verdict_is_a_sentence() -> None:
    expected = "humanoid, 3.3.0 → 4.0.0: slower by 1.4 % (interval +1.10 to +1.70 %), same work"
    assert verdicts.describe_verdict(ROW) == expected


def test_the_same_work_may_drift_apart_over_a_run() -> None:
    row = replace(ROW, run_drift=[RunDrift(25, 1e-12), RunDrift(50, 3e-6), RunDrift(100, 2.0)])
    sentence = verdicts.describe_verdict(row)
    assert sentence.endswith("same work (simulations drift apart: by 3e-06 after 50 steps)")


@pytest.mark.parametrize(
    ("starts", "line"),
    [
        (Starts(0.2, 1.0, SettleLimit.COST), "settled for 0.2 s instead of 1 s"),
        (Starts(0.0, 1.0, SettleLimit.DIVERGED), "Starts are at the keyframe"),
        (Starts(1.0, 1.0), ""),
    ],
)
def test_starts_that_were_not_to_be_had_as_asked_are_told(starts: Starts, line: str) -> None:
    text = terminal.text_of([verdicts.section([replace(ROW, starts=starts)], 0.99)])
    assert line in text
    assert ("Starts" in text or "settled" in text) is bool(line)


@pytest.mark.parametrize(
    ("effect", "text"),
    [
        (Interval(1.03, 1.01, 1.05), "adds +3.00 % (interval +1.00 to +5.00 %)"),
        (Interval(0.97, None, None), "adds -3.00 % (too few launches for an interval)"),
    ],
)
def test_a_verdict_says_what_the_placement_adds(effect: Interval, text: str) -> None:
    row = replace(ROW, cause=Cause.CODE, placement=PlacementEffect(True, "", effect, effect))
    sentence = verdicts.describe_verdict(row)
    assert ": slower by 1.4 % (interval +1.10 to +1.70 %) because of its code, same" in sentence
    assert sentence.endswith(f"; the placement of these builds {text}")


@pytest.mark.parametrize(
    ("verdict", "ratio", "text"),
    [
        (Verdict.SAME, Interval(1.001, 0.996, 1.003), ": same within 0.4 %,"),
        (
            Verdict.FASTER,
            Interval(0.6, 0.5, 0.7),
            ": faster by 40 % (interval -50.00 to -30.00 %),",
        ),
        (Verdict.FASTER, Interval(0.1, 0.08, 0.125), ": faster, 10 times as fast (interval 8–"),
        (Verdict.SLOWER, Interval(1.9, 1.8, 2.0), ": slower by 90 % ("),
        (Verdict.SLOWER, Interval(2.5, 2.4, 2.6), ": slower, takes 2.5 times as long (interval"),
        (
            Verdict.INCONCLUSIVE,
            Interval(1.5, None, None),
            "inconclusive, +50.00 % (interval unknown)",
        ),
    ],
)
def test_each_verdict_says_how_much_and_how_sure(
    verdict: Verdict, ratio: Interval, text: str
) -> None:
    assert text in verdicts.describe_verdict(replace(ROW, verdict=verdict, ratio=ratio))


@settings(deadline=None)
@given(st.floats(1e-9, 0.99))
def test_any_change_is_written_as_people_write_a_percentage(change: float) -> None:
    """A factor of 1 + change is slower by 100 × change percent, to two significant digits."""
    row = replace(ROW, ratio=Interval(1 + change, 1.0, 1 + 2 * change))
    sentence = verdicts.describe_verdict(row)
    written = re.search(
        r": slower by (\d+(\.\d+)?) % \(interval \+0\.00 to \+\d+\.\d\d %\), ", sentence
    )
    assert written, sentence
    assert float(written[1]) == pytest.approx(100 * ((1 + change) - 1), rel=0.051)
    assert len(written[1].replace(".", "").strip("0")) <= 2


def test_changed_work_says_what_changed() -> None:
    more = replace(WORK, contacts=5.0)
    row = replace(ROW, changed_work=True, work=Pair(WORK, more), diverged=Pair(0, 3))
    assert verdicts.describe_work(ROW) == ""
    text = "contacts 1 → 5, 3 simulations diverge instead of 0"
    assert verdicts.describe_work(row) == text
    assert verdicts.describe_verdict(row).endswith(f"changed work: {text}")


def test_a_comparison_that_failed_says_why() -> None:
    row = replace(ROW, status=Status.FAILED, verdict=None, ratio=None, detail="out of memory")
    assert verdicts.describe_verdict(row) == "humanoid, 3.3.0 → 4.0.0: out of memory"


def test_only_what_differs_between_the_targets_is_named() -> None:
    baseline = replace(OLD, path="rollout", options={"threads": 2, "chunk": 8})
    candidate = replace(OLD, path="rollout", options={"threads": 2}, model_options={"solver": "cg"})
    row = replace(ROW, sides=(baseline, candidate))
    assert verdicts.describe_targets(row) == "chunk=8 → solver=cg"
    row = replace(ROW, sides=(OLD, replace(OLD, model_options={"solver": "cg"})))
    assert verdicts.describe_targets(row) == "default → solver=cg"
    row = replace(ROW, sides=(OLD, replace(OLD, has_timer=False)))
    assert verdicts.describe_targets(row) == "default → timer=off"


def test_a_headline_names_each_of_two_models_once() -> None:
    sides = replace(OLD, model="a.xml"), replace(OLD, model="b.xml")
    row = replace(ROW, model="b.xml", sides=sides)
    assert verdicts.describe_verdict(row).startswith("a.xml → b.xml: slower by")
    row = replace(row, sides=(sides[0], replace(sides[1], model_options={"solver": "cg"})))
    assert verdicts.describe_verdict(row).startswith("model=a.xml → model=b.xml solver=cg: slower")


def test_comparisons_are_summed_up_together() -> None:
    slower = replace(ROW, verdict=Verdict.SLOWER, e_slower=5000.0, e_faster=0.0)
    same = replace(ROW, model="pile", verdict=Verdict.SAME, e_slower=0.1, e_faster=0.1)
    unsure = replace(slower, model="cloth", e_slower=140.0)
    decided = family.adjust_for_family([slower, same, unsure], 0.99)
    assert verdicts.describe_family(decided, 0.99) == (
        "All 3 together: slower in 1 (humanoid), faster in none, undecided in 1 (cloth)."
        " Of those named slower, at most 1 % are expected to be false alarms."
    )
    quiet = verdicts.describe_family(family.adjust_for_family([same, same], 0.99), 0.99)
    assert quiet == "All 2 together: slower in none, faster in none, undecided in none."


def test_what_differs_besides_the_named_packages_is_noted() -> None:
    sides = [replace(OLD, packages=name) for name in ("jax==0.7.0", "jax==0.7.1")]
    versions = [
        PackageVersions("jax", "0.7.0", "0.7.1"),
        PackageVersions("numpy", "2.4.0", "2.4.0"),
        PackageVersions("scipy", "1.16", "1.17"),
    ]
    row = replace(ROW, sides=sides, old="jax==0.7.0", new="jax==0.7.1", packages=versions)
    assert verdicts.describe_targets(row) == "jax==0.7.0 → jax==0.7.1"
    assert "other packages differ, too: scipy 1.16 → 1.17" in verdicts.notes(row)


def of_revisions(**fields: Any) -> VerdictRow:
    """Return the verdict on a function in two revisions."""
    main = TargetRow("4.0.0", "bench.py::step", "", {}, {}, revision="main", commit="a" * 40)
    sides = main, replace(main, revision="WORKTREE", commit="")
    names = {"model": "bench.py::step", "path": "", "old": "main", "new": "WORKTREE"}
    return replace(ROW, sides=sides, **names, **fields)


@pytest.mark.parametrize(
    ("outcome", "detail", "text"),
    [
        (ResultsOutcome.SAME, "", "same results"),
        (ResultsOutcome.ROUNDING, "by 1e-12", "same results but for rounding (by 1e-12)"),
        (ResultsOutcome.RANDOM, "", "results are random, so they were not compared"),
        (ResultsOutcome.NONE, "it returns nothing", "were not compared (it returns nothing)"),
    ],
)
def test_what_a_function_returned_stands_beside_its_verdict(
    outcome: ResultsOutcome, detail: str, text: str
) -> None:
    row = of_revisions(results=outcome, results_detail=detail)
    sentence = verdicts.describe_verdict(row)
    assert sentence.startswith("bench.py::step, main → WORKTREE: slower by 1.4 % (interval")
    assert sentence.endswith(text)


@pytest.mark.parametrize(
    ("ratio", "covers", "text"),
    [
        (Interval(1.002, 0.99, 1.01), True, "+0.20 % (interval -1.00 to +1.00 %)"),
        (Interval(1.05, 1.04, 1.06), False, "so this machine was too noisy for this verdict"),
        (Interval(1.05, None, None), True, "(too few launches for an interval)"),
    ],
)
def test_the_control_and_the_commits_are_noted(ratio: Interval, covers: bool, text: str) -> None:
    row = of_revisions(control=ControlRow(ratio, 8, covers), calls_s=Pair(2e-6, 2e-6))
    commits, call, control = verdicts.notes(row)
    assert commits == f"main is {'a' * 40}, WORKTREE is not committed"
    assert call == "a call takes about 2 µs in main"
    assert control.endswith(text)


@pytest.mark.parametrize(
    ("slowing", "text"), [(4.6, "4.60 times as long"), (0.5, "0.50 times as long")]
)
def test_a_function_that_keeps_state_is_noted(slowing: float, text: str) -> None:
    _, note = verdicts.notes(of_revisions(slowing=slowing))
    assert text in note
    assert note.endswith("so the ratio depends on how often it is called")
    assert len(verdicts.notes(of_revisions(slowing=1.1))) == 1


FRESH = Compilation(trace_s=2.0, compile_s=8.0, first_run_s=0.1, programs=31)
CACHED = replace(FRESH, compile_s=0.4, is_cached=True)


def compiling(*sides: Sequence[Compilation]) -> Sequence[Sequence[str]]:
    """Return what a table says of compiling, of the baseline and of the candidate."""
    row = replace(ROW, compiling=Pair(*(CompilationFigures.of(each, [0.01] * 8) for each in sides)))
    tables = {table.title: table for table in verdicts.section([row], 0.99).tables}
    return tables["Compiling"].texts


def test_each_side_has_its_times_of_compiling_beside_steady_runs() -> None:
    times = ["2 s (2 s–2 s)", "8 s (one process)", "100 ms (100 ms–100 ms)", "10 ms (10 ms–10 ms)"]
    launched = [FRESH, *[CACHED] * 8]
    assert compiling(launched, launched) == [
        ["humanoid", environment, *times, "31"] for environment in ("3.3.0", "4.0.0")
    ]


def test_a_median_without_an_interval_has_its_number_of_processes() -> None:
    assert [cells[2:4] for cells in compiling([FRESH, FRESH], [CACHED])] == [
        ["2 s (2 processes)", "8 s (2 processes)"],
        ["2 s (one process)", "from the cache"],
    ]


def test_steps_in_c_have_no_table_of_compiling() -> None:
    assert [table.title for table in verdicts.section([ROW], 0.99).tables] == ["Verdicts"]


@pytest.mark.parametrize(
    ("metric", "verdict", "ratio", "text"),
    [
        (Metric.LOAD, Verdict.SLOWER, Interval(1.05, 1.04, 1.06), "slower by 5 % (interval "),
        (Metric.LOAD, Verdict.SLOWER, Interval(3.0, 2.9, 3.1), "slower, takes 3 times as long"),
        (
            Metric.MEMORY,
            Verdict.SLOWER,
            Interval(1.05, 1.04, 1.06),
            "more memory by 5 % (interval ",
        ),
        (Metric.MEMORY, Verdict.SLOWER, Interval(3.0, 2.9, 3.1), "more memory by 200 %"),
        (Metric.MEMORY, Verdict.INCONCLUSIVE, Interval(1.0, None, None), "inconclusive, "),
    ],
)
def test_a_change_is_said_in_the_words_of_its_metric(
    metric: Metric, verdict: Verdict, ratio: Interval, text: str
) -> None:
    assert describe_ratio(metric, verdict, ratio).startswith(text)
