"""Vectorised forms: those of Gymnasium, where it is installed."""

import dataclasses
import importlib.util
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from commands import PYTHONPATH
from example_environment_records import record

from mjbench.commands.env import vectors
from mjbench.commands.env.child_process import EnvironmentPlan
from mjbench.commands.env.result import EnvironmentRecord, VectorForm
from mjbench.commands.env.source import resolve
from mjbench.commands.env.vectors import VectorLaunch
from mjbench.errors import Failure
from mjbench.status import Status

PLAN = EnvironmentPlan(nstep=None, seed=0, threads=(), nenv=(1, 2), budget_s=0.0, limit_s=60.0)
# As many as show that the rule goes on; an interval of six is tested without processes.
FEW_LAUNCHES = 2
needs_gymnasium = pytest.mark.skipif(
    not importlib.util.find_spec("gymnasium"), reason="needs gymnasium"
)

# An environment of Gymnasium that needs no MuJoCo: a point that ends its episode at a border.
POINT = """
import multiprocessing
import os
import time
import gymnasium
import numpy as np

class Point(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (2,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = self.np_random.uniform(-1, 1, 2)
        return self.place.copy(), {}

    def step(self, action):
        self.place = self.place + 0.3 * action
        over = bool(np.abs(self.place).max() > 1.5)
        return self.place.copy(), 0.0, over, False, {}

class Remembering(Point):
    "Starts elsewhere in each episode."
    starts = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.starts += 1
        self.place = self.place + self.starts
        return self.place.copy(), {}

class Unseeded(Point):
    def reset(self, *, seed=None, options=None):
        return super().reset()

class Single(Point):
    exist = 0

    def __init__(self):
        Single.exist += 1
        if Single.exist > 1:
            raise RuntimeError("one simulator only")

class Timed(Point):
    "Has a clock and a function, which is no message to another process, in its info."

    def step(self, action):
        *returned, info = super().step(action)
        return *returned, {"t": time.perf_counter(), "why": lambda: 0}

class Clumsy(Point):
    "Observes something else where another of its kind lives in the same process."
    alive = 0

    def __init__(self):
        Clumsy.alive += 1

    def step(self, action):
        place, *rest = super().step(action)
        return place + 0.1 * (Clumsy.alive > 3), *rest

class Fragile(Point):
    "Ends the processes of AsyncVectorEnv."

    def step(self, action):
        if multiprocessing.parent_process() is not None:
            os._exit(3)
        return super().step(action)
"""


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)


def added(folder: Path, name: str) -> EnvironmentRecord:
    (folder / "point_env.py").write_text(POINT)
    source = resolve(f"point_env:{name}", folder)
    with mock.patch.object(vectors, "LEAST_LAUNCHES", FEW_LAUNCHES):
        return vectors.added(record(vectors=[]), source, PLAN)


@needs_gymnasium
def test_both_forms_do_what_one_environment_does_and_are_timed(tmp_path: Path) -> None:
    """Also where it remembers earlier episodes: it is compared with its like."""
    whole = added(tmp_path, "Remembering")
    measured = whole.vectors
    assert whole.no_vectors == ""
    assert [(v.form, v.nenv) for v in measured] == [
        (VectorForm.SYNC, 1),
        (VectorForm.ASYNC, 1),
        (VectorForm.SYNC, 2),
        (VectorForm.ASYNC, 2),
    ]
    for vector in measured:
        assert (vector.status, vector.detail) == (Status.OK, "")
        assert len(vector.ns) == len(vector.single_ns) == FEW_LAUNCHES
    assert [vector.ncore for vector in measured[:3]] == [1, 1, 1]


@needs_gymnasium
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Unseeded", "two of it, reset and stepped alike, return other values (observation"),
        ("Single", "it cannot be made twice in a process: Single() raised RuntimeError: one sim"),
    ],
)
def test_an_environment_without_forms_has_its_reason(
    name: str, reason: str, tmp_path: Path, inline: None
) -> None:
    measured = added(tmp_path, name)
    assert measured.no_vectors.startswith(reason)
    assert measured.vectors == []


@needs_gymnasium
def test_info_is_not_compared_and_what_no_process_can_pass_on_is_said(tmp_path: Path) -> None:
    by_form = {(v.form, v.nenv): v for v in added(tmp_path, "Timed").vectors}
    assert by_form[VectorForm.SYNC, 2].status == Status.OK
    refused = by_form[VectorForm.ASYNC, 2]
    assert refused.status == Status.FAILED
    assert "pickle" in refused.detail


@needs_gymnasium
def test_a_form_that_observes_something_else_gets_no_speed(tmp_path: Path) -> None:
    by_form = {(v.form, v.nenv): v for v in added(tmp_path, "Clumsy").vectors}
    wrong = by_form[VectorForm.SYNC, 2]
    assert (wrong.status, wrong.ns) == (Status.DISAGREES, ())
    assert "returns another observation after step" in wrong.detail


@needs_gymnasium
def test_a_form_that_crashes_costs_its_own_row(tmp_path: Path) -> None:
    by_form = {(v.form, v.nenv): v for v in added(tmp_path, "Fragile").vectors}
    assert by_form[VectorForm.SYNC, 2].status == Status.OK
    assert len(by_form[VectorForm.SYNC, 2].ns) == FEW_LAUNCHES
    for nenv in (1, 2):
        failed = by_form[VectorForm.ASYNC, nenv]
        assert failed.status in (Status.FAILED, Status.CRASHED, Status.TIMEOUT)
        assert failed.detail
        assert failed.ns == ()


@pytest.mark.parametrize(
    ("name", "reason"),
    [("dm_control", "only Gymnasium has them"), ("make", "")],
    ids=["dm_control", "like Gymnasium"],
)
def test_other_environments_have_none(name: str, reason: str, inline: None) -> None:
    from commands import TESTS

    source = resolve(f"example_environments:{name}", TESTS)
    measured = vectors.added(record(), source, PLAN)
    assert measured.no_vectors.startswith(reason)
    assert measured.no_vectors


def test_without_gymnasium_there_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    import example_environments as examples

    from mjbench.commands.env.adapters import adapt

    monkeypatch.setitem(sys.modules, "gymnasium", None)
    assert "not installed" in vectors._no_forms(adapt(examples.make()))


def test_a_form_that_was_wrong_in_any_launch_has_its_reason_and_the_others_their_figures() -> None:
    rule = vectors._VectorRule(PLAN)
    rule.add(VectorLaunch({0: 1.0, 1: 3.0, 2: 2.0}, {0: 1.5, 1: 1.5, 2: 2.5}))
    rule.add(VectorLaunch({}, {}, {1: Failure(Status.TIMEOUT, "no answer")}))
    assert rule.next_targets() == [0, 2, 3]
    rule.add(VectorLaunch({0: 1.0, 2: 2.0}, {0: 1.5, 2: 2.5}))
    first, second, third, fourth = rule.samples(Failure(Status.FAILED, "it ended early"))
    assert (first.status, len(first.ns), first.single_ns[0]) == (Status.OK, 2, 1.5)
    assert (second.status, second.detail, second.ns) == (Status.TIMEOUT, "no answer", ())
    assert third.ns[0] == 2.0
    assert (fourth.status, fourth.detail) == (Status.FAILED, "it ended early")


@pytest.mark.parametrize(("budget_s", "launches"), [(0.0, 6), (20.0, 10), (1000.0, 50)])
def test_launches_end_with_the_budget_but_for_the_six_of_an_interval(
    budget_s: float, launches: int
) -> None:
    now_s = 0.0
    rule = vectors._VectorRule(dataclasses.replace(PLAN, budget_s=budget_s), lambda: now_s)
    while rule.next_targets():
        now_s += 2.0
        rule.add(VectorLaunch({}, {}))
    assert len(rule.launches) == launches


def test_a_time_that_the_user_gave_ends_them_after_one_launch() -> None:
    plan, now_s = dataclasses.replace(PLAN, budget_s=3.0, must_end=True), 0.0
    rule = vectors._VectorRule(plan, lambda: now_s)
    assert rule.next_targets()
    now_s += 2.0
    rule.add(VectorLaunch({}, {}))
    assert not rule.next_targets()


def test_without_any_form_left_nothing_is_launched() -> None:
    rule = vectors._VectorRule(PLAN)
    rule.add(VectorLaunch({}, {}, dict.fromkeys(range(4), Failure(Status.FAILED, "no"))))
    assert rule.next_targets() == []


@pytest.mark.parametrize("number", [0, 1])
def test_a_form_that_was_wrong_in_a_timed_block_leaves_the_figures_of_the_others(
    number: int,
) -> None:
    class Environment:
        singles, batched = [object()], [0] * 20
        ran = 0

        def __init__(self, right_blocks: int):
            self.right_blocks = right_blocks

        def run(self) -> float:
            self.ran += 1
            return 1.0

        def difference_after(self, step: int) -> str:
            return "another reward" if self.ran > self.right_blocks else ""

    class Single:
        def run(self) -> float:
            return 1.0

    class Channel:
        def doing(self, text: str, index: int | None = None) -> None: ...

    environments = {3: Environment(number), 4: Environment(9)}
    launch = vectors._timed(environments, [Single()], Channel())  # type: ignore[arg-type, list-item]
    failure = Failure(Status.DISAGREES, "in a timed block, another reward")
    assert launch == VectorLaunch({4: 5e7}, {4: 5e7}, {3: failure})
    assert environments[3].ran == number + 1


def test_observations_are_compared_bit_by_bit_in_the_types_of_the_form() -> None:
    single = {"a": np.array([0.1, 0.2]), "b": (np.array(3),)}
    batched = {"a": np.array([[9.0, 9.0], [0.1, 0.2]], dtype=np.float32), "b": (np.array([9, 3]),)}
    copied = vectors._copied(single)
    assert vectors._equal(copied, batched, 1)
    assert not vectors._equal(copied, batched, 0)
    batched["a"][1, 0] = np.nextafter(np.float32(0.1), np.float32(1))
    assert not vectors._equal(copied, batched, 1)
