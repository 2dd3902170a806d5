"""Which path is advised."""

from typing import Any

import pytest
from example_records import measurement, model_record

from mjbench.report import results
from mjbench.report.advice import Advice, Loop, advise
from mjbench.status import Status


def advised(**rows: dict[str, Any]) -> list[Advice]:
    records = [measurement(path=path, **row) for path, row in rows.items()]
    return advise(results.derive(model_record(), records).results)


def test_advice_names_the_fastest_open_loop_and_the_fastest_closed_loop_path() -> None:
    advice = advised(
        python_loop={"samples_s": [1.0] * 7, "closed_loop": True},
        rollout={"samples_s": [0.25] * 7},
        batch_step={"samples_s": [0.5] * 7, "closed_loop": True},
        threads={"samples_s": [0.1] * 7, "agrees": False, "status": Status.DISAGREES},
    )
    assert [(a.loop, a.path) for a in advice] == [
        (Loop.OPEN, "rollout"),
        (Loop.CLOSED, "batch_step"),
    ]
    assert advice[0].speedup == pytest.approx(4.0)


def test_advice_prefers_the_simpler_of_two_equally_fast_paths() -> None:
    advice = advised(
        python_loop={"samples_s": [1.000] * 7, "closed_loop": True},
        python_loop_hold={"samples_s": [0.995] * 7, "closed_loop": True},
    )
    assert {a.path for a in advice} == {"python_loop"}


def test_a_path_that_was_not_timed_to_the_end_is_not_advised() -> None:
    advice = advised(
        python_loop={"samples_s": [1.0] * 9, "closed_loop": True},
        rollout={"samples_s": [0.25] * 7, "closed_loop": True},
    )
    assert {a.path for a in advice} == {"python_loop"}


def test_a_model_on_which_nothing_was_timed_gets_no_advice() -> None:
    assert advised(python_loop={"status": Status.TIMEOUT, "agrees": None}) == []
