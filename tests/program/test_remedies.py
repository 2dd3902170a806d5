"""What to do first follows from where the time goes."""

from dataclasses import replace

import pytest

from mjbench.program import confirm, remedies
from mjbench.program.activities import Activity, Place
from mjbench.program.attribution import LineTime, LoopTime
from mjbench.program.launch import Program
from mjbench.program.remedies import Confirmed, Remedy, RemedyKind
from mjbench.program.source_loops import SourceLoop
from mjbench.program.step_times import Durations, StepTimes

PHYSICS, PYTHON, BINDINGS = Activity.PHYSICS, Activity.PYTHON, Activity.BINDINGS


def line(number, activities, function="main", package=""):
    place = Place("train.py", number, function, "text")
    return LineTime(place, sum(activities.values()), activities, package)


def loop(*lines, engine_clock=0.0, activities=None):
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
        packages={},
        lines=lines,
        inner_functions=[],
        engine_clock=engine_clock,
    )


def steps(**values):
    times = {"collections": 0, "collections_s": 0.0, "steps_per_s": 1000.0, **values}
    return StepTimes(
        pid=1,
        span_s=10.0,
        nstep=10_000,
        real_time_factor=2.0,
        step=Durations(10, 1.0, 2.0, 3.0),
        iteration=None,
        of_environment=False,
        stages={},
        cost_share=0.01,
        longest_collection_s=0.0,
        **times,
    )


def test_the_largest_saving_comes_first_with_its_error():
    time = loop(line(12, {PHYSICS: 0.6, BINDINGS: 0.1}), line(13, {PYTHON: 0.3}))
    first, second = remedies.remedies(time, [])
    assert (first.place.line, first.activity, first.gain) == (13, PYTHON, 0.3)
    assert first.gain_error == pytest.approx((0.3 * 0.7 / 400) ** 0.5)
    assert (second.place.line, second.gain) == (12, pytest.approx(0.1))
    assert "nstep" in second.text


def test_physics_alone_needs_no_remedy():
    assert remedies.remedies(loop(line(12, {PHYSICS: 1.0})), []) == []


def test_small_shares_are_left_out():
    time = loop(line(12, {PHYSICS: 0.995, PYTHON: 0.005}), engine_clock=0.004)
    assert remedies.remedies(time, []) == []


def test_a_function_without_a_slow_line_is_named_as_a_whole():
    inner = [line(100 + i, {PYTHON: 0.1}, "observe") for i in range(4)]
    (first, *_) = remedies.remedies(loop(line(12, {PHYSICS: 0.6}), *inner), [])
    assert first.gain == pytest.approx(0.4)
    assert first.text.startswith("observe() as a whole")


def test_a_line_that_calls_a_package_names_it():
    time = loop(line(12, {PHYSICS: 0.5, PYTHON: 0.5}, package="gymnasium"))
    assert "gymnasium" in remedies.remedies(time, [])[0].text


def test_the_timer_of_the_python_package_is_a_remedy_from_three_percent_on():
    assert remedies.remedies(loop(line(12, {PHYSICS: 1.0}), engine_clock=0.029), []) == []
    (remedy,) = remedies.remedies(loop(line(12, {PHYSICS: 1.0}), engine_clock=0.2), [])
    assert (remedy.kind, remedy.gain) == (RemedyKind.CLOCK, 0.2)


def test_collections_that_samples_cannot_see_come_from_the_step_clock():
    (remedy,) = remedies.remedies(loop(line(12, {PHYSICS: 1.0})), [steps(collections_s=2.0)])
    assert (remedy.kind, remedy.gain) == (RemedyKind.COLLECTION, pytest.approx(0.2))


def test_lint_findings_are_merged_by_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "train.py").write_text(
        "import mujoco\nmodel = mujoco.MjModel.from_xml_path('x')\ndata = mujoco.MjData(model)\n"
        "log = []\nfor _ in range(9):\n    mujoco.mj_step(model, data)\n"
        "    x = data.body('torso').xpos[2]\n    log.append(data.qpos)\n"
    )
    time = loop(line(6, {PHYSICS: 0.9}), line(7, {BINDINGS: 0.1}))
    wrong, named = remedies.remedies(replace(time, own_files=["train.py", "missing.py"]), [])
    assert (wrong.kind, wrong.place.line, wrong.gain) == (RemedyKind.RESULT, 8, None)
    assert (named.place.line, named.code, named.gain) == (7, "MJB002", 0.1)


def remedy(kind, gain=0.2, **more):
    return Remedy(kind, PYTHON, Place("train.py", 7, "main"), "text", gain, 0.01, **more)


def test_what_can_be_applied_is_confirmed_by_runs_in_turns(tmp_path):
    file = tmp_path / "train.py"
    file.write_text("pass")
    order = []

    def run(change, source):
        order.append(change)
        return [steps(steps_per_s=1000.0 if not change else 1250.0)]

    program = Program([str(file)])
    clock, activity = remedy(RemedyKind.CLOCK), remedy(RemedyKind.ACTIVITY)
    confirmed, untouched = confirm.confirm(program, [clock, activity], lambda *_: None, run)
    assert untouched == activity
    assert confirmed.confirmed.gain == pytest.approx(0.2)
    assert confirmed.confirmed.is_certain
    assert confirmed.confirmed.runs == confirm.ROUNDS
    assert order[:4] == ["", "no-engine-clock", "no-engine-clock", ""]
    assert len(order) == confirm.most_runs([clock, activity])


def test_copies_are_measured_by_the_steps_of_all_of_them(monkeypatch):
    monkeypatch.setattr(confirm.machine, "usable_cores", lambda: 2)
    of_one = steps(steps_per_s=100.0)
    copies = remedies.copies([of_one], cores=2)
    assert remedies.copies([of_one], cores=1) is None
    assert remedies.copies([of_one, of_one], cores=2) is None
    order = []

    def run(change, source):
        order.append(change)
        return [of_one]

    (confirmed,) = confirm.confirm(Program(["-m", "module"]), [copies], lambda *_: None, run)
    assert len(order) == 3 * confirm.ROUNDS  # one copy, then two at once
    assert confirmed.confirmed.gain == pytest.approx(0.5)
    assert confirmed.rank > remedy(RemedyKind.LINE).rank
    assert remedies.first([confirmed]) is None


def test_a_change_that_fails_once_is_not_confirmed(tmp_path):
    file = tmp_path / "train.py"
    file.write_text("pass")

    def run(change, source):
        if change:
            raise confirm.MjbenchError("no")
        return [steps()]

    (same,) = confirm.confirm(
        Program([str(file)]), [remedy(RemedyKind.CLOCK)], lambda *_: None, run
    )
    assert same.confirmed is None


def test_the_programs_own_lines_are_tried_with_lints_fixes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "train.py"
    file.write_text(
        "import mujoco\nmodel = mujoco.MjModel.from_xml_path('x')\ndata = mujoco.MjData(model)\n"
        "for _ in range(9):\n    mujoco.mj_step(model, data)\n"
        "    x = data.body('torso').xpos[2]\n"
    )
    sources = set()

    def run(change, source):
        sources.add(source.read_text())
        return [steps()]

    line_remedy = remedy(RemedyKind.LINE, code="MJB002")
    (tried,) = confirm.confirm(Program(["train.py"]), [line_remedy], lambda *_: None, run)
    assert len(sources) == 2
    assert file.read_text() in sources
    assert tried.confirmed.gain == 0
    assert not tried.confirmed.is_certain


def test_order_with_confirmed_remedies():
    wrong = Remedy(RemedyKind.RESULT, None, None, "", None, None)
    large, small = remedy(RemedyKind.LINE, 0.3), remedy(RemedyKind.LINE, 0.1)
    sure = remedy(RemedyKind.CLOCK, 0.2, confirmed=Confirmed(0.4, 0.3, 0.5, 8))
    unsure = remedy(RemedyKind.CLOCK, 0.9, confirmed=Confirmed(0.1, -0.1, 0.3, 8))
    listed = sorted([unsure, small, sure, large, wrong], key=lambda each: each.rank)
    assert listed == [wrong, sure, large, small, unsure]
