"""Which parts a check-up has, what time they get, and how it ends where one fails."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_races import ROLLOUT, compared, raced
from step_profiles import step_profile
from verdict_records import FASTER

import mjbench
from mjbench.commands.checkup import driver as checkup
from mjbench.commands.checkup.driver import CheckupPlan
from mjbench.commands.checkup.options import CheckupOptions
from mjbench.commands.checkup.result import CheckedPart, CheckupPart
from mjbench.commands.checkup.targets import ProgramFile
from mjbench.commands.run.launch import ProgramObservation
from mjbench.commands.run.recorded_models import RecordedModel
from mjbench.commands.run.remedies import remedy_pairs
from mjbench.commands.run.remedies.remedy_pairs import MeasuredRatios
from mjbench.commands.tune.result import TuneRecord
from mjbench.errors import InputError, MachineError
from mjbench.session import Item, Observer
from mjbench.simulation import models
from mjbench.simulation.starts import StartPlan
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER

CARTPOLE = models.resolve("cartpole")
GAINS = ((WITHOUT_TIMER, 1.3), (ROLLOUT, 3.0))


class Planted:
    """Measurements that take as many seconds as they are given, by a clock of their own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *entrants: Any):
        self.now_s, self.entrants = 0.0, entrants
        self.tuning_s: list[float] = []
        self.together_s: list[float] = []
        monkeypatch.setattr(checkup.isolate, "call", self.profile)
        monkeypatch.setattr(checkup.model_comparison, "measure_model", self.compare)
        monkeypatch.setattr(checkup, "tune", self.tune)
        monkeypatch.setattr(checkup.combination, "measure", self.together)

    def profile(self, *arguments: Any, **options: Any) -> Any:
        self.now_s += 4.0
        return step_profile().steps

    def compare(self, pool: Any, source: Any, plans: Any, *others: Any) -> Iterator[Item]:
        self.now_s += plans[0].budget_s
        yield Item(compared(raced(self.entrants)))

    def tune(self, pool: Any, source: Any, plan: Any, *others: Any) -> TuneRecord:
        self.tuning_s.append(plan.budget_s)
        self.now_s += plan.budget_s
        return TuneRecord(model="m")

    def together(
        self, pool: Any, source: Any, combined: Any, sizes: Any, time_s: float, *others: Any
    ) -> Any:
        self.together_s.append(time_s)
        return FASTER

    def parts(self, plan: CheckupPlan) -> list[CheckedPart]:
        parts = checkup._Parts(CARTPOLE, plan, Observer(), lambda: self.now_s)
        items = list(checkup._model_items(CARTPOLE, parts))
        firsts = [item.records[0] for item in items]
        return [part for part in firsts if isinstance(part, CheckedPart)]


def test_a_minute_is_shared_and_no_part_begins_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    planted = Planted(monkeypatch, *GAINS)
    parts = [part.part for part in planted.parts(CheckupPlan())]
    assert parts == [
        CheckupPart.STEP,
        CheckupPart.PATHS,
        CheckupPart.SETTINGS,
        CheckupPart.TOGETHER,
    ]
    assert planted.tuning_s == [60 - 4 - 14 - 5 - 4]
    assert planted.together_s == [5.0]


def test_a_quick_one_tries_no_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    planted = Planted(monkeypatch, *GAINS)
    parts = planted.parts(CheckupPlan(is_quick=True))
    assert [part.part for part in parts] == [CheckupPart.STEP, CheckupPart.PATHS]
    assert all(part.is_quick for part in parts)
    assert planted.now_s == 15.0 - 4.0, "processes start and end"


def test_one_change_alone_has_its_figure_and_is_not_measured_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planted = Planted(monkeypatch, (ROLLOUT, 3.0))
    planted.parts(CheckupPlan())
    assert planted.together_s == []


def test_a_part_that_fails_does_not_end_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    planted = Planted(monkeypatch, *GAINS)

    def crash(*arguments: Any, **options: Any) -> None:
        raise MachineError("killed by signal 11")

    monkeypatch.setattr(checkup, "tune", crash)
    parts = planted.parts(CheckupPlan())
    statuses = {part.part: part.status for part in parts}
    assert statuses[CheckupPart.SETTINGS] == Status.FAILED
    assert statuses[CheckupPart.TOGETHER] == Status.OK


def test_a_part_that_fails_unforeseen_is_said_and_the_others_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planted = Planted(monkeypatch, *GAINS)
    monkeypatch.setattr(checkup, "tune", lambda *arguments: 1 / 0)
    parts = {part.part: part for part in planted.parts(CheckupPlan())}
    assert parts[CheckupPart.SETTINGS].status == Status.FAILED
    assert "ZeroDivisionError: division by zero" in parts[CheckupPart.SETTINGS].detail
    assert parts[CheckupPart.TOGETHER].status == Status.OK


OBSERVED = ProgramObservation(1.0, 7, (), (), 100, False, 0.0)


def program_parts(
    monkeypatch: pytest.MonkeyPatch, lint: Callable[..., Any], seen: ProgramObservation
) -> list[Any]:
    monkeypatch.setattr(checkup.lint, "check", lint)
    monkeypatch.setattr(checkup.launch, "check", lambda program: None)
    monkeypatch.setattr(checkup.launch, "run", lambda *arguments, **options: seen)
    source = ProgramFile(("train.py",), Path("train.py"))
    parts = checkup._Parts(source, CheckupPlan(), Observer())
    return [record for item in checkup._program_items(source, parts) for record in item.records]


def test_a_program_runs_though_lint_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    source, program, row = program_parts(monkeypatch, lambda name: 1 / 0, OBSERVED)
    assert (source.status, program.status) == (Status.FAILED, Status.OK)
    assert row.exit_code == 0


def test_a_run_that_was_interrupted_keeps_what_was_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = replace(OBSERVED, was_interrupted=True, was_ended=True)
    _, program, row = program_parts(monkeypatch, lambda name: [], seen)
    assert program.status == Status.INTERRUPTED
    assert row.wall_s == 1.0


def test_an_interrupt_after_the_run_keeps_what_was_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    model = RecordedModel(b"", np.zeros((1, 1)), np.zeros((0, 1)), "4.0.0")

    def measure(models: Sequence[RecordedModel], asked: Any) -> MeasuredRatios:
        if models:
            raise KeyboardInterrupt
        return MeasuredRatios({})

    monkeypatch.setattr(remedy_pairs, "measure", measure)
    seen = replace(OBSERVED, models=(model,))
    _, program, row = program_parts(monkeypatch, lambda name: [], seen)
    assert (program.status, row.wall_s) == (Status.INTERRUPTED, 1.0)


def test_a_model_that_cannot_be_stepped_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    planted = Planted(monkeypatch)

    def refuse(*arguments: Any, **options: Any) -> None:
        raise InputError("cartpole: every simulation diverges")

    monkeypatch.setattr(checkup.isolate, "call", refuse)
    (part,) = planted.parts(CheckupPlan())
    assert (part.status, part.detail) == (Status.INPUT, "every simulation diverges")


@pytest.mark.parametrize(
    ("options", "most_s"),
    [
        ({}, 60.0),
        ({"seconds": 100.0}, 120.0),
        ({"seconds": None}, math.inf),
        ({"seconds": None, "budget_s": 31.5}, 20.0),
        ({"seconds": 100.0, "quick": True}, 8.1),
    ],
)
def test_a_program_is_ended_in_time(options: dict[str, Any], most_s: float) -> None:
    plan = CheckupPlan.of(CheckupOptions(**options))
    assert plan.most_program_s == pytest.approx(most_s, rel=0.05)


def test_start_states_are_of_a_model() -> None:
    plan = CheckupPlan(starts=StartPlan(settle_s=1.0))
    with pytest.raises(InputError, match=r"of a model, and train\.py is none"):
        checkup.measurement(ProgramFile(("train.py",), Path("train.py")), plan)


def test_a_model_has_no_arguments() -> None:
    with pytest.raises(InputError, match="only a program has arguments"):
        mjbench.checkup("cartpole", "--fast")
