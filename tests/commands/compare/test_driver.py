"""What becomes of a model's paths when one of them, or a child, fails, and whose row pays.

Also how a comparison ends where it is interrupted between its steps.
"""

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import TESTS
from pretender import Pretender

from mjbench import paths
from mjbench.commands.compare import accelerated_measurement
from mjbench.commands.compare import driver as model_comparison
from mjbench.commands.compare.driver import ComparedModel, ModelChildren
from mjbench.commands.compare.options import RL_HOLD, CompareOptions
from mjbench.commands.compare.results import ModelResults, PathResult
from mjbench.errors import InputError
from mjbench.host import isolate, machine, neighbours
from mjbench.host.machine import CoreChange
from mjbench.host.neighbours import Neighbour
from mjbench.paired.race import RaceLaunches
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.content import Section
from mjbench.session import Observer
from mjbench.simulation import models
from mjbench.simulation.engine_clock import has_clock
from mjbench.simulation.workload import Product
from mjbench.status import Status
from mjbench.verification.path_verification import ModelFiles
from mjbench.verification.plan import WITHOUT_TIMER, ComparisonPlan, Variant
from mjbench.verification.records import ModelRecord, VariantRecord


class Recorded(ComparedModel):
    """Remembers what it would show."""

    def __init__(self, pool: WorkerPool, file: str, plan: ComparisonPlan, observer: Observer):
        super().__init__(pool, models.resolve(file), plan, (0.0, 1.0), (), observer)
        self.shown: list[ModelResults] = []

    def _show_known(self) -> None:
        self.shown.append(self.known())


def plan_of(*variants: Variant, limit_s: float = 60.0) -> ComparisonPlan:
    return ComparisonPlan(
        variants=(Variant("python_loop", {}), *variants),
        nbatch=3,
        nstep=4,
        budget_s=0.1,
        limit_s=limit_s,
        import_from=str(TESTS),
    )


def comparisons(
    pool: WorkerPool, file: str, *variants: Variant, limit_s: float = 60.0
) -> list[ModelResults]:
    """Compare paths on a model in one launch; return what was known, as it came, and at the end."""
    compared = Recorded(pool, file, plan_of(*variants, limit_s=limit_s), Observer())
    with contextlib.suppress(KeyboardInterrupt):
        compared.run()
    return [*compared.shown, compared.known()]


def results(known: ModelResults) -> dict[str, PathResult]:
    """Return the results of paths by name."""
    return {row.path: row for row in known.results}


def measured(
    pool: WorkerPool, file: str, *names: str, limit_s: float = 60.0
) -> dict[str, PathResult]:
    """Return the results of paths by name, from one launch."""
    variants = [Variant(name, {}) for name in names]
    *_, last = comparisons(pool, file, *variants, limit_s=limit_s)
    return results(last)


def test_for_rl_a_call_takes_one_action_of_paths_that_a_policy_can_use() -> None:
    (plan,) = model_comparison.plans_of(CompareOptions(rl=True))
    assert (plan.nstep, plan.hold) == (RL_HOLD, RL_HOLD)
    assert {variant.path for variant in plan.variants} >= {"batch_step", "threads"}
    assert all(paths.find(variant.path).closed_loop for variant in plan.variants)
    swept = CompareOptions(rl=True, scaling=True, hold=3, nbatch=[16, 4096])
    plans = model_comparison.plans_of(swept)
    assert [(each.nbatch, each.nstep, each.hold) for each in plans] == [(16, 3, 3), (4096, 3, 3)]
    assert {variant.path for variant in plans[0].variants} == {"python_loop", "batch_step"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (CompareOptions(rl=True, nstep=10), "give --hold, not --nstep"),
        (CompareOptions(rl=True, paths=["batch_step", "rollout"]), "rollout takes controls known"),
    ],
)
def test_what_is_not_for_rl_is_refused(given: CompareOptions, message: str) -> None:
    with pytest.raises(InputError, match=message):
        model_comparison.plans_of(given)


@pytest.mark.parametrize(
    ("name", "status", "detail"),
    [
        ("CrashesWhenTimed", Status.CRASHED, "SIGSEGV) while timing"),
        ("HangsWhenTimed", Status.TIMEOUT, "while timing"),
        ("SharedModel", Status.FAILED, "which all paths share: opt.disableflags while preparing"),
        ("SharedModelWhenTimed", Status.FAILED, "which all paths share: body_mass while timing"),
        ("Crashes", Status.CRASHED, "SIGSEGV) while preparing wrong_paths:Crashes"),
        ("Exits", Status.CRASHED, "exit code 0 while preparing wrong_paths:Exits"),
        ("RaisesWhenTimed", Status.FAILED, "SystemExit: enough while timing"),
    ],
)
def test_a_path_that_ends_the_child_costs_its_own_row_alone(
    pool: WorkerPool,
    contact_file: str,
    name: str,
    status: Status,
    detail: str,
    request: pytest.FixtureRequest,
) -> None:
    if name.endswith("WhenTimed"):
        request.getfixturevalue("inline")
    culprit = f"wrong_paths:{name}"
    pool.limit_s = 3.0 if status == Status.TIMEOUT else 30.0
    rows = measured(pool, contact_file, culprit, "python_loop_hold", limit_s=pool.limit_s)
    pool.limit_s = 30.0
    assert rows[culprit].status == status
    assert detail in rows[culprit].detail
    assert not rows[culprit].is_timed
    for name in ("python_loop", "python_loop_hold"):
        assert rows[name].is_timed, rows[name].detail


@pytest.mark.usefixtures("inline")
def test_a_path_that_replays_its_warm_up_is_caught_in_the_first_round(
    pool: WorkerPool, contact_file: str
) -> None:
    rows = measured(pool, contact_file, "wrong_paths:MemoWhenTimed", "python_loop_hold")
    assert rows["wrong_paths:MemoWhenTimed"].status == Status.DISAGREES
    assert "in a timed block" in rows["wrong_paths:MemoWhenTimed"].detail
    assert rows["python_loop_hold"].is_timed


@pytest.mark.usefixtures("inline")
def test_the_plain_loop_is_timed_without_the_engines_clock_too(
    pool: WorkerPool, contact_file: str
) -> None:
    if not has_clock(models.load(models.resolve(contact_file))):
        pytest.skip("this release of MuJoCo has no clock of its own")
    *_, last = comparisons(pool, contact_file, WITHOUT_TIMER)
    assert last.race is not None
    assert last.race.launch_count(WITHOUT_TIMER) == 1
    assert last.race.groups == [[0], [0]]


@pytest.mark.usefixtures("inline")
def test_what_is_known_comes_after_each_launch(pool: WorkerPool, contact_file: str) -> None:
    first, *_, last = comparisons(pool, contact_file, Variant("rollout", {"threads": 1}))
    assert first.race is not None
    assert len(first.race.launches) == 1
    assert last.race is not None
    assert last.race.is_cut_short
    assert last.race.steps == 12


@pytest.mark.usefixtures("inline")
def test_another_measurement_that_ended_during_the_race_stays_on_record(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = itertools.chain([[Neighbour(1, "versions")]], itertools.repeat([]))
    monkeypatch.setattr(neighbours, "measuring_now", lambda: next(seen))
    first, *_, last = comparisons(pool, contact_file, Variant("rollout", {"threads": 1}))
    assert first.race is not None and first.race.disturbance.commands == ["versions"]
    assert last.race is not None and last.race.disturbance.commands == ["versions"]


@pytest.mark.usefixtures("inline")
def test_a_core_that_was_lost_during_the_race_stays_on_record(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = itertools.chain([2.0, 1.0], itertools.repeat(2.0))
    monkeypatch.setattr(machine, "allowed_cores", lambda: next(allowed))
    monkeypatch.setattr(machine, "usable_cores", lambda: 2)
    *_, last = comparisons(pool, contact_file, Variant("rollout", {"threads": 1}))
    assert last.race is not None
    assert last.race.disturbance.core_change == CoreChange(2, 1)


@pytest.mark.usefixtures("inline")
def test_a_race_measures_a_variant_that_takes_seconds_to_start_last(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mjbench.paths.rollout.Rollout.starts_slowly", True)
    *_, last = comparisons(pool, contact_file, Variant("rollout", {"threads": 1}))
    assert last.race is not None
    assert (last.race.groups, last.race.slow) == ([[0], [0]], [1])


@pytest.mark.usefixtures("inline")
@pytest.mark.parametrize("at_launch", [0, 1])
def test_what_was_measured_before_an_interruption_comes_last(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch, at_launch: int
) -> None:
    launch: Callable[..., object] = RaceLaunches.launch
    numbers = itertools.count()

    def interrupted(*arguments: object) -> object:
        if next(numbers) == at_launch:
            raise KeyboardInterrupt
        return launch(*arguments)

    monkeypatch.setattr(RaceLaunches, "launch", interrupted)
    monkeypatch.setattr("mjbench.paired.race.RaceBudget.left_s", lambda budget: 100.0)
    *_, last = comparisons(pool, contact_file, Variant("python_loop_hold", {}))
    assert last.model.status == Status.INTERRUPTED
    assert last.race is not None
    assert len(last.race.launches) == at_launch
    rows = results(last).values()
    assert {row.is_timed for row in rows} == {at_launch > 0}
    assert {row.status for row in rows} == {Status.OK if at_launch else Status.INTERRUPTED}


class Interrupted(Observer):
    """Is interrupted when it shows results, or at last when it is told that all is done."""

    def __init__(self, done: str = ""):
        super().__init__()
        self._done = done

    def __call__(self, name: str, share: float) -> None:
        if name == self._done:
            raise KeyboardInterrupt

    def show(self, section: Callable[[], Section | None] | None) -> None:
        if not self._done:
            raise KeyboardInterrupt


@pytest.mark.usefixtures("inline")
def test_an_interruption_of_who_shows_results_leaves_them(
    pool: WorkerPool, contact_file: str
) -> None:
    source, plan = models.resolve(contact_file), plan_of(Variant("python_loop_hold", {}))
    (item,) = model_comparison.measure_model(
        pool, source, [plan] * 2, [0, 0.5, 1], (), Interrupted()
    )
    model, *rows, race = item.records
    assert isinstance(model, ModelRecord) and isinstance(race, RaceRecord)
    assert (model.status, race.status) == (Status.INTERRUPTED, Status.INTERRUPTED)
    assert [race.launch_count(variant) for variant in race.variants] == [1, 1]
    assert len(rows) == 2


@pytest.mark.usefixtures("inline")
def test_an_interruption_after_all_was_measured_leaves_it_complete(
    pool: WorkerPool, contact_file: str
) -> None:
    source, plan = models.resolve(contact_file), plan_of(Variant("python_loop_hold", {}))
    observer = Interrupted(source.name)
    items = model_comparison.measure_model(pool, source, [plan] * 2, [0, 0.5, 1], (), observer)
    assert model_comparison.finished(next(items).records, 2)
    with pytest.raises(KeyboardInterrupt):
        next(items)


@pytest.mark.usefixtures("inline")
def test_phases_are_named_as_they_begin(pool: WorkerPool, contact_file: str) -> None:
    class Phases(Observer):
        def begin(self, phase: str) -> None:
            phases.append(phase)

    phases: list[str] = []
    plan = plan_of(Variant("pretender:Pretender", {}))
    compared = Recorded(pool, contact_file, plan, Phases())
    compared.run()
    name = models.resolve(contact_file).name
    assert phases == [
        f"{name}: checking agreement",
        f"{name}: timing the plain loop",
        f"{name}: pretender:Pretender",
    ]


def test_two_paths_that_end_the_child_cost_two_rows(pool: WorkerPool, contact_file: str) -> None:
    names = ("wrong_paths:Crashes", "wrong_paths:CrashesWhenTimed")
    rows = measured(pool, contact_file, *names)
    assert [rows[name].status for name in names] == [Status.CRASHED] * 2
    assert rows["python_loop"].is_timed


@pytest.mark.usefixtures("inline")
def test_a_model_that_cannot_be_loaded_has_rows_that_say_so(
    pool: WorkerPool, tmp_path: Path
) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    rows = measured(pool, str(tmp_path / "broken.xml"), "python_loop_hold")
    assert {row.status for row in rows.values()} == {Status.INPUT}
    assert all("cannot load" in row.detail for row in rows.values())


def test_a_path_that_changes_its_process_is_measured_all_the_same(
    pool: WorkerPool, contact_file: str
) -> None:
    rows = measured(pool, contact_file, "wrong_paths:Untidy", "python_loop_hold")
    assert all(row.is_timed for row in rows.values()), [row.detail for row in rows.values()]


def test_an_accelerated_path_that_fails_in_the_parent_costs_its_own_row(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: object) -> dict[str, str | None]:
        raise RuntimeError("no environment")

    monkeypatch.setattr(Pretender, "environment", fail)
    rows = measured(pool, contact_file, "pretender:Pretender")
    assert rows["pretender:Pretender"].status == Status.FAILED
    assert rows["pretender:Pretender"].detail == "RuntimeError: no environment"
    assert rows["python_loop"].is_timed


@pytest.mark.usefixtures("inline")
def test_a_model_whose_race_was_torn_off_is_measured_again(
    pool: WorkerPool, contact_file: str
) -> None:
    *_, last = comparisons(pool, contact_file, Variant("python_loop_hold", {}))
    records = last.records
    assert model_comparison.finished(records, 2) == records
    assert model_comparison.finished(records[:-1], 2) == []


# The children alone, without a race.


def children(folder: Path, model: str, *names: str, **plan: Any) -> ModelChildren:
    variants = tuple(Variant(name, {}) for name in ("python_loop", *names))
    usual = {"nbatch": 3, "nstep": 4, "limit_s": 60.0, "import_from": str(TESTS)}
    asked = ComparisonPlan(variants=variants, **{**usual, **plan})
    return ModelChildren(models.resolve(model), asked, ModelFiles.in_folder(folder))


def verified(folder: Path, model: str, *names: str, **plan: Any) -> ModelChildren:
    of_model = children(folder, model, *names, **plan)
    of_model.verify(lambda: None)
    return of_model


def rows_of(of_model: ModelChildren) -> dict[str, VariantRecord]:
    """Return the records as if a race had timed all that agrees."""
    return {
        record.path: record for record in of_model.measurements(of_model.agreeing, is_over=True)
    }


def test_a_path_that_hangs_costs_its_own_row_alone(tmp_path: Path, contact_file: str) -> None:
    culprit = "wrong_paths:Hangs"
    of_model = verified(tmp_path, contact_file, culprit, "python_loop_hold", limit_s=3.0)
    rows = rows_of(of_model)
    assert rows[culprit].status == Status.TIMEOUT
    assert "no answer within 3 s" in rows[culprit].detail
    assert of_model.agreeing == [0, 2]
    assert of_model.model_record().status == Status.OK


def test_a_path_that_does_not_return_what_is_asked_for_is_unavailable(
    tmp_path: Path, contact_file: str, inline: None
) -> None:
    plan = {"returns": Product.SENSORS, "hold": 2}
    of_model = verified(tmp_path, contact_file, "python_loop_hold", **plan)
    row = rows_of(of_model)["python_loop_hold"]
    assert row.status == Status.UNAVAILABLE
    assert "returns no state between" in row.detail
    assert of_model.model_record().returns == Product.SENSORS


@pytest.mark.parametrize(
    ("text", "limit_s", "status", "detail"),
    [
        (
            "<mujoco><option timestep='.1'/><worldbody><body><joint name='j' type='slide'"
            " stiffness='1e9'/><geom size='.1' mass='.001'/></body></worldbody></mujoco>",
            60.0,
            Status.INPUT,
            "diverges",
        ),
        (
            "<mujoco><option solver='PGS' iterations='2147483647' tolerance='0'"
            " noslip_iterations='2147483647'/><worldbody><geom type='plane' size='1 1 1'/>"
            "<body pos='0 0 .099'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
            "</worldbody></mujoco>",
            3.0,
            Status.TIMEOUT,
            "no answer within 3 s",
        ),
    ],
)
def test_a_model_that_cannot_be_stepped_has_rows_that_say_so(
    tmp_path: Path, text: str, limit_s: float, status: Status, detail: str
) -> None:
    (tmp_path / "m.xml").write_text(text)
    model = str(tmp_path / "m.xml")
    of_model = verified(tmp_path, model, "python_loop_hold", limit_s=limit_s)
    rows = rows_of(of_model).values()
    assert {row.status for row in rows} == {of_model.model_record().status} == {status}
    assert all(detail in row.detail for row in rows)


def test_simulations_that_diverge_are_left_out_and_counted(tmp_path: Path, inline: None) -> None:
    # unstable only where the random start velocity is positive: it leaves a spring-free stretch
    (tmp_path / "edge.xml").write_text(
        "<mujoco><option timestep='.05' gravity='0 0 0'><flag contact='disable'/></option>"
        "<worldbody><body><joint name='a' type='slide' axis='1 0 0'/><geom size='.1'/></body>"
        "<body pos='0 1 0'><joint name='b' type='slide' axis='1 0 0' limited='true' range='-9 0'"
        " solreflimit='-1e7 -1'/><geom size='.1' mass='.01'/></body></worldbody>"
        "<keyframe><key qpos='0 -.0003'/></keyframe></mujoco>"
    )
    of_model = verified(tmp_path, str(tmp_path / "edge.xml"), nbatch=64, nstep=30)
    record = of_model.model_record()
    assert record.diverged is not None
    assert 0 < record.diverged < 64, "the model no longer diverges in part"
    assert record.nbatch == 64 - record.diverged
    assert of_model.agreeing == [0]


def test_a_path_that_did_not_race_says_that_it_was_not_timed(
    tmp_path: Path, contact_file: str, inline: None
) -> None:
    of_model = verified(tmp_path, contact_file, "python_loop_hold")
    first, second = of_model.measurements([0], is_over=True)
    assert first.status == Status.OK
    assert (second.status, second.detail) == (Status.FAILED, "it was not timed")
    assert of_model.measurements([0], is_over=False)[1].status == Status.INTERRUPTED


@pytest.mark.parametrize(
    ("compile_s", "end_s", "detail"),
    [
        (None, math.inf, "give --time-limit 120 or more"),
        (None, 0.0, "give twice the --budget or more"),
        (12.0, math.inf, "no answer, killed"),
    ],
)
def test_a_compiler_that_takes_too_long_bounds_what_the_path_costs(
    tmp_path: Path,
    contact_file: str,
    monkeypatch: pytest.MonkeyPatch,
    compile_s: float | None,
    end_s: float,
    detail: str,
) -> None:
    of_model = children(tmp_path, contact_file, "mjx", limit_s=60.0)

    def run(request: Any, on_record: Any, import_from: Any) -> isolate.Ended:
        if compile_s is not None:
            record = VariantRecord.of("m", request.variant)
            on_record(dataclasses.replace(record, compile_s=compile_s))
        return isolate.Ended(Status.TIMEOUT, "no answer, killed (--time-limit)")

    monkeypatch.setattr(accelerated_measurement, "run", run)
    of_model.run_accelerated(1, end_s)
    row = of_model.measured[1]
    assert (row.status, row.samples_s) == (Status.TIMEOUT, ())
    assert detail in row.detail
