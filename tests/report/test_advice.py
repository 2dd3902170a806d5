"""Which path is advised, and what has to be compared again before."""

from dataclasses import replace
from typing import Any

import pytest
from example_records import measurement, model_record

from mjbench.comparison.plan import Variant
from mjbench.paired.confirmation import ConfirmationRecord
from mjbench.paired.records import Ratio
from mjbench.report import results
from mjbench.report.advice import Advice, Loop, Pairing, Reason, advise, next_pairing
from mjbench.report.results import ModelResults
from mjbench.simulation.accelerated_limits import Precision
from mjbench.status import Status

COMPILED = {"precision": Precision.FLOAT32, "trace_s": 1.0, "compile_s": 3.0, "closed_loop": True}
LOOP = {"samples_s": [1.0] * 7, "closed_loop": True}


def derived(**rows: dict[str, Any]) -> ModelResults:
    records = [measurement(path=path, **row) for path, row in rows.items()]
    return results.derive(model_record(), records)


def confirmed(
    model_results: ModelResults, *confirmations: ConfirmationRecord, total_steps: int | None = None
) -> list[Advice]:
    model = replace(model_results.model, total_steps=total_steps)
    return advise(replace(model_results, model=model, confirmations=confirmations))


def again(
    baseline: str, candidate: str, ratio: tuple[float, float, float] | None, **fields: Any
) -> ConfirmationRecord:
    return ConfirmationRecord(
        **{
            "model": "m",
            "baseline": baseline,
            "baseline_options": {},
            "candidate": candidate,
            "candidate_options": {},
            "status": Status.OK,
            "ratio": Ratio(*ratio) if ratio else None,
            **fields,
        }
    )


def pairing(baseline: str, candidate: str) -> Pairing:
    return Pairing(Variant(baseline, {}), Variant(candidate, {}))


def test_the_fastest_of_each_loop_is_advised_once_it_is_certainly_faster() -> None:
    model_results = derived(
        python_loop=LOOP,
        rollout={"samples_s": [0.25] * 7},
        batch_step={"samples_s": [0.5] * 7, "closed_loop": True},
        threads={"samples_s": [0.1] * 7, "agrees": False, "status": Status.DISAGREES},
    )
    first = again("python_loop", "rollout", (0.25, 0.24, 0.26))
    second = again("python_loop", "batch_step", (0.5, 0.4, 0.6))
    assert next_pairing(model_results) == pairing("python_loop", "rollout")
    with_first = replace(model_results, confirmations=(first,))
    assert next_pairing(with_first) == pairing("python_loop", "batch_step")
    assert next_pairing(replace(with_first, confirmations=(first, second))) is None
    advice = confirmed(model_results, first, second)
    assert [(a.loop, a.path, a.reason) for a in advice] == [
        (Loop.OPEN, "rollout", Reason.FASTER),
        (Loop.CLOSED, "batch_step", Reason.FASTER),
    ]
    assert advice[0].speedup == pytest.approx(4.0)
    assert (advice[0].low, advice[0].high) == (pytest.approx(1 / 0.26), pytest.approx(1 / 0.24))


def test_a_gain_that_is_not_certain_is_not_advised() -> None:
    model_results = derived(python_loop=LOOP, rollout={"samples_s": [0.86] * 7})
    open_loop = confirmed(model_results, again("python_loop", "rollout", (0.86, 0.65, 1.39)))[0]
    assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.NO_GAIN)
    assert open_loop.rival == "rollout"


def test_what_was_not_compared_again_is_not_advised() -> None:
    model_results = derived(python_loop=LOOP, rollout={"samples_s": [0.5] * 7})
    open_loop = advise(model_results)[0]
    assert (open_loop.path, open_loop.reason) == ("python_loop", Reason.UNCONFIRMED)
    failed = again("python_loop", "rollout", None, status=Status.FAILED, detail="it fell over")
    open_loop = confirmed(model_results, failed)[0]
    assert (open_loop.reason, open_loop.detail) == (Reason.UNCONFIRMED, "it fell over")


@pytest.mark.parametrize(
    ("ratio", "path", "reason"),
    [
        ((0.98, 0.97, 0.99), "batch_step", Reason.SIMPLER),
        ((0.96, 0.92, 1.01), "batch_step", Reason.SIMPLER),
        ((0.96, 0.95, 0.97), "threads", Reason.FASTER),
    ],
)
def test_within_three_percent_the_simpler_wins(
    ratio: tuple[float, float, float], path: str, reason: Reason
) -> None:
    model_results = derived(
        python_loop=LOOP,
        batch_step={"samples_s": [0.52] * 7, "closed_loop": True},
        threads={"samples_s": [0.50] * 7, "closed_loop": True},
    )
    assert next_pairing(model_results) == pairing("batch_step", "threads")
    advice = confirmed(
        model_results,
        again("batch_step", "threads", ratio),
        again("python_loop", "batch_step", (0.52, 0.51, 0.53)),
        again("python_loop", "threads", (0.50, 0.49, 0.51)),
    )
    assert {(a.path, a.reason) for a in advice} == {(path, reason)}


def test_a_plain_loop_that_is_as_fast_needs_one_comparison() -> None:
    model_results = derived(
        python_loop=LOOP, python_loop_hold={"samples_s": [0.995] * 7, "closed_loop": True}
    )
    assert next_pairing(model_results) == pairing("python_loop", "python_loop_hold")
    confirmation = again("python_loop", "python_loop_hold", (0.995, 0.99, 0.999))
    assert next_pairing(replace(model_results, confirmations=(confirmation,))) is None
    advice = confirmed(model_results, confirmation)
    assert {(a.path, a.reason) for a in advice} == {("python_loop", Reason.SIMPLER)}


@pytest.mark.parametrize(
    ("total_steps", "path", "reason"),
    [(None, "python_loop", Reason.NO_GAIN), (100_000, "mjx", Reason.PAYS)],
)
def test_compiling_must_pay_within_the_steps_asked_for(
    total_steps: int | None, path: str, reason: Reason
) -> None:
    # a block of 1,000 steps saves 0.5 s; 4 s are 8,000 steps
    model_results = derived(python_loop=LOOP, mjx={"samples_s": [0.5] * 7, **COMPILED})
    assert next_pairing(model_results) is None
    advice = confirmed(model_results, total_steps=total_steps)
    assert {(a.path, a.reason) for a in advice} == {(path, reason)}
    assert all("after 8,000 steps" in a.break_even for a in advice)


def test_a_path_that_was_not_timed_to_the_end_is_not_advised() -> None:
    model_results = derived(
        python_loop={"samples_s": [1.0] * 9, "closed_loop": True},
        rollout={"samples_s": [0.25] * 7, "closed_loop": True},
    )
    assert next_pairing(model_results) is None
    assert {a.path for a in advise(model_results)} == {"python_loop"}


@pytest.mark.parametrize("row", [{"status": Status.TIMEOUT, "agrees": None}, {}])
def test_a_model_whose_plain_loop_was_not_timed_gets_no_advice(row: dict[str, Any]) -> None:
    model_results = derived(python_loop=row, rollout={"samples_s": [0.5] * 7})
    assert next_pairing(model_results) is None
    assert advise(model_results) == []
