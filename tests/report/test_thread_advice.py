"""How many threads a path should have, where paths with several numbers of threads raced."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from example_races import Entrant, derived, raced

from mjbench.comparison.plan import Variant
from mjbench.report.comparison import thread_conclusion
from mjbench.report.results import derive
from mjbench.report.thread_advice import ThreadAdvice, advise_threads


def scaled(speedups: Mapping[int, float], **options: Any) -> list[Entrant]:
    return [
        (Variant("rollout", {"threads": threads, **options}), speedup)
        for threads, speedup in speedups.items()
    ]


def advised(*entrants: Entrant, **race: Any) -> ThreadAdvice:
    (advice,) = advise_threads(derived(raced(entrants, **race)))
    return advice


@pytest.mark.parametrize(
    ("speedups", "nthread"),
    [
        ({1: 1.0, 2: 1.9, 4: 3.6}, 4),
        ({1: 1.0, 2: 1.9, 4: 1.95}, 2),
        ({1: 1.0, 2: 0.9, 4: 0.7}, 1),
    ],
)
def test_the_fewest_threads_that_are_about_as_fast_as_any_are_advised(
    speedups: dict[int, float], nthread: int
) -> None:
    advice = advised(*scaled(speedups))
    assert (advice.nthread, advice.most_tried, advice.is_certain) == (nthread, 4, True)
    if nthread == 1:
        assert advice.over_one is None
    else:
        assert advice.over_one is not None
        assert advice.over_one.estimate == pytest.approx(speedups[nthread], rel=0.02)


def test_a_number_of_threads_is_judged_by_its_best_chunk() -> None:
    entrants = [*scaled({1: 1.0, 2: 1.5, 4: 1.6}, chunk=1), *scaled({2: 1.9}, chunk=4)]
    advice = advised(*entrants)
    assert (advice.nthread, advice.chunk) == (2, 4)


@pytest.mark.parametrize("race", [{"cores": 1.0}, {"launches": 1}])
def test_a_race_that_was_disturbed_or_too_short_is_not_certain(race: dict[str, Any]) -> None:
    advice = advised(*scaled({1: 1.0, 2: 1.9, 4: 3.6}), **race)
    assert not advice.is_certain
    assert thread_conclusion(advice).endswith("; not certain")


@pytest.mark.parametrize("fields", [{"is_cut_short": True}, {"launches": 2}])
def test_a_race_that_was_cut_short_or_goes_on_is_not_certain(fields: dict[str, Any]) -> None:
    record = raced(scaled({1: 1.0, 2: 1.9, 4: 3.6}))
    if "launches" in fields:
        fields = {"launches": record.launches[:2]}
    (advice,) = advise_threads(derived(replace(record, **fields)))
    assert not advice.is_certain


def test_one_and_all_cores_are_two_rows_of_the_table_and_no_advice() -> None:
    assert advise_threads(derived(raced(scaled({1: 1.0, 2: 1.9})))) == []


def test_a_file_of_an_earlier_version_has_none() -> None:
    assert advise_threads(derive(derived(raced()).model, [], None)) == []


def test_the_sentences_say_gain_and_interval_over_one_thread() -> None:
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 1.9, 4: 1.95})))
    assert text.startswith("mujoco.rollout: 2 threads, 1.9")
    assert " times one thread (1." in text
    assert text.endswith("); 4 threads gain less than 5 % more")
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 0.9, 4: 0.7})))
    assert text == "mujoco.rollout: one thread; no number up to 4 is certainly faster"
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 1.9, 4: 3.6})), names_size=True)
    assert text.startswith("mujoco.rollout, 10 simulations: 4 threads, ")
