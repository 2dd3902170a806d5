"""The first line about a program says what matters most."""

from dataclasses import replace
from typing import Any

import pytest

from mjbench.commands.profile.model_costs import Cost, CostKind
from mjbench.commands.run import show as program
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.gil_waits import GilWait
from mjbench.commands.run.launch import UncaughtException
from mjbench.commands.run.loop_time import LineStay, LineTime, LoopTime
from mjbench.commands.run.physics_cost import PhysicsCost
from mjbench.commands.run.remedies.remedy import Basis, Remedy, RemedyKind
from mjbench.commands.run.result import LoopReport, ProgramRow
from mjbench.commands.run.single_calls import SingleCall
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.commands.run.step_times import Durations, StepTimes
from mjbench.results import terminal
from mjbench.results.content import Tone
from mjbench.status import Status

PLACE = Place("train.py", 7, "main", "mj_step(model, data)")


def loop(activities: dict[Activity, float], samples: int = 100, **more: Any) -> LoopTime:
    return LoopTime(
        loop=SourceLoop("train.py", 5, 9),
        own_files=["train.py"],
        threads=["MainThread"],
        pids=[1],
        in_main=True,
        samples=samples,
        seconds=2.0,
        activities=activities,
        lines=[],
        inner_functions=[],
        **more,
    )


def row(time: LoopTime, *remedies: Remedy, **more: Any) -> ProgramRow:
    return ProgramRow(
        program="train.py",
        status=Status.OK,
        detail="",
        exit_code=0,
        was_ended=False,
        wall_s=3.0,
        rate_hz=100,
        samples=300,
        loops=[LoopReport(time, remedies)],
        steps=[],
        **more,
    )


def remedy(basis: Basis = Basis.PAIRED) -> Remedy:
    return Remedy(
        RemedyKind.CALL,
        Activity.PHYSICS,
        PLACE,
        "do otherwise",
        gain=0.4,
        gain_error=None,
        basis=basis,
        share=0.5,
    )


MIXED = loop({Activity.PHYSICS: 0.6, Activity.PYTHON: 0.4})


def test_a_measured_gain_is_said_as_the_time_that_remains() -> None:
    said = program.conclusion(row(MIXED, remedy()))
    assert said == (
        "first, at train.py:7, do otherwise: 50 % of the loop now; with the change, the loop takes"
        " about 0.60 of today's time"
    )


def test_a_share_that_is_smaller_than_the_gain_is_not_said() -> None:
    frees_memory_elsewhere = replace(remedy(), share=0.3)
    said = program.conclusion(row(MIXED, frees_memory_elsewhere))
    assert said.startswith("first, at train.py:7, do otherwise: with the change, the loop takes")


def test_a_bound_is_said_as_a_share_of_the_loop() -> None:
    said = program.conclusion(row(MIXED, remedy(Basis.BOUND)))
    assert said == (
        "first, physics at train.py:7: 50 % of the loop in train.py:5–9; do otherwise; that saves"
        " at most 40 %"
    )
    all_of_it = replace(remedy(Basis.BOUND), share=None)
    assert program.conclusion(row(MIXED, all_of_it)).endswith("; that saves at most 40 %")


def test_a_loop_that_only_waits_comes_first_only_if_its_waiting_can_be_shorter() -> None:
    waiting = loop({Activity.THREADS: 1.0})
    both = [LoopReport(waiting, []), LoopReport(MIXED, [remedy()])]
    assert "do otherwise" in program.conclusion(replace(row(waiting), loops=both))
    longer = replace(remedy(), text="take more steps for each wait")
    both[0] = LoopReport(waiting, [longer])
    assert "more steps for each wait" in program.conclusion(replace(row(waiting), loops=both))


def test_a_failure_comes_before_a_wrong_result_and_that_before_time() -> None:
    wrong = Remedy(RemedyKind.RESULT, None, PLACE, "a view is stored", None, None)
    both = row(MIXED, remedy(), wrong=[wrong])
    assert program.conclusion(both) == (
        "first, correct a wrong result at train.py:7: a view is stored"
    )
    (first, second) = next(program.sections([replace(both, exit_code=3)])).conclusions
    assert first.text == "train.py: it ended with exit code 3"
    assert second.text.startswith("train.py: first, correct a wrong result")


@pytest.mark.parametrize(
    ("ended", "says"),
    [
        ({}, ""),
        ({"exit_code": 3}, "it ended with exit code 3"),
        ({"exit_code": 3, "was_ended": True}, ""),
        ({"exit_code": 137}, "it was ended by SIGKILL"),
        ({"exit_code": 255}, "it ended with exit code 255"),
        ({"exit_code": 139, "crash": PLACE}, "it crashed (SIGSEGV) at train.py:7: mj_step"),
        (
            {"exit_code": 1, "exception": UncaughtException("ValueError: no", PLACE)},
            "it raised ValueError: no at train.py:7: mj_step(model, data)",
        ),
        ({"exit_code": 1, "exception": UncaughtException("E", None)}, "it raised E"),
    ],
)
def test_how_a_program_failed_is_one_sentence(ended: dict[str, Any], says: str) -> None:
    said = program.ending(replace(row(MIXED), **ended))
    assert said.startswith(says)
    assert bool(said) == bool(says)


def test_a_program_that_mjbench_ended_is_said_to_be() -> None:
    ended = replace(row(MIXED), was_ended=True)
    (section, *_) = program.sections([ended])
    assert section.facts == ["mjbench ended train.py after 3 s: --seconds none runs it to its end."]
    assert program.end_lines(ended, ", without --quick,") == [
        "mjbench ended train.py after 3 s: --seconds none, without --quick, runs it to its end."
    ]
    (section, *_) = program.sections([row(MIXED)])
    assert section.facts == []


def test_a_program_that_does_not_step_is_to_run_for_longer() -> None:
    ended = replace(row(MIXED), loops=[], was_ended=True)
    assert program.conclusion(ended) == (
        "no loop was seen that steps MuJoCo in 3 s; run it for longer"
    )


def test_a_program_that_is_one_long_rollout_has_the_report_on_that_call() -> None:
    place = Place("roll.py", 6, "<module>", "rollout.rollout(model, data, states)")
    call = SingleCall("rollout", place, 2.0, 64, 1000, 1, 1, True, 8)
    once = replace(row(loop({Activity.PHYSICS: 1.0})), loops=[], single_calls=[call])
    assert program.conclusion(once) == call.sentence(once.wall_s)
    cost = PhysicsCost(1.0, {"tendons": 0.6, "other": 0.4}, [])
    assert program.conclusion(replace(once, physics=cost)).endswith(". Of a step, 60 % is tendons")


def test_what_observing_cost_is_not_said_of_a_program_that_ends_at_once() -> None:
    time = loop({Activity.PHYSICS: 1.0})
    notes = [
        note
        for wall_s in (0.4, 4.0)
        for section in program.sections([replace(row(time), wall_s=wall_s)])
        for note in section.notes
    ]
    assert len([note for note in notes if note.startswith("Observing took")]) == 1


def test_compiling_warp_kernels_is_named_as_that() -> None:
    (line,) = lines(0.5, activity=Activity.KERNELS)
    short = replace(row(loop({Activity.PHYSICS: 1.0})), loops=[], outside_loops=[line])
    assert program.conclusion(short).endswith(
        "no loop was seen that steps MuJoCo; compiling Warp kernels: 1.5 s, once per machine:"
        " they are kept in Warp's cache"
    )


def test_what_takes_longer_than_the_loops_comes_first() -> None:
    place = Place("train.py", 3, "<module>", "model = build()")
    imports = LineTime(replace(place, line=1), 0.2, {Activity.IMPORT: 0.2})
    build = LineTime(place, 0.7, {Activity.LOADING: 0.7})
    said = program.conclusion(
        row(replace(MIXED, seconds=0.2), remedy(), outside_loops=[build, imports])
    )
    assert said.startswith(
        "first, look outside the loops that step, which take 0.2 s of the program's 3 s: train.py:3"
        " takes 2.1 s (model = build()). Then, at train.py:7, do otherwise"
    )
    long_loop = row(replace(MIXED, seconds=2.5), remedy(), outside_loops=[imports])
    assert "outside" not in program.conclusion(long_loop)


@pytest.mark.parametrize(("share", "has_imports"), [(0.6, True), (0.01, False)])
def test_imports_are_named_where_the_loops_take_next_to_nothing(
    share: float, has_imports: bool
) -> None:
    imports = LineTime(PLACE, share, {Activity.IMPORT: share})
    said = program.conclusion(row(replace(MIXED, seconds=0.06), outside_loops=[imports]))
    assert ("imports take" in said) == has_imports


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (loop({Activity.PHYSICS: 0.97, Activity.PYTHON: 0.03}), "`mjbench tune`"),
        (loop({Activity.PHYSICS: 0.5, Activity.REST: 0.5}, samples=10), "run for 6 s or longer"),
        (loop({Activity.COMPILING: 0.9, Activity.REST: 0.1}), "JAX compiles for 1.8 s of the 2 s"),
    ],
)
def test_where_nothing_is_worth_a_change_the_reason_and_the_next_step_are_said(
    time: LoopTime, text: str
) -> None:
    assert text in program.conclusion(row(time))


def lines(*shares: float, activity: Activity = Activity.NUMPY) -> list[LineTime]:
    places = (replace(PLACE, line=5 + i) for i in range(len(shares)))
    return [
        LineTime(place, share, {activity: share})
        for place, share in zip(places, shares, strict=True)
    ]


def test_the_costliest_place_without_a_remedy_is_named_first_and_as_that() -> None:
    costly = loop({Activity.PHYSICS: 0.2, Activity.NUMPY: 0.8})
    costly = replace(costly, lines=lines(0.3, 0.2, 0.0, 0.2, 0.1, 0.02))
    numpy = "your own Python and NumPy at train.py:5, 6, 8, …: 82 % of the loop in train.py:5–9"
    assert program.conclusion(row(costly)) == (
        f"{numpy}; no change is known for this. Physics takes 20 %"
    )
    said = program.conclusion(row(costly, replace(remedy(), gain=0.1)))
    assert said.startswith(f"{numpy}; no change is known for this. Then, at train.py:7, do")


def test_physics_comes_before_what_costs_less_than_it_with_its_costliest_line() -> None:
    of_steps = [
        replace(each, place=replace(PLACE, line=8))
        for each in lines(0.5, activity=Activity.PHYSICS)
    ]
    mixed = loop({Activity.PHYSICS: 0.7, Activity.NUMPY: 0.3})
    mixed = replace(mixed, lines=[*of_steps, *lines(0.2, activity=Activity.PHYSICS), *lines(0.3)])
    said = program.conclusion(row(mixed, replace(remedy(), gain=0.1, share=0.1)))
    assert said.startswith("physics takes 70 % of the loop in train.py:5–9, 50 % at train.py:8.")
    assert "; your own Python and NumPy at train.py:5: 30 %, no change is known for this" in said
    of_line = replace(remedy(), gain=0.1, share=0.4)
    assert program.conclusion(row(mixed, of_line)).startswith("first, at train.py:7, do otherwise")
    assert "Then, at train.py:7, do otherwise" in said


def test_a_place_with_a_remedy_is_named_for_that_and_what_has_none_with_its_share() -> None:
    mixed = replace(MIXED, lines=[*lines(0.1), replace(lines(0.3)[0], place=PLACE)])
    section = list(program.sections([row(mixed, remedy())]))
    assert section[0].conclusions[0].text.startswith("train.py: first, at train.py:7, do otherwise")
    assert section[1].facts[1] == (
        "Not in the list below: your own Python and NumPy at train.py:5: 10 % of the loop"
    )


def test_what_a_remedy_beyond_its_own_line_is_about_is_no_other_place() -> None:
    of_loop = replace(MIXED, lines=lines(0.6))
    facts = list(program.sections([row(of_loop, replace(remedy(), gain=0.8, share=0.9))]))[1].facts
    assert not any("Not in the list" in str(fact) for fact in facts)


def test_a_package_and_other_activities_are_named_as_what_they_are() -> None:
    (line,) = lines(0.9, activity=Activity.PYTHON)
    of_package = loop({Activity.PYTHON: 0.9})
    of_package = replace(of_package, lines=[replace(line, package="gymnasium")])
    assert program.conclusion(row(of_package)).startswith("gymnasium at train.py:5: 90 %")
    policy = replace(loop({}), lines=lines(0.9, activity=Activity.POLICY))
    assert program.conclusion(row(policy)).startswith("policy at train.py:5: 90 %")


def test_of_a_process_that_waits_for_busy_workers_only_that_is_said() -> None:
    of_workers = {Activity.NUMPY: 0.98, Activity.PROCESSES: 0.02}
    workers = replace(loop(of_workers), pids=[2, 3], in_main=False, lines=lines(0.98))
    waiting = replace(loop({Activity.PROCESSES: 1.0}), loop=SourceLoop("train.py", 30, 30))
    both = replace(row(waiting), loops=[LoopReport(waiting, []), LoopReport(workers, [])])
    first, then = next(program.sections([both])).conclusions
    assert first.text.startswith("train.py: your own Python and NumPy at train.py:5: 98 %")
    assert then.text == (
        "train.py:30 waits for 2 workers, busy for 98 % of their time: nothing to save there"
    )


def test_where_jax_compiles_the_line_and_what_explains_it_are_said() -> None:
    compiling = loop({Activity.COMPILING: 0.9, Activity.REST: 0.1})
    compiling = replace(compiling, lines=lines(0.9, activity=Activity.COMPILING))
    said = program.conclusion(row(compiling))
    assert "in train.py:5–9, most at train.py:5: once for each function" in said
    assert "JAX_EXPLAIN_CACHE_MISSES=1 says which argument differs" in said


NEARLY_PHYSICS = loop({Activity.PHYSICS: 0.9, Activity.PYTHON: 0.1})
PHYSICS = PhysicsCost(
    20_000.0,
    {"broad-phase collision": 0.1, "narrow-phase collision": 0.4, "constraint solver": 0.3},
    [Cost(CostKind.TYPES, "box and mesh", 12, 0.3), Cost(CostKind.SENSORS, "rangefinder", 8, 0.2)],
)


def test_a_loop_that_is_nearly_all_physics_is_told_what_costs_in_it() -> None:
    small = replace(remedy(), gain=0.1)
    assert program.conclusion(row(NEARLY_PHYSICS, small, physics=PHYSICS)) == (
        "physics takes 90 % of the loop in train.py:5–9; of a step, 50 % is collision, most of it"
        " box and mesh (12): 30 %. `mjbench tune` tries settings of the model, `mjbench compare`"
        " other ways of stepping it. Then, at train.py:7, do otherwise: 50 % of the loop now; with"
        " the change, the loop takes about 0.90 of today's time"
    )


def test_a_world_of_static_geoms_is_what_costs_in_kinematics() -> None:
    costs = [Cost(CostKind.STATIC, "geoms that no joint moves", 4901, 0.6)]
    city = PhysicsCost(20_000.0, {"kinematics": 0.62, "narrow-phase collision": 0.38}, costs)
    assert "62 % is kinematics, most of it geoms that no joint moves (4,901): 60 %" in (
        program.conclusion(row(loop({Activity.PHYSICS: 1.0}), physics=city))
    )


@pytest.mark.parametrize(("error", "ends"), [(0.02, ""), (0.05, " (0.50 to 0.70)")])
def test_a_wide_interval_of_a_pair_is_shown(error: float, ends: str) -> None:
    uncertain = replace(remedy(), gain_error=error)
    assert program.conclusion(row(MIXED, uncertain)).endswith(f"0.60 of today's time{ends}")
    assert program.saving(uncertain) == ("40 % (30–50 %)" if ends else "40 %")


def test_a_large_saving_comes_before_what_costs_in_physics() -> None:
    assert program.conclusion(row(NEARLY_PHYSICS, remedy(), physics=PHYSICS)).startswith("first, ")


def test_the_costly_parts_of_the_model_are_listed() -> None:
    text = terminal.text_of(program.sections([row(NEARLY_PHYSICS, physics=PHYSICS)]))
    (line,) = (line for line in text.splitlines() if line.startswith("rangefinder"))
    assert line.split() == ["rangefinder", "sensors", "8", "20", "%"]


def test_the_thread_that_waits_longest_for_the_gil_is_named_with_the_one_that_holds_it() -> None:
    waits = [GilWait(f"worker {i}", 1, 0.37 - 0.1 * i, "planner", 0.8, PLACE) for i in range(3)]
    text = terminal.text_of(program.sections([row(MIXED, gil_waits=waits)]))
    assert (
        "Threads: at least 37 % of the time of worker 0 waits for the GIL; 2 more wait, too;"
        " planner holds it for 80 % of the time, most often at train.py:7." in text
    )


def test_a_program_whose_steps_are_not_counted_has_no_heading_of_steps() -> None:
    text = terminal.text_of(program.sections([row(loop({Activity.COMPILING: 1.0}))]))
    assert "train.py: observation\nObserving took" in text
    assert "train.py: steps" not in text


def test_growth_of_memory_is_said_with_what_creates_objects() -> None:
    call = CallTime("MjData", 1, 1, PLACE, None, 300.0, 0.1, 0, 1, 0, 0)
    grown = row(replace(MIXED, calls=[call]), memory_growth_bytes=223 << 20)
    text = terminal.text_of(program.sections([grown]))
    assert "Memory grew by 223 MiB while it stepped; train.py:7 makes 300 × MjData." in (text)
    text = terminal.text_of(program.sections([replace(grown, steps=[steps()])]))
    assert "Memory grew by 223 MiB while it stepped (22 MiB per second); train.py:7" in text


def test_a_wrong_result_stands_at_the_head_of_a_report_once() -> None:
    shared = replace(remedy(), kind=RemedyKind.RESULT, gain=None, text="one MjData each")
    other = replace(shared, text="copy the row")
    time = row(MIXED)
    section, *_ = program.sections([replace(time, wrong=[shared, shared, other])])
    first, then = section.conclusions
    assert first.tone == then.tone == Tone.BAD
    assert "one MjData each" in first.text
    assert then.text.startswith("train.py: then, correct a wrong result")
    assert "copy the row" in then.text


@pytest.mark.parametrize(
    ("processes", "said"),
    [(0, []), (1, ["Steps were not timed: "]), (3, ["Steps of 3 processes were not timed: "])],
)
def test_steps_that_could_not_be_timed_are_said(processes, said):
    first = next(program.sections([row(MIXED, untimed_processes=processes)]))
    assert [fact.partition("no space")[0] for fact in first.facts] == said


def steps(count: int = 5000, late: int = 0, factor: float = 1.0, **more: Any) -> StepTimes:
    iteration = Durations(count, 2e6, 3e6, 9e7, late, 2e6, 2e6)
    engine = Durations(count, 3e4, 4e4, 5e5, 0, 3e4, 3e4)
    values = {"collections": 0, "collections_s": 0.0, "longest_collection_s": 0.0, **more}
    return StepTimes(
        1, 10.0, count, 500.0, factor, engine, iteration, False, {}, cost_share=0.0, **values
    )


def test_a_timer_that_holds_two_stages_is_named_by_both() -> None:
    timed = replace(steps(), stages={"kinematics": 0.6, "constraint solver": 0.4})
    seen = replace(row(MIXED), steps=[timed])
    text = terminal.text_of(program.sections([seen]))
    assert "Stages of the engine: kinematics and tendons 60 %, constraint solver 40 %" in text
    cost = PhysicsCost(1.0, {"kinematics": 0.4, "tendons": 0.2, "constraint solver": 0.4}, [])
    text = terminal.text_of(program.sections([replace(seen, physics=cost)]))
    assert "kinematics 40 %, constraint solver 40 %, tendons 20 %" in text


@pytest.mark.parametrize(("error", "said"), [(0.01, "timed"), (0.1, "6 %")])
def test_a_share_of_steps_has_the_error_that_their_bursts_show(error: float, said: str) -> None:
    of_program = steps()
    assert of_program.step is not None
    timed = replace(of_program, step=replace(of_program.step, mean_error=error))
    call = CallTime(
        "mj_step", 1, 1, PLACE, MIXED.loop, 1, 1.8, 0, 1, 1, 1,
    )  # fmt: skip
    seen = replace(row(replace(MIXED, calls=[call])), steps=[timed])
    text = terminal.text_of(program.sections([seen]))
    (line,) = [each for each in text.splitlines() if each.startswith("physics ")]
    assert line.split("60 %")[1].strip().startswith(said)


PACED = loop({Activity.SLEEPING: 0.9, Activity.PHYSICS: 0.1})


@pytest.mark.parametrize(
    ("seen", "more", "cause"),
    [
        (
            {"late": 3, "longest_collection_s": 0.343},
            {},
            "but 3 of 5,000 timed iterations were late (over 3 ms), the longest 343 ms: a garbage"
            " collection took 343 ms; call gc.collect() and gc.freeze() after set-up, before the"
            " loop",
        ),
        ({"late": 3}, {"queued_s": 1.2}, "the longest 90 ms: its thread waited 1.2 s for a core"),
        ({"late": 3}, {"queued_s": 0.03}, "what they have in common was not seen"),
    ],
)
def test_of_a_loop_that_keeps_real_time_late_iterations_and_their_cause_are_said(
    seen: dict[str, Any], more: dict[str, Any], cause: str
) -> None:
    said = program.conclusion(replace(row(PACED, remedy(), **more), steps=[steps(**seen)]))
    assert said.startswith(
        "the loop in train.py:5–9 keeps real time (1 ×; it sleeps 90 % of the time), but 3 of"
    )
    assert cause in said
    assert "do otherwise" not in said


def test_a_call_that_takes_as_long_as_a_period_makes_iterations_late() -> None:
    draws = CallTime("render", 1, 1, PLACE, None, 100.0, 0.5, 0, 1, 0, 0)
    said = program.conclusion(replace(row(replace(PACED, calls=[draws])), steps=[steps(late=9)]))
    assert said.endswith("the longest 90 ms: render at train.py:7 takes 5 ms each time")


def test_a_line_that_takes_most_of_the_longest_delay_made_it() -> None:
    saves = LineStay(replace(PLACE, text="np.savez(file, log)"), 0.06)
    paced = replace(PACED, longest_stay=saves)
    said = program.conclusion(replace(row(paced, queued_s=1.2), steps=[steps(late=9)]))
    assert "train.py:7 took about 60 ms at once (np.savez(file, log)); do this after" in said
    short = replace(paced, longest_stay=replace(saves, seconds=0.03))
    said = program.conclusion(replace(row(short, queued_s=1.2), steps=[steps(late=9)]))
    assert said.endswith("(taskset)")


@pytest.mark.parametrize(("time", "factor"), [(PACED, 0.5), (loop({Activity.PHYSICS: 1.0}), 1.0)])
def test_a_loop_that_does_not_sleep_to_keep_real_time_keeps_no_rate(
    time: LoopTime, factor: float
) -> None:
    said = program.conclusion(replace(row(time), steps=[steps(factor=factor)]))
    assert "keeps real time" not in said


def test_a_loop_that_sleeps_for_all_of_the_simulated_time_is_slower_than_real_time() -> None:
    said = program.conclusion(replace(row(PACED, remedy()), steps=[steps(factor=0.88)]))
    assert said.startswith("the loop in train.py:5–9 runs at 0.88 × real time: it sleeps for all")
    assert "do otherwise" not in said


def test_iterations_that_take_longer_and_longer_are_said_unless_steps_do() -> None:
    iteration = Durations(5000, 5e4, 1e5, 1e5, 0, 1e4, 9e4)
    growing = replace(steps(), iteration=iteration)
    (_, grows) = next(program.sections([replace(row(MIXED), steps=[growing])])).conclusions
    assert grows.text == (
        "An iteration takes longer and longer: 10 µs at the start, 90 µs at the end"
    )
    slower = replace(growing, step=replace(iteration, early_ns=1e3))
    assert len(next(program.sections([replace(row(MIXED), steps=[slower])])).conclusions) == 1


def test_after_an_error_the_report_is_about_the_error() -> None:
    full = "FatalError: mj_stackAlloc: out of memory"
    failed = row(MIXED, remedy(), exception=UncaughtException(full, PLACE))
    (section,) = program.sections([replace(failed, exit_code=1)])
    (conclusion,) = section.conclusions
    assert conclusion.text.endswith(f"{full} at train.py:7: mj_step(model, data)")
    assert not section.facts
