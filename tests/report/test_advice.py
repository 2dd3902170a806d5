"""Which path is advised, and what has to be compared again before."""

from dataclasses import replace
from typing import Any

import pytest
from example_records import measurement, model_record

from mjbench.comparison.plan import Variant
from mjbench.paired.confirmation import ConfirmationRecord
from mjbench.paired.contest import ContestLaunch, ContestRecord, UnableVariant
from mjbench.report import results
from mjbench.report.advice import Advice, Loop, Reason, advise, contest_groups
from mjbench.report.comparison import why
from mjbench.report.results import ModelResults
from mjbench.simulation.accelerated_limits import Precision
from mjbench.status import Status

COMPILED = {"precision": Precision.FLOAT32, "trace_s": 1.0, "compile_s": 3.0, "closed_loop": True}
LOOP = {"samples_s": [1.0] * 7, "closed_loop": True}


def derived(**rows: dict[str, Any]) -> ModelResults:
    records = [measurement(path=path, **row) for path, row in rows.items()]
    return results.derive(model_record(), records)


def contest(spread: float = 0.001, **times: float) -> ContestRecord:
    """Return a contest of ten launches, in which each path takes its time, more or less."""
    launches = [
        ContestLaunch(
            None,
            range(len(times)),
            [[round(1e6 * time * (1 + sign * i * spread)) for i, time in enumerate(times.values())]]
            * 4,
        )
        for sign in (-1, 1) * 5
    ]
    variants = [Variant(path, {}) for path in times]
    return ContestRecord(model="m", variants=variants, status=Status.OK, launches=launches)


def advised(
    model_results: ModelResults,
    contest: ContestRecord | None = None,
    total_steps: int | None = None,
) -> list[Advice]:
    model = replace(model_results.model, total_steps=total_steps)
    return advise(replace(model_results, model=model, contest=contest))


def names(groups: list[list[Variant]]) -> list[list[str]]:
    return [[variant.path for variant in group] for group in groups]


def test_the_fastest_of_each_loop_is_advised_once_it_is_certainly_faster() -> None:
    model_results = derived(
        python_loop=LOOP,
        rollout={"samples_s": [0.25] * 7},
        batch_step={"samples_s": [0.5] * 7, "closed_loop": True},
        threads={"samples_s": [0.1] * 7, "agrees": False, "status": Status.DISAGREES},
    )
    assert names(contest_groups(model_results)) == [
        ["python_loop", "rollout"],
        ["python_loop", "batch_step"],
    ]
    again = contest(python_loop=1.0, rollout=0.25, batch_step=0.5)
    assert contest_groups(replace(model_results, contest=again)) == []
    advice = advised(model_results, again)
    assert [(a.loop, a.path, a.reason) for a in advice] == [
        (Loop.OPEN, "rollout", Reason.FASTER),
        (Loop.CLOSED, "batch_step", Reason.FASTER),
    ]
    first = advice[0]
    assert first.speedup == pytest.approx(4.0, rel=1e-3)
    assert first.low is not None
    assert first.high is not None
    assert 3.9 < first.low < 4.0 < first.high < 4.1


def test_fresh_processes_decide_between_paths_that_seem_about_as_fast() -> None:
    model_results = derived(
        python_loop=LOOP,
        rollout={"samples_s": [0.55] * 7},
        threads={"samples_s": [0.50] * 7, "closed_loop": True},
        processes={"samples_s": [0.65] * 7, "closed_loop": True},
    )
    assert names(contest_groups(model_results))[0] == ["python_loop", "rollout", "threads"]
    advice = advised(model_results, contest(python_loop=1.0, rollout=0.5, threads=0.6))
    assert [(a.path, a.reason) for a in advice] == [
        ("rollout", Reason.FASTER),
        ("threads", Reason.FASTER),
    ]


def test_ray_is_never_advised_and_named_where_it_seems_faster() -> None:
    model_results = derived(
        python_loop=LOOP, rollout={"samples_s": [0.5] * 7}, ray={"samples_s": [0.4] * 7}
    )
    assert names(contest_groups(model_results)) == [["python_loop", "rollout"]]
    open_loop, closed_loop = advised(model_results, contest(python_loop=1.0, rollout=0.5))
    assert (open_loop.path, open_loop.reason) == ("rollout", Reason.FASTER)
    reason = "ray: Ray takes too long to start in fresh processes"
    assert open_loop.unable == [reason]
    assert why(open_loop).endswith(f"; cannot run beside the others: {reason}")
    assert closed_loop.unable == []


def test_a_gain_that_is_not_certain_is_not_advised() -> None:
    model_results = derived(python_loop=LOOP, rollout={"samples_s": [0.86] * 7})
    open_loop = advised(model_results, contest(spread=0.4, python_loop=1.0, rollout=0.86))[0]
    assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.NO_GAIN)
    assert open_loop.rival == "rollout"


def test_what_was_not_compared_again_is_not_advised() -> None:
    model_results = derived(python_loop=LOOP, rollout={"samples_s": [0.5] * 7})
    open_loop = advised(model_results)[0]
    assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.UNCONFIRMED)
    again = contest(python_loop=1.0, rollout=0.5)
    failed = replace(again, status=Status.FAILED, detail="it fell over")
    late = replace(again, launches=(), detail="it takes too long")
    for record in (failed, late):
        open_loop = advised(model_results, record)[0]
        assert (open_loop.reason, open_loop.detail) == (Reason.UNCONFIRMED, record.detail)


def test_what_nothing_was_compared_with_is_said() -> None:
    alone = derived(python_loop=LOOP, rollout={"samples_s": [0.5] * 7})
    closed = advised(alone, contest(python_loop=1.0, rollout=0.5))[1]
    assert (closed.path, closed.reason) == ("python_loop", Reason.ALONE)
    assert why(closed) == "no other path was timed for it"
    similar = derived(python_loop=LOOP, rollout={"samples_s": [1.05] * 7})
    open_loop = advised(similar)[0]
    assert (open_loop.reason, open_loop.rival) == (Reason.UNCONFIRMED, "")
    assert why(open_loop) == "no path seems faster; nothing was compared again in fresh processes"


def test_a_path_that_cannot_run_beside_the_others_is_named() -> None:
    model_results = derived(
        python_loop=LOOP, rollout={"samples_s": [0.5] * 7}, threads={"samples_s": [0.5] * 7}
    )
    unable = [UnableVariant(2, "out of memory")]
    record = replace(contest(python_loop=1.0, rollout=0.5, threads=0.4), unable=unable)
    open_loop = advised(model_results, record)[0]
    assert (open_loop.path, open_loop.reason) == ("rollout", Reason.FASTER)
    assert open_loop.unable == ["threads: out of memory"]
    assert why(open_loop).endswith("; cannot run beside the others: threads: out of memory")
    for unable in ([UnableVariant(0, "no")], [UnableVariant(1, "no"), UnableVariant(2, "no")]):
        open_loop = advised(model_results, replace(record, unable=unable))[0]
        assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.UNCONFIRMED)
        assert len(open_loop.unable) == len(unable)


def test_a_run_of_an_earlier_version_says_so() -> None:
    model_results = derived(python_loop=LOOP, rollout={"samples_s": [0.5] * 7})
    pair = ConfirmationRecord(
        model="m",
        baseline="python_loop",
        baseline_options={},
        candidate="rollout",
        candidate_options={},
        status=Status.OK,
    )
    open_loop = advise(replace(model_results, confirmations=(pair,)))[0]
    assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.UNCONFIRMED)
    assert "earlier version" in open_loop.detail


@pytest.mark.parametrize(
    ("time", "path", "reason"),
    [(0.49, "batch_step", Reason.SIMPLER), (0.48, "threads", Reason.FASTER)],
)
def test_within_three_percent_the_simpler_wins(time: float, path: str, reason: Reason) -> None:
    model_results = derived(
        python_loop=LOOP,
        batch_step={"samples_s": [0.52] * 7, "closed_loop": True},
        threads={"samples_s": [0.50] * 7, "closed_loop": True},
    )
    advice = advised(model_results, contest(python_loop=1.0, batch_step=0.5, threads=time))
    assert {(a.path, a.reason) for a in advice} == {(path, reason)}


def test_a_plain_loop_that_is_as_fast_is_advised() -> None:
    model_results = derived(
        python_loop=LOOP, python_loop_hold={"samples_s": [0.995] * 7, "closed_loop": True}
    )
    assert names(contest_groups(model_results)) == [["python_loop", "python_loop_hold"]] * 2
    advice = advised(model_results, contest(python_loop=1.0, python_loop_hold=0.995))
    assert {(a.path, a.reason) for a in advice} == {("python_loop", Reason.SIMPLER)}


def test_the_plain_loop_needs_no_contest_where_nothing_may_be_faster() -> None:
    slower = {"samples_s": [1.3] * 7, "closed_loop": True}
    model_results = derived(python_loop=LOOP, threads=slower)
    assert contest_groups(model_results) == []
    assert {(a.path, a.reason) for a in advised(model_results)} == {("python_loop", Reason.NO_GAIN)}


@pytest.mark.parametrize(
    ("total_steps", "path", "reason"),
    [(None, "python_loop", Reason.NO_GAIN), (100_000, "mjx", Reason.PAYS)],
)
def test_compiling_must_pay_within_the_steps_asked_for(
    total_steps: int | None, path: str, reason: Reason
) -> None:
    # a block of 1,000 steps saves 0.5 s; 4 s are 8,000 steps
    model_results = derived(python_loop=LOOP, mjx={"samples_s": [0.5] * 7, **COMPILED})
    assert contest_groups(model_results) == []
    advice = advised(model_results, total_steps=total_steps)
    assert {(a.path, a.reason) for a in advice} == {(path, reason)}
    assert all("after 8,000 steps" in a.break_even for a in advice)


def test_a_path_that_was_not_timed_to_the_end_is_not_advised() -> None:
    model_results = derived(
        python_loop={"samples_s": [1.0] * 9, "closed_loop": True},
        rollout={"samples_s": [0.25] * 7, "closed_loop": True},
    )
    assert contest_groups(model_results) == []
    assert {a.path for a in advise(model_results)} == {"python_loop"}


@pytest.mark.parametrize("row", [{"status": Status.TIMEOUT, "agrees": None}, {}])
def test_a_model_whose_plain_loop_was_not_timed_gets_no_advice(row: dict[str, Any]) -> None:
    model_results = derived(python_loop=row, rollout={"samples_s": [0.5] * 7})
    assert contest_groups(model_results) == []
    assert advise(model_results) == []
