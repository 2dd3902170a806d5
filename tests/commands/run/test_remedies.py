"""What to do first follows from where the time goes."""

from dataclasses import replace
from pathlib import Path

import pytest

from mjbench.commands.lint.check import Finding
from mjbench.commands.run import activities
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import ArgumentChange, CallThreads, CallTime, Incident
from mjbench.commands.run.hook import argument_types, call_clock
from mjbench.commands.run.loop_time import LineTime, LoopTime
from mjbench.commands.run.remedies import call_ways, line_remedies, listing, loop_remedies
from mjbench.commands.run.remedies.call_remedies import CALL_REMEDIES
from mjbench.commands.run.remedies.line_remedies import LINE_REMEDIES
from mjbench.commands.run.remedies.remedy import Basis, Remedy, RemedyKind
from mjbench.commands.run.remedies.remedy_pairs import MeasuredRatios, RemedyPair, TimeRatio
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.commands.run.thread_pools import ThreadPools

PHYSICS, PYTHON, NUMPY = Activity.PHYSICS, Activity.PYTHON, Activity.NUMPY
BINDINGS = Activity.BINDINGS
NAMED_ACCESS = RemedyPair(line_remedies.named_access, by_wall_time=True)


def line(number, activities, function="main", package=""):
    place = Place("train.py", number, function, "text")
    return LineTime(place, sum(activities.values()), activities, package)


def loop(*lines, activities=None):
    total: dict[Activity, float] = {}
    for each in lines:
        for activity, share in each.activities.items():
            total[activity] = total.get(activity, 0.0) + share
    return LoopTime(
        loop=SourceLoop("train.py", 10, 20),
        own_files=[],
        threads=["MainThread"],
        pids=[1],
        in_main=True,
        samples=400,
        seconds=10.0,
        activities=activities or total,
        lines=lines,
        inner_functions=[],
    )


def call(callee, number=15, calls=100, seconds=2.0, text="text", **more):
    """Return calls from a line of the loop, which takes 10 seconds."""
    values = {"steps": 0.0, "all_steps": 0.0, **more}
    place = Place("train.py", number, "main", text)
    whole = SourceLoop("train.py", 10, 20)
    return CallTime(callee, 1, 1, place, whole, calls, seconds, 0, 10**10, **values)


def step(seconds=5.0, calls=1000, **more):
    text = "mj_step(m, d)"
    return call("mj_step", 12, calls, seconds, text, steps=calls, all_steps=calls, **more)


def loop_of(*calls):
    """Return the loop with calls; what else it does is nothing to be changed."""
    return replace(loop(activities={PHYSICS: 1.0}), calls=calls)


def finding(code, number=15, message="do otherwise", **more):
    return Finding("train.py", number, 1, code, message, None, **more)


def ratio(estimate, saved_s=0.01):
    return TimeRatio(estimate, estimate, estimate, saved_s)


EVERYTHING_ELSE = [
    each for each in Activity if each not in (Activity.COLLECTION, *activities.WAITING)
]


@pytest.mark.parametrize("activity", EVERYTHING_ELSE)
def test_what_takes_time_has_no_remedy_by_itself(activity):
    assert listing.remedies(loop(line(12, {PHYSICS: 0.4}), line(13, {activity: 0.6}))) == []


def test_a_finding_without_a_row_of_its_own_has_the_share_of_its_lines_with_its_error():
    lines = [line(12, {PHYSICS: 0.4}), line(14, {BINDINGS: 0.2}), line(15, {NUMPY: 0.4})]
    scan = replace(finding("MJB099", number=13), last_line=15)
    (first,) = listing.remedies(loop(*lines), [scan])
    assert (first.where, first.code, first.text) == ("train.py:13–15", "MJB099", "do otherwise")
    assert (first.basis, first.gain, first.activity) == (Basis.BOUND, pytest.approx(0.6), NUMPY)
    assert first.gain_error == pytest.approx((0.6 * 0.4 / 400) ** 0.5)
    assert [first.is_at(each.place) for each in lines] == [False, True, True]


def test_one_call_saves_loops_with_the_steps_that_other_functions_make():
    inside = [line(12, {PHYSICS: 0.5, PYTHON: 0.1}), line(16, {PHYSICS: 0.2, PYTHON: 0.1})]
    time = replace(loop(line(40, {PHYSICS: 0.9, PYTHON: 0.1})), lines_on_stack=inside)
    found = [finding("MJB020", number) for number in (15, 11)]
    loops = [replace(f, last_line=f.line + 3, instead=("mjd_transitionFD",)) for f in found]
    (pair,) = listing.pairs([time], loops)
    assert pair.ways is line_remedies.columns
    (first,) = listing.remedies(time, loops, MeasuredRatios({pair: ratio(0.5)}))
    assert (first.where, first.basis) == ("train.py:11–18", Basis.PAIRED)
    assert first.share == pytest.approx(0.9)
    assert first.gain == pytest.approx(0.9 - 0.5 * 0.7)
    (first,) = listing.remedies(time, loops)
    assert (first.basis, first.gain) == (Basis.BOUND, pytest.approx(0.9))


def test_a_finding_on_the_line_of_a_step_does_not_save_the_step():
    time = loop(line(12, {PHYSICS: 0.7, PYTHON: 0.3}))
    (first,) = listing.remedies(time, [finding("MJB099", number=12)])
    assert first.gain == pytest.approx(0.3)


def test_settling_goes_with_its_steps_on_one_line_or_several():
    time = loop(line(12, {PHYSICS: 0.7, PYTHON: 0.3}))
    (first,) = listing.remedies(time, [finding("MJB023", number=12)])
    assert first.gain == pytest.approx(1.0)


def test_plans_that_are_known_are_stepped_by_one_call():
    inside = [line(12, {PHYSICS: 0.6, PYTHON: 0.3})]
    time = replace(loop(line(40, {PHYSICS: 0.6, PYTHON: 0.3})), lines_on_stack=inside)
    serial = finding("MJB006", number=12)
    assert listing.remedies(time, [serial]) == [], "its controls may follow from the state"
    plans = replace(serial, instead=("rollout",))
    (pair,) = listing.pairs([time], [plans])
    assert pair.ways is call_ways.rollouts
    (first,) = listing.remedies(time, [plans], MeasuredRatios({pair: ratio(0.5)}))
    assert (first.where, first.gain) == ("train.py:12", pytest.approx(0.9 - 0.3))


def test_gains_below_three_percent_are_left_out():
    time = loop(line(12, {PHYSICS: 0.972, PYTHON: 0.028}))
    assert listing.remedies(time) == []


def test_of_few_samples_no_line_is_named():
    time = loop(line(12, {PHYSICS: 0.6}), line(13, {PYTHON: 0.4}))
    assert listing.remedies(replace(time, samples=29)) == []


# What calls must be like to need a remedy, by callee, and where callees have several by its text.
CONTEXTS = {
    "mj_ray": {"calls": 36_000},
    "mj_inverse": {"calls": 1000, "text": "mj_inverse(m, d)"},
}
ROLLOUT_CONTEXTS = {
    "rollout takes these simulations": {"steps": 100, "all_steps": 800},
    "rollout copies states": {"steps": 100, "all_steps": 100},
    "rollout copies all states": {"steps": 100, "all_steps": 10_000},
    "each step is handed over to threads": {"steps": 100, "all_steps": 800},
}


@pytest.mark.parametrize("remedy", CALL_REMEDIES, ids=lambda each: each.callees[0])
def test_each_call_in_a_loop_has_its_remedy(remedy):
    codes = [finding(remedy.codes[0])] if remedy.needs_finding else []
    for callee in remedy.callees:
        of_text = [more for text, more in ROLLOUT_CONTEXTS.items() if remedy.text.startswith(text)]
        context = {**CONTEXTS.get(callee, {}), **(of_text[0] if of_text else {})}
        time = loop_of(step(), call(callee, **context))
        asked = listing.pairs([time], codes)
        # of two ways to replace a call, one is no faster
        rest = [pair for pair in asked if "Batch.step" not in (pair.functions or ())]
        faster = rest if remedy.text.startswith("each step") else asked
        measured = MeasuredRatios({each: ratio(0.5) for each in faster})
        (listed,) = [r for r in listing.remedies(time, codes, measured) if r.kind == "call"]
        assert listed.place.line == 15
        assert listed.share == pytest.approx(0.2)
        assert 0.05 < listed.gain < 0.5
        assert "{count}" not in listed.text


@pytest.mark.parametrize(("chunk_size", "gain"), [(4, 0.1), (2, 0.0), (0, 0.0)])
def test_chunks_that_leave_threads_without_work_are_said_in_a_loop(monkeypatch, chunk_size, gain):
    monkeypatch.setattr(loop_remedies.machine, "usable_cores", lambda: 2)
    threads = CallThreads(2, chunk_size, has_sensors=False)
    calls = call("Rollout.rollout", steps=5000, all_steps=20_000, threads=threads)
    listed = listing.remedies(loop_of(calls))
    assert [each.gain for each in listed] == [pytest.approx(gain)] * (gain > 0)
    assert all(each.text.endswith("chunk_size=2 uses all") for each in listed)


@pytest.mark.parametrize("remedy", CALL_REMEDIES, ids=lambda each: each.callees[0])
def test_a_call_that_is_made_once_or_twice_is_set_up(remedy):
    time = loop_of(step(), call(remedy.callees[0], calls=2))
    assert [each for each in listing.remedies(time) if each.kind == "call"] == []


def test_a_call_that_leaves_the_loop_saves_its_time_but_for_one():
    time = loop_of(step(), call("compile", calls=4, seconds=4.0))
    (remedy,) = listing.remedies(time)
    assert remedy.basis == Basis.TIMED
    assert remedy.gain == pytest.approx(0.3)


def test_what_replaces_a_call_is_subtracted_from_all_that_it_costs():
    """Its steps take longer, too, and it is freed; few samples do not show for how long."""
    other = LineTime(Place("train.py", 19, "main", "text"), 0.2, {NUMPY: 0.2})
    whole = loop_of(step(seconds=2.0), call("MjData", seconds=4.0))
    time = replace(whole, lines=[other], activities={PHYSICS: 0.8, NUMPY: 0.2})
    pair = RemedyPair(call_ways.new_data, ("MjData", "mj_copyData"), steps=10)
    assert pair in listing.pairs([time], [])
    measured = MeasuredRatios({pair: replace(ratio(0.25), created_share=2 / 3)})
    remedy = next(each for each in listing.remedies(time, [], measured) if each.kind == "call")
    assert (remedy.basis, remedy.gain) == (Basis.PAIRED, pytest.approx(0.75 * 0.8))
    (few,) = listing.remedies(replace(time, samples=10), [], measured)
    assert few.gain == pytest.approx(0.75 * 0.4 / (2 / 3))
    bound = next(each for each in listing.remedies(time) if each.kind == "call")
    assert (bound.basis, bound.gain) == (Basis.BOUND, pytest.approx(0.4))


def test_an_object_whose_creation_no_clock_saw_saves_no_more_than_its_lines():
    time = replace(loop_of(step(seconds=2.0), call("MjData", seconds=4.0)), samples=10)
    pair = RemedyPair(call_ways.new_data, ("MjData", "mj_copyData"), steps=10)
    measured = MeasuredRatios({pair: replace(ratio(0.25), created_share=0.0)})
    (remedy,) = [each for each in listing.remedies(time, [], measured) if each.kind == "call"]
    assert remedy.gain <= 1.0


def test_functions_that_no_clock_saw_save_nothing():
    found = finding("MJB007", instead=("mj_kinematics",))
    time = loop_of(step(seconds=0.0), call("mj_forward", calls=1000, seconds=0.0))
    measured = MeasuredRatios({RemedyPair(call_ways.functions, ("mj_kinematics",)): ratio(2 / 3)})
    assert listing.remedies(time, [found], measured) == []


def test_a_new_mjdata_costs_only_its_first_steps():
    """Of 250 steps that follow each MjData, 50 are in the pair."""
    time = loop_of(step(seconds=8.0), call("MjData", calls=4, seconds=1.99))
    pair = RemedyPair(call_ways.new_data, ("MjData", "mj_copyData"), steps=50)
    assert pair in listing.pairs([time], [])
    measured = MeasuredRatios({pair: replace(ratio(0.5), created_share=0.2)})
    (gain,) = [each.gain for each in listing.remedies(time, [], measured) if each.kind == "call"]
    assert gain == pytest.approx(0.5 * (0.99 - (0.99 - 0.199) * 200 / 250))
    measured = MeasuredRatios({pair: replace(ratio(0.5, saved_s=1.0), created_share=0.2)})
    (gain,) = [each.gain for each in listing.remedies(time, [], measured) if each.kind == "call"]
    assert gain == pytest.approx(4 * 1.0 / 10), "what the pair saves each time is less of no step"


def test_what_a_new_mjdata_saves_does_not_grow_with_what_python_does_to_call_steps():
    """Of 200 steps that follow each MjData, 50 are in the pair, which takes 20 + 50 us.

    An MjData takes 20 us, of which a copy saves 18, a step 0.6 and its call 0.4, other lines 55.
    """
    whole_us = 20 + 200 + 55
    seen = loop(
        line(12, {PHYSICS: 120 / whole_us, BINDINGS: 80 / whole_us}),
        line(15, {Activity.COPYING: 20 / whole_us}),
        line(19, {NUMPY: 55 / whole_us}),
    )
    creation = call("MjData", calls=100, seconds=10 * 20 / whole_us)
    time = replace(seen, calls=[step(seconds=10 * 120 / whole_us, calls=20_000), creation])
    pair = RemedyPair(call_ways.new_data, ("MjData", "mj_copyData"), steps=50)
    assert pair in listing.pairs([time], [])
    of_pair = ratio(1 - 18 / 70, saved_s=0.1 * 18 / whole_us)
    measured = MeasuredRatios({pair: replace(of_pair, created_share=20 / 70)})
    (gain,) = [each.gain for each in listing.remedies(time, [], measured) if each.kind == "call"]
    assert gain == pytest.approx(18 / whole_us)


def test_what_may_be_chance_is_not_suggested():
    time = loop_of(step())
    (pair,) = listing.pairs([time], [])
    chance = replace(ratio(0.5), high=1.1)
    assert listing.remedies(time, [], MeasuredRatios({pair: chance})) == []
    (timer,) = listing.remedies(time, [], MeasuredRatios({pair: ratio(0.5)}))
    assert timer.gain == pytest.approx(0.5 * 0.99)  # no other line is seen
    few = replace(time, samples=10)
    (timer,) = listing.remedies(few, [], MeasuredRatios({pair: ratio(0.5)}))
    assert timer.gain == pytest.approx(0.25)  # of the steps, which take half of the loop


def test_a_model_that_is_built_leaves_the_loop_with_all_that_this_takes():
    building = LineTime(Place("train.py", 15, "main", "scene()"), 0.9, {Activity.BUILDING: 0.9})
    time = loop_of(step(seconds=1.0), call("from_xml_string", number=3, seconds=1.0))
    shares = {Activity.BUILDING: 0.8, PHYSICS: 0.1, Activity.LOADING: 0.1}
    (remedy,) = listing.remedies(replace(time, activities=shares, building=building))
    assert (remedy.place.line, remedy.gain, remedy.basis) == (15, 0.9, Basis.BOUND)


@pytest.mark.parametrize("loads", [0, 2])
def test_models_that_are_built_before_the_steps_are_no_remedy(loads):
    building = LineTime(Place("train.py", 15, "main", "scene()"), 0.9, {Activity.BUILDING: 0.9})
    time = loop_of(step(seconds=1.0), call("compile", calls=loads, seconds=1.0))
    assert listing.remedies(replace(time, building=building)) == []


@pytest.mark.parametrize("loads", [2, 4])
def test_only_an_mjdata_of_each_new_model_needs_no_advice(loads):
    loading = call("from_xml_path", number=13, calls=loads, seconds=1.0)
    created = call("MjData", number=14, calls=4, seconds=1.0)
    copied = call(call_clock.COPY_OF_DATA, number=15, calls=1000, seconds=5.0)
    listed = listing.remedies(loop_of(step(seconds=3.0), loading, created, copied))
    lines = {each.place.line for each in listed}
    assert lines == ({13, 15} if loads == 4 else {14, 15})
    if loads == 4:  # the MjData of each model goes with it
        assert next(r for r in listed if r.place.line == 13).share == pytest.approx(0.2)


def test_who_copies_a_model_is_told_that_several_mjdata_share_one():
    copied = call("copy of MjModel", number=13, calls=100, seconds=4.0)
    (remedy,) = listing.remedies(loop_of(step(), copied))
    assert "several MjData can share one MjModel" in remedy.text
    assert remedy.gain == pytest.approx(0.4)


@pytest.mark.parametrize("callee", call_clock.COPIES_OF_DATA)
def test_a_copy_of_an_mjdata_is_compared_with_a_copy_of_its_kind(callee):
    pair = RemedyPair(call_ways.new_data, (callee, "mj_copyData"), steps=10, of_copied=True)
    assert pair in listing.pairs([loop_of(step(), call(callee))], [])


def test_a_renderer_is_tried_at_its_size_and_with_its_library():
    time = loop_of(step(), call("Renderer", frame=(48, 64), backend="egl"))
    asked = listing.pairs([time], [])
    assert RemedyPair(call_ways.renderer, frame=(48, 64), backend="egl", by_wall_time=True) in asked


def drawing(count):
    draws = call("render", 16, count, 7.0, frame=(48, 64), backend="egl")
    return loop_of(step(2.0), call("update_scene", 15, count, 1.0), draws)


@pytest.mark.parametrize(
    ("count", "gains"), [(120, []), (230, []), (240, [0.8 / 2]), (1000, [0.8 * 7 / 8])]
)
def test_more_images_than_a_video_shows_are_left_out(count, gains):
    """1,000 steps of 2 ms are two seconds, and 120 images of a video."""
    listed = listing.remedies(drawing(count), timestep_s=0.002)
    assert [each.gain for each in listed] == pytest.approx(gains)
    assert listing.remedies(drawing(count)) == []


def test_coarser_images_save_a_part_of_all_that_draws():
    pair = RemedyPair(call_ways.coarser_images, frame=(48, 64), backend="egl", by_wall_time=True)
    time = drawing(100)
    assert pair in listing.pairs([time], [])
    (coarser,) = listing.remedies(time, [], MeasuredRatios({pair: ratio(0.25)}))
    assert (coarser.gain, coarser.share) == (pytest.approx(0.6), pytest.approx(0.8))


def test_a_finding_of_lint_gives_its_message_and_its_code():
    time = loop_of(step(), call("MjData"))
    (remedy,) = listing.remedies(time, [finding("MJB005")])
    assert (remedy.code, remedy.text) == ("MJB005", "do otherwise")
    pair = RemedyPair(call_ways.new_data, ("MjData", "mj_resetData"), steps=10)
    assert pair in listing.pairs([time], [finding("MJB005")])


def test_functions_after_a_step_save_what_their_pair_with_a_step_does():
    """1,000 steps of 5 ms, each with a call of 4 ms; the pair takes 2/3 with what is enough."""
    found = finding("MJB007", instead=("mj_kinematics",))
    time = loop_of(step(seconds=5.0), call("mj_forward", calls=1000, seconds=4.0))
    measured = MeasuredRatios({RemedyPair(call_ways.functions, ("mj_kinematics",)): ratio(2 / 3)})
    (remedy,) = listing.remedies(time, [found], measured)
    assert remedy.gain == pytest.approx(0.99 / 3)  # with what Python does to make the calls
    assert listing.remedies(time) == [], "only lint knows what is read afterwards"


def test_functions_in_a_loop_that_does_not_step_are_compared_alone():
    found = finding("MJB007", instead=("mj_kinematics",))
    time = loop_of(call("mj_forward", calls=1000, seconds=6.0))
    (pair,) = listing.pairs([time], [found])
    assert (pair.ways, pair.steps) == (call_ways.functions, 0)
    (remedy,) = listing.remedies(time, [found], MeasuredRatios({pair: ratio(0.2)}))
    assert remedy.gain == pytest.approx(0.99 * 0.8)


def test_a_function_that_jax_compiles_again_is_named_where_lint_finds_it():
    time = loop_of(call(call_clock.COMPILE, number=16, calls=10, seconds=9.0))
    (remedy,) = listing.remedies(time, [finding("MJB013", number=15)])
    assert remedy.place.line == 15
    assert remedy.gain == pytest.approx(0.81)


CONTROL = ArgumentChange(
    "d.ctrl", argument_types.WEAK_TYPE, "float32[2]", "weakly typed float32[2]"
)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ([CONTROL], "since d.ctrl is weakly typed float32[2], and was float32[2]: create it with"),
        ([replace(CONTROL, kind=argument_types.SHAPE)], "one shape in all calls"),
        ([], "JAX_EXPLAIN_CACHE_MISSES=1 says why"),
    ],
)
def test_a_second_compilation_comes_first_with_the_argument_that_differs(changes, says):
    compiling = call(call_clock.COMPILE, calls=1, seconds=6.0)
    time = loop_of(compiling, call(call_clock.DISPATCH, calls=800, seconds=1.0))
    again = Incident(call_clock.RECOMPILED, compiling.place, 1, 6.5, changes)
    elsewhere = replace(again, place=Place("train.py", 5, "main", "text"))
    listed = listing.remedies(time, incidents=[elsewhere, again])
    first, _ = listed
    assert (first.where, first.gain, first.basis) == ("train.py:15", 0.65, Basis.TIMED)
    assert "JAX compiles this function again, for 6.5 s" in first.text and says in first.text


def test_what_compiles_again_in_every_iteration_is_listed_once_with_its_cause():
    compiling = call(call_clock.COMPILE, calls=20, seconds=6.0)
    again = Incident(call_clock.RECOMPILED, compiling.place, 20, 6.0, [CONTROL])
    (only,) = listing.remedies(loop_of(compiling), incidents=[again])
    assert "again 20 times" in only.text and "d.ctrl" in only.text
    again_basis = only.basis
    cut = replace(again, is_unfinished=True)
    (only,) = listing.remedies(loop_of(compiling), incidents=[cut])
    assert "6 s so far: the run ended before it had compiled it, since d.ctrl" in only.text
    assert (again_basis, only.basis) == (Basis.TIMED, Basis.BOUND)


def test_two_findings_of_one_rule_on_a_line_are_one_remedy():
    time = loop(line(15, {NUMPY: 0.6}), line(12, {PHYSICS: 0.4}))
    twice = [finding("MJB099"), replace(finding("MJB099"), col=30)]
    assert len(listing.remedies(time, twice)) == 1


def test_one_remedy_on_lines_that_follow_each_other_is_one() -> None:
    lines = [line(i, {BINDINGS: share}) for i, share in ((12, 0.2), (13, 0.1), (15, 0.1))]
    found = [finding("MJB002", number=each.place.line) for each in lines]
    first, then = listing.remedies(loop(*lines), found)
    assert (first.where, then.where) == ("train.py:12–13", "train.py:15")
    assert (first.gain, first.share) == (pytest.approx(0.3), pytest.approx(0.3))


def test_named_access_saves_what_was_measured_not_the_share_of_its_line():
    lines = [line(12, {PHYSICS: 0.5}), line(15, {NUMPY: 0.4, PYTHON: 0.1})]
    time = replace(loop(*lines), calls=[step(calls=1000)])
    found = replace(finding("MJB002"), ns_per_step=900.0)
    measured = MeasuredRatios({NAMED_ACCESS: ratio(0.3, saved_s=0.001)})
    by_code = {remedy.code: remedy for remedy in listing.remedies(time, [found], measured)}
    assert by_code["MJB002"].gain == pytest.approx(0.1)
    assert list(by_code) == ["MJB002"], "nothing is known for the rest of the line"


def test_what_runs_many_times_a_step_saves_a_share_of_its_line(tmp_path):
    file = tmp_path / "train.py"
    file.write_text("for _ in range(9):\n    step()\n    x = [data.body(n) for n in names]\n")
    place = Place(str(file), 3, "main", "x = [data.body(n) for n in names]")
    named = LineTime(place, 0.4, {BINDINGS: 0.4})
    stepping = replace(step(calls=1000), lines=[("env.py", 9), (str(file), 2)])
    time = replace(loop(line(12, {PHYSICS: 0.6}), named), calls=[stepping])
    found = Finding(str(file), 3, 1, "MJB002", "hoist it", 900.0)
    _, asked = listing.pairs([time], [found])
    assert asked == NAMED_ACCESS
    measured = MeasuredRatios({NAMED_ACCESS: ratio(0.25, saved_s=1e-6)})
    first = listing.remedies(time, [found], measured)[0]
    assert (first.code, first.basis, first.gain) == ("MJB002", Basis.PAIRED, pytest.approx(0.3))


@pytest.mark.parametrize(
    ("text", "gain"), [("x = np.linalg.solve(A, np.zeros(3))", None), ("x = np.zeros(3)", 0.4)]
)
def test_a_new_array_is_not_the_cost_of_what_a_line_computes(text, gain):
    """Neither as a bound, nor where a loop within the step runs it."""
    place = Place("train.py", 15, "main", text)
    time = loop(line(12, {PHYSICS: 0.6}), LineTime(place, 0.4, {NUMPY: 0.4}))
    found = replace(finding("MJB003"), ns_per_step=300.0)
    listed = {each.code: each.gain for each in listing.remedies(time, [found])}
    assert listed == ({"MJB003": gain} if gain else {})
    measured = MeasuredRatios({RemedyPair(line_remedies.new_array): ratio(0.5, saved_s=1e-3)})
    listed = {each.code: each.gain for each in listing.remedies(time, [found], measured)}
    assert listed == ({"MJB003": gain / 2} if gain else {})
    once_a_step = replace(time, calls=[step(calls=1000)])
    listed = {each.code: each.gain for each in listing.remedies(once_a_step, [found], measured)}
    assert listed["MJB003"] == pytest.approx(0.1)


def test_what_runs_once_a_step_saves_its_difference_where_a_method_steps(tmp_path):
    file = tmp_path / "train.py"
    file.write_text("for _ in range(9):\n    env.step()\n    x = data.body('torso').xpos\n")
    named = LineTime(Place(str(file), 3, "main", "text"), 0.4, {BINDINGS: 0.4})
    stepping = replace(step(calls=1000), lines=[("env.py", 9), (str(file), 2)])
    time = replace(loop(line(12, {PHYSICS: 0.6}), named), calls=[stepping])
    found = Finding(str(file), 3, 1, "MJB002", "hoist it", 900.0)
    measured = MeasuredRatios({NAMED_ACCESS: ratio(0.25, saved_s=1e-3)})
    listed = listing.remedies(time, [found], measured)
    (named_access,) = [each for each in listed if each.code == "MJB002"]
    assert named_access.gain == pytest.approx(0.1)


def test_a_line_has_the_remedy_that_lint_names_with_the_gain_that_was_measured():
    text = "for contact in data.contact:"
    called = LineTime(Place("train.py", 15, "main", text), 0.4, {PYTHON: 0.4})
    time = loop(line(12, {PHYSICS: 0.6}), called)
    asked = listing.pairs([time], [finding("MJB019")])
    assert asked == [RemedyPair(line_remedies.contacts)]
    measured = MeasuredRatios({each: ratio(0.25) for each in asked})
    (first,) = listing.remedies(time, [finding("MJB019")], measured)
    assert "do otherwise" in first.text
    assert (first.basis, first.gain) == (Basis.PAIRED, pytest.approx(0.3))


@pytest.mark.parametrize(
    "text", ["x = np.linalg.pinv(jacobian) @ error", "log.append(data.qpos.tolist())"]
)
def test_a_line_without_a_finding_has_no_remedy(text):
    called = LineTime(Place("train.py", 15, "main", text), 0.4, {PYTHON: 0.4})
    assert listing.remedies(loop(line(12, {PHYSICS: 0.6}), called)) == []


def test_rays_at_once_save_the_loop_that_casts_them_one_by_one(tmp_path):
    """Of 0.5 for the calls and their line, half stays; the line that only feeds them goes."""
    file = str(tmp_path / "train.py")
    Path(file).write_text(
        "for _ in range(9):\n    step()\n    for ray in rays:\n"
        "        end = rotated(ray)\n        hits.append(mj_ray(m, d, end))\n"
    )
    lines = [
        LineTime(Place(file, 2, "main"), 0.2, {PHYSICS: 0.2}),
        LineTime(Place(file, 4, "main"), 0.3, {NUMPY: 0.3}),
        LineTime(Place(file, 5, "main"), 0.5, {PHYSICS: 0.4, PYTHON: 0.1}),
    ]
    rays = replace(call("mj_ray", calls=36_000, seconds=4.0), place=lines[2].place)
    stepping = replace(step(seconds=2.0), place=lines[0].place, lines=[(file, 2)])
    time = replace(loop(*lines), calls=[stepping, rays])
    pair = RemedyPair(call_ways.rays, simulations=36)
    assert pair in listing.pairs([time], [])
    first, *_ = listing.remedies(time, [], MeasuredRatios({pair: ratio(0.5)}))
    assert first.text.startswith("mj_multiRay")
    assert first.gain == pytest.approx(0.5 / 2 + 0.3)
    # of 0.4 for the calls, half stays; too few samples tell whose 0.4 that is not timed are
    short = replace(time, samples=20, lines=[])
    first, *_ = listing.remedies(short, [], MeasuredRatios({pair: ratio(0.5)}))
    assert (first.gain, first.gain_error) == (pytest.approx(0.4 / 2 + 0.4 / 2), pytest.approx(0.1))


def test_processes_that_a_loop_starts_at_once_are_set_up():
    starts = call(call_clock.PROCESS_START, seconds=1.0)
    time = loop_of(step(), replace(starts, first_ns=10**9, last_ns=2 * 10**9))
    assert listing.remedies(time) == []
    assert listing.remedies(loop_of(step(), starts))
    on_busy_cores = replace(starts, seconds=2.0, first_ns=10**9, last_ns=4 * 10**9)
    assert listing.remedies(loop_of(step(), on_busy_cores)) == []


def test_the_timer_is_turned_off_before_callbacks_are_set():
    time = loop_of(step(), call(f"{call_clock.CALLBACK} mjcb_control"))
    measured = MeasuredRatios({RemedyPair(loop_remedies.no_timer): ratio(0.5)})
    timer = next(r for r in listing.remedies(time, [], measured) if r.kind == RemedyKind.CLOCK)
    assert "callbacks of your own" in timer.text


@pytest.mark.parametrize("text", ["mj_inverse(m, other)", "mj_inverse(m, d)"])
def test_inverse_dynamics_is_computed_in_the_step_of_the_same_data(text):
    same = text == "mj_inverse(m, d)"
    time = loop_of(step(), call("mj_inverse", calls=1000, text=text))
    pair = RemedyPair(call_ways.inverse)
    assert (pair in listing.pairs([time], [])) == same
    listed = listing.remedies(time, [], MeasuredRatios({pair: ratio(0.7)}))
    assert bool(listed) == same
    assert listing.remedies(time) == [], "with Runge-Kutta, nothing is measured"


def test_the_timer_of_the_python_package_is_measured_on_the_model():
    other = LineTime(Place("train.py", 19, "main", "text"), 0.5, {NUMPY: 0.5})
    time = replace(loop_of(step()), lines=[other], activities={PHYSICS: 0.5, NUMPY: 0.5})
    measured = MeasuredRatios({RemedyPair(loop_remedies.no_timer): ratio(0.8)})
    remedy = next(r for r in listing.remedies(time, [], measured) if r.kind == RemedyKind.CLOCK)
    assert remedy.gain == pytest.approx(0.1)
    calls_of_five = loop_of(call("mj_step", 12, 100, 5.0, steps=500, all_steps=500))
    assert listing.pairs([calls_of_five], []) == [RemedyPair(loop_remedies.no_timer, steps=5)]
    slight = MeasuredRatios({RemedyPair(loop_remedies.no_timer): ratio(0.95)})
    assert all(r.kind != RemedyKind.CLOCK for r in listing.remedies(time, [], slight))


def test_steps_with_nothing_between_them_are_one_call(tmp_path):
    file = tmp_path / "train.py"
    bare = replace(step(), place=Place(str(file), 3, "main"))
    time = replace(loop_of(bare), loop=SourceLoop(str(file), 1, 5))
    pair = RemedyPair(call_ways.one_call)
    held = "for _ in range(9):\n    for _ in range(5):\n        mj_step(m, d)\n        {}\n    {}\n"
    file.write_text(held.format("# and no more", "d.ctrl[:] = policy(d)"))
    findings = listing.findings_of([str(file)])
    assert pair in listing.pairs([time], findings)
    (remedy,) = listing.remedies(time, findings, MeasuredRatios({pair: ratio(0.8)}))
    assert (remedy.code, remedy.place.line, remedy.effect) == ("MJB017", 3, "nothing")
    assert remedy.gain == pytest.approx(0.1)
    assert listing.remedies(time, findings, MeasuredRatios({})) == [], "not measured"
    file.write_text(held.format("d.ctrl[:] = policy(d)", "pass"))
    findings = listing.findings_of([str(file)])
    assert pair not in listing.pairs([time], findings)
    assert listing.remedies(time, findings, MeasuredRatios({pair: ratio(0.8)})) == []


def test_simulations_in_turn_are_advised_where_a_batch_is_faster():
    time = loop_of(step())
    incident = Incident(call_clock.IN_TURN, step().place, 8)
    pair = RemedyPair(loop_remedies.batch, simulations=8, on_threads=True)
    assert pair in listing.pairs([time], [], [incident])
    (remedy,) = listing.remedies(time, [], MeasuredRatios({pair: ratio(0.4)}), [incident])
    assert remedy.gain == pytest.approx(0.3)
    assert listing.remedies(time, [], MeasuredRatios({pair: ratio(1.2)}), [incident]) == []


@pytest.mark.parametrize("comment", ["", "  # never closed"])
def test_a_line_that_is_one_call_has_the_remedy_of_the_call_alone(comment):
    created = call("Renderer", text=f"renderer = mujoco.Renderer(model, 240, 320){comment}")
    seen = LineTime(created.place, 0.3, {BINDINGS: 0.3}, "mujoco")
    time = loop(seen, activities={PHYSICS: 0.7, BINDINGS: 0.3})
    (remedy,) = listing.remedies(replace(time, calls=[step(), created]))
    assert remedy.kind == RemedyKind.CALL


def test_files_that_lint_cannot_check_have_no_findings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "train.py").write_text(
        "import mujoco\nmodel = mujoco.MjModel.from_xml_path('x')\ndata = mujoco.MjData(model)\n"
        "log = []\nfor _ in range(9):\n    mujoco.mj_step(model, data)\n"
        "    x = data.body('torso').xpos[2]\n    log.append(data.qpos)\n"
    )
    codes = {each.code for each in listing.findings_of(["train.py", "missing.py"])}
    assert codes == {"MJB001", "MJB002"}


def remedy(kind, gain=0.2, **more):
    return Remedy(kind, PYTHON, Place("train.py", 7, "main"), "text", gain, 0.01, **more)


def test_wrong_results_come_first_and_then_the_largest_gain():
    wrong = Remedy(RemedyKind.RESULT, None, None, "", None, None)
    large, small = remedy(RemedyKind.LINE, 0.3), remedy(RemedyKind.LINE, 0.1)
    assert sorted([small, large, wrong], key=lambda each: each.rank) == [wrong, large, small]


@pytest.mark.parametrize("waits_for", [Activity.PROCESSES, Activity.THREADS])
def test_a_wait_for_others_saves_no_steps_of_theirs(waits_for):
    waiting = line(13, {waits_for: 0.9})
    time = loop(line(12, {PHYSICS: 0.1}), waiting)
    (wait,) = listing.remedies(time, others_busy_s=4.0)
    assert wait.gain == pytest.approx(0.6)
    assert listing.remedies(time, others_busy_s=9.9) == [], "somebody works all the time"


@pytest.mark.parametrize(("package", "says"), [("gymnasium", "SyncVectorEnv"), ("", "message")])
def test_environments_in_processes_can_be_stepped_in_one(package, says):
    waiting = line(13, {Activity.PROCESSES: 0.9}, package=package)
    (wait,) = listing.remedies(loop(line(12, {PHYSICS: 0.1}), waiting))
    assert says in wait.text


def test_what_processes_unpickle_is_sent_once_where_that_is_what_a_loop_waits_for():
    time = loop(line(12, {PHYSICS: 0.1}), line(13, {Activity.PROCESSES: 0.9}))
    (wait,) = listing.remedies(replace(time, unpickling_share=0.7), others_busy_s=1.0)
    assert "unpickle for 70 % of the loop" in wait.text
    (wait,) = listing.remedies(replace(time, unpickling_share=0.2), others_busy_s=1.0)
    assert "no process works meanwhile" in wait.text


def test_processes_that_are_started_again_and_again_cost_their_whole_line():
    """The end of a pool is on the line that starts it, and the loop waits while they begin."""
    pool = line(15, {Activity.STARTING: 0.1, PYTHON: 0.2})
    time = loop(pool, line(16, {Activity.PROCESSES: 0.7}))
    time = replace(time, calls=[call(call_clock.PROCESS_START, seconds=1.0)])
    (remedy,) = listing.remedies(time)
    assert (remedy.place.line, remedy.gain) == (15, pytest.approx(0.3))


@pytest.mark.parametrize(
    ("line", "pair"),
    [
        ("log.append(np.zeros(3))", RemedyPair(line_remedies.concatenation)),
        ("for pair in data.contact.geom:", RemedyPair(line_remedies.contacts)),
        ("least = min(x for x in data.contact.dist)", RemedyPair(line_remedies.contacts)),
    ],
)
def test_lines_that_look_alike_are_not_tried(line: str, pair: RemedyPair) -> None:
    (remedy,) = [each for each in LINE_REMEDIES if each.pair == pair]
    assert not remedy.line.search(line)


def test_too_many_threads_save_what_a_second_run_with_fewer_did():
    time = replace(loop(line(13, {NUMPY: 0.9}), line(12, {PHYSICS: 0.1})), pids=[2, 3])
    pools = ThreadPools([2, 3], 2, 2, {NUMPY: "OPENBLAS_NUM_THREADS"}, 2.5, 0.1)
    (remedy,) = listing.remedies(time, pools=pools)
    assert remedy.gain_error == pytest.approx(0.04)
    assert (remedy.place.line, remedy.basis, remedy.gain) == (13, Basis.RERUN, pytest.approx(0.6))
    assert remedy.text == (
        "2 processes × 2 threads of BLAS on 2 cores: set OPENBLAS_NUM_THREADS=1 before Python"
        " starts"
    )
    assert listing.remedies(replace(time, pids=[1]), pools=pools) == []
    assert listing.remedies(time, pools=replace(pools, speedup=1.01)) == []


def test_a_transfer_on_a_line_of_lint_has_the_sentence_of_lint_once():
    calls = [call(call_clock.TRANSFER, seconds=2.0), call(call_clock.DISPATCH, 12, seconds=1.0)]
    given = [finding("MJB022", message="put it there once")]
    texts = [each.text for each in listing.remedies(loop_of(*calls), given)]
    assert "put it there once" in texts
    assert not any("transfers to the device" in text for text in texts)


def test_a_model_that_stays_on_the_device_is_not_compared_either():
    calls = [call(call_clock.TRANSFER, seconds=2.0), call(call_clock.DISPATCH, 12, seconds=1.0)]
    time = loop_of(*calls)
    compares = replace(time, activities={**time.activities, Activity.COMPARING: 0.25})
    given = [finding("MJB022", message="put it there once")]
    gains = [
        next(each.gain for each in listing.remedies(each_time, given) if each.code == "MJB022")
        for each_time in (time, compares)
    ]
    assert gains[1] - gains[0] == pytest.approx(0.25)


def test_garbage_collections_save_the_time_that_they_were_timed_to_take():
    time = loop(line(12, {PHYSICS: 0.7}), activities={PHYSICS: 0.7, Activity.COLLECTION: 0.3})
    (first,) = listing.remedies(time)
    assert (first.basis, first.gain) == (Basis.TIMED, 0.3)
