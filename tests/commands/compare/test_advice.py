"""Which path is advised for each loop, how certain that is, and how a sentence says it."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from example_races import (
    BATCH_ROLLOUT,
    BATCH_STEP,
    CLEAR,
    PLAIN,
    ROLLOUT,
    THREADS,
    Entrant,
    derived,
    raced,
)
from example_records import JUDGED, measurement

from mjbench.commands.compare.advice import (
    Reason,
    ThreadAdvice,
    advise,
    advise_clock,
    advise_threads,
    conclusion,
    thread_conclusion,
)
from mjbench.commands.compare.results import ModelResults, PathResult
from mjbench.host.disturbance import Disturbance
from mjbench.host.machine import CoreChange
from mjbench.paired.race_record import AS_GOOD, MARGIN, Loop, UnableVariant
from mjbench.simulation.accelerated_judgement import EngineAnswer, Precision
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER, Variant
from mjbench.verification.records import VariantRecord

POOL = Variant("rollout", {"threads": 2, "pool": "new"})


def sentences(model_results: ModelResults, names_size: bool = False) -> list[str]:
    return [conclusion(advice, names_size) for advice in advise(model_results)]


def chosen(model_results: ModelResults) -> list[tuple[str, Reason, bool]]:
    return [(each.path, each.reason, each.is_certain) for each in advise(model_results)]


def timed(model_results: ModelResults, variant: Variant) -> PathResult:
    result = model_results.timed(variant)
    assert result is not None
    return result


def compiled(speedup: float) -> VariantRecord:
    """Return an accelerated path that takes four seconds to compile."""
    return measurement(
        path="mjx",
        samples_s=[0.001 / speedup] * 3,
        precision=Precision.FLOAT32,
        trace_s=1.0,
        compile_s=3.0,
        closed_loop=True,
    )


def test_the_fastest_of_each_loop_is_advised_with_the_speed_up_of_its_row() -> None:
    model_results = derived(raced())
    assert chosen(model_results) == [
        ("rollout", Reason.FASTER, True),
        ("batch_step", Reason.FASTER, True),
    ]
    rows = {str(result.variant): result for result in model_results.results}
    assert [advice.loop for advice in advise(model_results)] == [Loop.OPEN, Loop.CLOSED]
    for advice, variant in zip(advise(model_results), (ROLLOUT, BATCH_STEP), strict=True):
        assert advice.speedup == rows[str(variant)].speedup


def test_where_a_policy_chooses_every_action_only_closed_loop_is_advised() -> None:
    of_policies = raced([(BATCH_STEP, 2.0)])
    (advice,) = advise(derived(of_policies, nstep=5, hold=5))
    assert (advice.loop, advice.variant) == (Loop.CLOSED, BATCH_STEP)
    assert len(advise(derived(of_policies, nstep=10, hold=5))) == 2
    assert len(advise(derived(raced(), nstep=5, hold=5))) == 2, "rollout is there"


def test_a_conclusion_says_path_speed_up_and_interval() -> None:
    open_loop, closed_loop = sentences(derived(raced()))
    number = r"\d\.\d\d"
    gain = rf"{number} × as fast \({number}–{number}\)"
    begin = r"For controls known beforehand \(open loop\): mujoco.rollout on 2 threads, "
    assert re.fullmatch(begin + gain, open_loop)
    assert re.fullmatch(rf"For RL \(closed loop\): Batch.step on 2 threads, {gain}", closed_loop)


def test_beside_other_sizes_a_conclusion_says_how_many_simulations() -> None:
    first = sentences(derived(raced(), nbatch=64), names_size=True)[0]
    assert first.startswith("For controls known beforehand (open loop), 64 simulations: mujoco.")


@pytest.mark.parametrize(
    ("variant", "text"),
    [
        (PLAIN, "the plain loop"),
        (Variant("batch_step", {"threads": 1, "data": "persistent"}), "Batch.step on 1 thread ("),
        (Variant("processes", {"processes": 4}), "4 worker processes"),
        (Variant("rollout", {"threads": 2, "chunk": 4, "pool": "kept"}), "2 threads (chunk=4)"),
    ],
)
def test_a_sentence_names_a_path_without_options_that_are_usual(
    variant: Variant, text: str
) -> None:
    entrants: list[Entrant] = [(variant, 2.0)] if variant != PLAIN else []
    assert text in sentences(derived(raced(entrants)))[0]


def test_the_simpler_of_two_that_are_as_fast_is_advised() -> None:
    model_results = derived(raced([(ROLLOUT, 3.0), (POOL, 3.003)]))
    assert chosen(model_results)[0] == ("rollout", Reason.SIMPLER, True)
    assert advise(model_results)[0].options == ROLLOUT.options
    assert sentences(model_results)[0].endswith("; no other path is faster by 5 %")


def test_the_plain_loop_is_advised_where_no_path_is_faster() -> None:
    model_results = derived(raced([(ROLLOUT, 0.5), (THREADS, 0.8)]))
    assert chosen(model_results) == [("python_loop", Reason.NO_GAIN, True)] * 2
    assert sentences(model_results)[1] == (
        "For RL (closed loop): the plain loop; no other path is faster by 5 %"
    )
    assert advise(model_results)[0].speedup is None


def test_the_plain_loop_is_no_advice_where_other_paths_may_be_faster() -> None:
    record = raced([(ROLLOUT, 0.95), (BATCH_STEP, 0.95)], spread=0.2, launches=4)
    for sentence in sentences(derived(record)):
        assert ": no path is certainly faster than the plain loop; " in sentence
        assert re.search(r" may be faster by up to \d+ %$", sentence)


def test_a_loop_that_nothing_else_was_timed_for_is_said() -> None:
    model_results = derived(raced([(ROLLOUT, 2.0)]))
    assert chosen(model_results)[1] == ("python_loop", Reason.ALONE, True)
    assert sentences(model_results)[1].endswith("the plain loop; no other path was timed for it")


def test_rivals_are_listed_the_fastest_first_and_one_alone_is_named() -> None:
    near = [(ROLLOUT, 3.0), (POOL, 2.9), (BATCH_STEP, 2.8)]
    model_results = derived(raced(near, spread=0.3, launches=8))
    advice = advise(model_results)[0]
    assert not advice.is_certain
    assert advice.rivals
    assert advice.result not in advice.rivals
    speeds = [rival.steps_per_s or 0.0 for rival in advice.rivals]
    assert speeds == sorted(speeds, reverse=True)
    for count, doubt in (
        (0, " × as fast (2.42–3.83)"),
        (1, "; mujoco.rollout on 2 threads may be faster by up to 4 %"),
        (3, "; 3 other paths may be faster by up to 4 %"),
    ):
        rivals = [timed(model_results, each) for each in (ROLLOUT, POOL, BATCH_STEP)][:count]
        text = conclusion(replace(advice, rivals=rivals, most_gain=0.04))
        assert text.endswith(doubt)
        assert "(open loop): probably " in text


def test_the_plain_loop_is_no_rival_of_a_path_that_is_certainly_faster() -> None:
    model_results = derived(raced([(ROLLOUT, 1.94)], spread=0.5, launches=6))
    assert model_results.race is not None
    assert 0 in model_results.race.standings[Loop.OPEN].contenders
    advice = advise(model_results)[0]
    assert (advice.path, advice.is_certain, advice.rivals) == ("rollout", False, [])
    assert "(open loop): probably mujoco.rollout on 2 threads, " in sentences(model_results)[0]


def test_a_disturbed_race_makes_nothing_certain_where_only_the_plain_loop_was_timed() -> None:
    assert chosen(derived(raced([]))) == [("python_loop", Reason.ALONE, True)] * 2
    disturbed = derived(raced([], disturbance=Disturbance(stolen_share=0.2)))
    assert chosen(disturbed) == [("python_loop", Reason.ALONE, False)] * 2


def test_one_launch_makes_nothing_certain() -> None:
    model_results = derived(raced(launches=1))
    assert chosen(model_results) == [
        ("rollout", Reason.LIKELY, False),
        ("batch_step", Reason.LIKELY, False),
    ]
    assert "(open loop): probably mujoco.rollout on 2 threads, " in sentences(model_results)[0]


@pytest.mark.parametrize(
    "disturbance",
    [
        {"cores": 1.2},
        {"disturbance": Disturbance(stolen_share=0.2)},
        {"disturbance": Disturbance(["latency"])},
        {"disturbance": Disturbance(core_change=CoreChange(2, 1))},
    ],
)
def test_a_disturbed_race_makes_nothing_certain(disturbance: dict[str, Any]) -> None:
    model_results = derived(raced(**disturbance))
    assert chosen(model_results) == [
        ("rollout", Reason.FASTER, False),
        ("batch_step", Reason.FASTER, False),
    ]
    assert len(model_results.disturbances) == 1
    assert all(r.disturbances == model_results.disturbances for r in model_results.results)


def test_a_path_that_left_the_race_is_named_with_the_reason() -> None:
    unable = [UnableVariant(1, Status.FAILED, "out of memory while timing")]
    open_loop, closed_loop = sentences(derived(replace(raced(), unable=unable)))
    left = "; rollout threads=2 pool=kept left: out of memory while timing"
    assert open_loop.endswith(left)
    assert "rollout" not in closed_loop, "RL cannot use it"


def test_the_next_best_is_advised_where_the_winner_failed_after_the_race() -> None:
    record = raced([(ROLLOUT, 3.0), (BATCH_STEP, 2.0)])
    failed = replace(record, unable=[UnableVariant(1, Status.CRASHED, "killed")])
    open_loop, closed_loop = advise(derived(failed))
    assert (open_loop.path, open_loop.is_certain) == ("batch_step", True)
    assert ROLLOUT not in open_loop.rivals
    assert (closed_loop.path, closed_loop.is_certain) == ("batch_step", True)


def test_a_path_that_starts_slowly_is_never_advised_and_named_where_it_is_faster() -> None:
    record = raced([(ROLLOUT, 2.0), (BATCH_ROLLOUT, 4.0)], slow=[2], groups=[[0, 1], [0]])
    first, second = sentences(derived(record))
    assert first.endswith("; batch_rollout threads=2 is faster, but takes seconds to start")
    assert "mujoco.rollout on 2 threads, 2.0" in first
    assert "batch_rollout" not in second


@pytest.mark.parametrize(
    ("total_steps", "path", "reason"),
    [(None, "python_loop", Reason.NO_GAIN), (100_000_000, "mjx", Reason.PAYS)],
)
def test_compiling_must_pay_within_the_steps_asked_for(
    total_steps: int | None, path: str, reason: Reason
) -> None:
    # a step of 1 µs becomes one of 0.5 µs; four seconds are about 8,000,000 steps
    race = raced([(THREADS, 0.8)], spread=0.0)
    model_results = derived(race, more=[compiled(2.0)], total_steps=total_steps)
    assert {(a.path, a.reason) for a in advise(model_results)} == {(path, reason)}
    assert all("after 8,000,000" in a.break_even for a in advise(model_results))


def test_compiling_must_pay_over_the_c_path_that_it_displaces() -> None:
    # a step of 0.5 µs becomes one of 0.4 µs; four seconds are 40,000,000 steps of these, and of the
    # plain loop's about 6,700,000
    entrants = [(BATCH_STEP, 2.0)]
    for total_steps, reason in ((10_000_000, Reason.FASTER), (50_000_000, Reason.PAYS)):
        model_results = derived(raced(entrants), more=[compiled(2.5)], total_steps=total_steps)
        _, advice = advise(model_results)
        assert advice.reason == reason
        assert re.search(r"after (39|40|41),\d\d\d,\d\d\d steps", advice.break_even)
        (own,) = (r for r in model_results.results if r.is_accelerated)
        assert own.overtakes_after_steps == pytest.approx(6.7e6, rel=0.02)


def test_compiling_must_pay_over_a_path_that_may_be_faster_than_the_one_advised() -> None:
    uncertain = raced([(ROLLOUT, 20.0), (POOL, 19.0)], spread=1.0, launches=2)
    model_results = derived(uncertain, more=[compiled(4.0)], total_steps=1000)
    open_loop, closed_loop = advise(model_results)
    assert (open_loop.path, open_loop.is_certain) == ("rollout", False)
    assert not open_loop.break_even
    assert "would pay after" in closed_loop.break_even


def test_of_paths_that_compile_the_fastest_that_pays_is_advised() -> None:
    quick = replace(compiled(1.5), path="warp", compile_s=0.5)
    models = [
        derived(raced([(THREADS, 0.8)]), more=[compiled(4.0), quick], total_steps=total_steps)
        for total_steps in (1_000_000, 5_000_000, 50_000_000)
    ]
    assert [advise(each)[0].path for each in models] == ["python_loop", "warp", "mjx"]
    assert advise(models[0])[0].break_even.startswith("warp would pay after ")


def test_the_advice_of_a_path_that_is_close_says_what_differs() -> None:
    close = replace(JUDGED, answer=EngineAnswer.CLOSE, reason="contacts: box–box: 4 instead of 8")
    record = replace(compiled(4.0), judgement=close)
    advice = advise(derived(raced([(THREADS, 0.8)]), more=[record], total_steps=50_000_000))[0]
    assert (advice.path, advice.result.difference) == ("mjx", "contacts: box–box: 4 instead of 8")
    assert "close to C, not the same: contacts: box–box: 4 instead of 8" in conclusion(advice)


def test_a_path_that_was_not_judged_is_not_advised() -> None:
    record = replace(compiled(4.0), judgement=replace(JUDGED, answer=EngineAnswer.NOT_JUDGED))
    advice = advise(derived(raced([(THREADS, 0.8)]), more=[record], total_steps=50_000_000))[0]
    assert advice.path == "python_loop"


def test_the_timer_is_advised_on_where_turning_it_off_certainly_gains() -> None:
    clock = advise_clock(derived(raced([*CLEAR, (WITHOUT_TIMER, 1.2)])))
    assert clock is not None
    assert clock.speedup.estimate == pytest.approx(1.2, rel=0.01)
    assert advise_clock(derived(raced([*CLEAR, (WITHOUT_TIMER, 1.01)]))) is None


def test_a_model_whose_plain_loop_was_not_timed_gets_no_advice() -> None:
    record = replace(raced(), launches=())
    assert advise(derived(record)) == []


@pytest.mark.parametrize("launches", [11, 19, 21, 25])
def test_where_a_race_is_undecided_no_loop_is_advised_a_path_that_the_other_beats(
    launches: int,
) -> None:
    entrants = [(ROLLOUT, 1.9), (BATCH_STEP, 1.9), (THREADS, 1.5)]
    open_loop, closed_loop = advise(derived(raced(entrants, spread=0.3, launches=launches)))
    assert open_loop.speedup is not None
    assert closed_loop.speedup is not None
    assert open_loop.speedup.estimate * (1 + MARGIN) >= closed_loop.speedup.estimate
    assert not open_loop.is_certain


@pytest.mark.parametrize(("spread", "launches"), [(0.15, 19), (0.2, 22), (0.3, 21), (0.3, 25)])
def test_only_what_is_likely_to_be_faster_is_advised_in_place_of_the_plain_loop(
    spread: float, launches: int
) -> None:
    entrants = [(ROLLOUT, 1.02), (BATCH_STEP, 1.02), (THREADS, 0.9)]
    advice = advise(derived(raced(entrants, spread=spread, launches=launches)))
    assert len(advice) == 2
    for each in advice:
        likely = each.speedup is None or each.speedup.estimate > 1 + AS_GOOD
        assert likely or (each.speedup and each.speedup.is_above(1.0))


# how many threads


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
    [({1: 1.0, 2: 1.9, 4: 3.6}, 4), ({1: 1.0, 2: 1.9, 4: 1.95}, 2), ({1: 1.0, 2: 0.9, 4: 0.7}, 1)],
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
    assert advise_threads(ModelResults(derived(raced()).model, ())) == []


def test_the_sentences_say_gain_and_interval_over_one_thread() -> None:
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 1.9, 4: 1.95})))
    assert text.startswith("mujoco.rollout: 2 threads are enough, 1.9")
    assert " × as fast (1." in text
    assert text.endswith(") as one thread; up to 4 threads gain less than 5 % more")
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 0.9, 4: 0.7})))
    assert text == "mujoco.rollout: no number of threads up to 4 is certainly faster than one"
    text = thread_conclusion(advised(*scaled({1: 1.0, 2: 1.9, 4: 3.6})), names_size=True)
    assert text.startswith("mujoco.rollout, 10 simulations: 4 threads are enough, ")
