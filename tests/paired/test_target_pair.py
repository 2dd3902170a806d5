"""What both targets do: the same simulations, the same work, and none that diverges."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from paired_examples import CARTPOLE, CUBES, INSTALLED

import mjbench
from mjbench.errors import InputError
from mjbench.paired import run_sizes, target_pair
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import StepPair, pair_of
from mjbench.paired.targets import Target
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.simulation import models
from mjbench.simulation.starts import KEYFRAME_SETTLE_S, KEYFRAME_STARTS, StartPlan, Starts
from mjbench.simulation.workload import Product
from mjbench.verification import step_costs


def prepared(pool: WorkerPool, targets: tuple[Target, Target], sizes: Sizes) -> StepPair:
    pair = StepPair(pool, targets, sizes)
    pair.fix_work()
    return pair


def test_models_of_different_size_do_as_many_simulations_each(
    pool: WorkerPool, tmp_path: Path
) -> None:
    file = tmp_path / "other.xml"
    file.write_text(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    other = Target(INSTALLED, models.resolve(str(file)))
    pair = pair_of(pool, (CARTPOLE, other), Sizes(3, starts=KEYFRAME_STARTS))
    pair.prepare()
    launch = pair.launch()
    pair.close()
    assert pair.work.nbatch == 3
    assert pair.work.drift is None
    assert np.min(launch.ns) > 0


def test_simulations_that_diverge_in_one_target_only_are_changed_work(
    pool: WorkerPool, stiff: Target
) -> None:
    candidate = replace(stiff, model_options={"timestep": "0.0025"})
    pair = pair_of(pool, (stiff, candidate), Sizes(8, 13, starts=KEYFRAME_STARTS))
    pair.prepare()
    launch = pair.launch()
    pair.close()
    assert pair.work.diverged[0] == 0
    assert 0 < pair.work.diverged[1] < 8
    assert pair.work.nbatch == 8 - pair.work.diverged[1]
    assert pair.work.changes
    assert np.min(launch.ns) > 0


def test_identical_targets_do_the_same_work_from_the_same_start(pool: WorkerPool) -> None:
    pair = prepared(pool, (CUBES, CUBES), Sizes())
    check = pair.work
    assert check.baseline == check.candidate
    assert check.baseline.contacts > 0
    assert check.drift.one_step == 0.0
    assert check.drift.runs[-1].step == check.nstep
    assert {drift.difference for drift in check.drift.runs} == {0.0}
    assert not check.changes
    assert all(file.is_file() for file in (*pair.models, *pair.workloads))


def test_runs_with_other_stopwatch_readings_do_identical_work(
    pool: WorkerPool, contact_file: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A model's cost is measured when it is first met; later readings change nothing."""
    monkeypatch.setenv(step_costs.FILE_VARIABLE, str(tmp_path / "step-costs.json"))
    target = Target(INSTALLED, models.resolve(contact_file))
    call, readings_s = WorkerProcess.call, iter((1e-5, 1e-4, 3e-6))

    def call_with_another_clock(process: WorkerProcess, task: Any, *arguments: Any) -> Any:
        answer: Any = call(process, task, *arguments)
        if task == Worker.measure_step_cost:
            return replace(answer, step_s=1e-5 * (1 + answer.step_s))
        if task == Worker.measure_settled_cost:
            return next(readings_s)
        return answer

    monkeypatch.setattr(WorkerProcess, "call", call_with_another_clock)
    runs = [prepared(pool, (target, target), Sizes()) for _ in range(2)]
    first, second = runs
    assert next(readings_s) == 1e-4  # measured once
    assert first.work == second.work
    assert first.nsim == second.nsim == target_pair.DRAWN_PER_RUN * first.work.nbatch
    for one, other in zip(first.workloads, second.workloads, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_starts_are_settled_and_the_check_says_so(pool: WorkerPool) -> None:
    for plan, starts in (
        (StartPlan(), Starts(KEYFRAME_SETTLE_S, KEYFRAME_SETTLE_S)),
        (StartPlan(settle_s=0.02), Starts(0.02, 0.02)),
        (KEYFRAME_STARTS, Starts(0.0, 0.0)),
    ):
        sizes = Sizes(nbatch=2, nstep=2, starts=plan)
        pair = prepared(pool, (CUBES, CUBES), sizes)
        assert pair.work.starts == starts
        assert pair.work.candidate_starts is None


def test_a_file_of_states_that_fits_neither_model_is_bad_input(
    pool: WorkerPool, tmp_path: Path
) -> None:
    file = tmp_path / "states.npz"
    np.savez(file, qpos=np.zeros((3, 5)))
    with pytest.raises(InputError, match="the model's qpos has 14 numbers, the file's 5"):
        prepared(pool, (CUBES, CUBES), Sizes(starts=StartPlan(file=file)))


def test_captured_states_are_seen_at_many_places_and_for_as_long_as_they_go_on(
    pool: WorkerPool, tmp_path: Path
) -> None:
    model = models.load(models.resolve("cartpole"))
    data, file = mujoco.MjData(model), tmp_path / "states.npz"
    with mjbench.capture(file, nstep=10):
        mujoco.mj_step(model, data, 2000)
    target = Target(INSTALLED, models.resolve("cartpole"))
    sizes = Sizes(starts=StartPlan(file=file))
    pair = prepared(pool, (target, target), sizes)
    assert pair.work.nstep == 10
    assert pair.nsim >= target_pair.NSTART
    assert pair.work.starts.file == "states.npz"


def _boxes(folder: Path, name: str, option: str = "", sensors: str = "") -> Target:
    """Return a box that falls on a floor, as a file of its own."""
    file = folder / name
    file.write_text(
        f"<mujoco><option {option}</option><worldbody><geom type='plane' size='1 1 1'/>"
        "<body pos='0 0 .3'><freejoint/><geom type='box' size='.1 .1 .1'/>"
        f"<site name='eye' pos='.2 0 0'/></body></worldbody><sensor>{sensors}</sensor></mujoco>"
    )
    return Target(INSTALLED, models.resolve(str(file)))


def test_each_of_two_models_settles_by_itself(pool: WorkerPool, tmp_path: Path) -> None:
    """Weightless, the box of the candidate never lands, wherever the baseline's lies."""
    plain = _boxes(tmp_path, "plain.xml", ">")
    weightless = _boxes(tmp_path, "weightless.xml", "gravity='0 0 0'>")
    check = prepared(pool, (plain, weightless), Sizes()).work
    assert (check.baseline.contacts, check.candidate.contacts) == (4, 0)
    assert check.candidate_starts is not None
    assert check.drift is not None and check.drift.one_step > 0 and check.drift.runs == ()


def test_what_sleeps_in_its_own_run_sleeps_where_it_is_timed(
    pool: WorkerPool, tmp_path: Path
) -> None:
    awake = _boxes(tmp_path, "awake.xml", ">")
    asleep = _boxes(tmp_path, "asleep.xml", "><flag sleep='enable'/>")
    pair = pair_of(pool, (awake, asleep))
    pair.prepare()
    launch = pair.launch()
    pair.close()
    window = pair.work.candidate_starts.window  # type: ignore[union-attr]
    assert window is not None and window.asleep == window.asleep_in_run == 1.0
    assert pair.work.nstep >= target_pair.LEAST_SLEEPING_NSTEP
    assert np.min(launch.ns) > 0


def test_a_time_per_step_is_scaled_to_one_per_simulated_second(
    pool: WorkerPool, tmp_path: Path
) -> None:
    fine, coarse = _boxes(tmp_path, "a.xml", ">"), _boxes(tmp_path, "b.xml", "timestep='0.004'>")
    sizes = Sizes(2, 10, starts=KEYFRAME_STARTS)
    check = prepared(pool, (fine, coarse), sizes).work
    assert check.timesteps_s == (0.002, 0.004)
    assert check.log_scale == pytest.approx(-np.log(2))


def test_sensors_are_work(pool: WorkerPool, tmp_path: Path) -> None:
    seeing = _boxes(tmp_path, "a.xml", ">", "<rangefinder site='eye'/><clock/>")
    blind = _boxes(tmp_path, "b.xml", ">")
    sizes = Sizes(2, 10, starts=KEYFRAME_STARTS)
    check = prepared(pool, (seeing, blind), sizes).work
    assert check.changes == ["sensors 2 → 0", "rays 1 → 0"]


@pytest.mark.parametrize(
    ("sizes", "nthread", "step_s", "expected"),
    [
        (Sizes(), 1, 1e-5, (1, 100)),
        (Sizes(), 1, 1e-6, (10, 100)),
        (Sizes(), 1, 1.0, (1, 1)),
        (Sizes(hold=30), 1, 1e-5, (1, 90)),
        (Sizes(nbatch=4), 1, 1e-5, (4, 25)),
        (Sizes(nbatch=4, nstep=7), 1, 1e-5, (4, 7)),
        (Sizes(nstep=50), 1, 1e-5, (2, 50)),
        (Sizes(), 2, 1e-5, (20, 100)),
        (Sizes(), 2, 1.0, (8, 1)),
    ],
)
def test_a_run_takes_about_a_millisecond_where_the_user_leaves_it_open(
    sizes: Sizes, nthread: int, step_s: float, expected: tuple[int, int]
) -> None:
    assert run_sizes.run_size(sizes, nthread, step_s * (1 - 1e-9)) == expected


def test_a_run_has_no_more_steps_than_there_are_controls_for() -> None:
    def size(sizes: Sizes, most_nstep: int) -> tuple[int, int]:
        return run_sizes.run_size(sizes, 1, 1e-5 * (1 - 1e-9), most_nstep)

    assert size(Sizes(), 20) == (5, 20)
    assert size(Sizes(nbatch=2), 20) == (2, 20)
    assert size(Sizes(nstep=50), 20) == (2, 50)  # as the user asked; drawing refuses it


@pytest.mark.parametrize(
    ("size", "step_s", "hold", "sections"),
    [
        ((4, 100), 2.5e-6, 1, 10),
        ((1, 36), 2.75e-5, 1, 10),
        ((1, 36), 2.75e-5, 12, 3),  # no control is divided
        ((1, 5), 2e-4, 1, 5),  # no step is divided
        ((1, 1), 1.0, 1, 1),
        ((1, 10), 1e-6, 1, 1),
        ((5, 100), 1e-5, 1, run_sizes.MAX_SECTIONS),
        ((5, 110), 1e-5, 1, 1),  # too long
    ],
)
def test_a_section_takes_a_tenth_of_a_millisecond(
    size: tuple[int, int], step_s: float, hold: int, sections: int
) -> None:
    assert run_sizes.RunSize(*size).nsection(step_s, hold) == sections


@pytest.mark.parametrize(
    ("path", "sizes", "can_divide", "is_divided"),
    [
        ("python_loop", Sizes(nbatch=4, nstep=100), True, True),
        ("python_loop", Sizes(nbatch=4, nstep=100), False, False),
        ("rollout", Sizes(nbatch=4, nstep=100), True, False),
        ("python_loop", Sizes(nbatch=4, nstep=100, returns=Product.TRAJECTORY), True, False),
    ],
)
def test_the_run_of_a_plain_loop_is_divided_if_its_states_are_whole(
    pool: WorkerPool,
    monkeypatch: pytest.MonkeyPatch,
    path: str,
    sizes: Sizes,
    can_divide: bool,
    is_divided: bool,
) -> None:
    call = WorkerProcess.call

    def call_another_build(process: WorkerProcess, task: Any, *arguments: Any) -> Any:
        answer: Any = call(process, task, *arguments)
        if task == Worker.observe:
            assert answer.can_divide == (arguments[1] > 1)
            return replace(answer, can_divide=answer.can_divide and can_divide)
        return answer

    monkeypatch.setattr(WorkerProcess, "call", call_another_build)
    target = replace(CARTPOLE, path=path)
    pair = prepared(pool, (target, target), sizes)
    assert (pair.nsection > 1) == is_divided


def test_a_run_is_not_divided_where_a_section_of_the_faster_target_would_be_too_short(
    pool: WorkerPool,
) -> None:
    humanoid = Target(CARTPOLE.release, models.resolve("humanoid"))
    both = [(humanoid, humanoid), (CARTPOLE, humanoid), (humanoid, CARTPOLE)]
    sizes = Sizes(starts=KEYFRAME_STARTS)
    pairs = [prepared(pool, each, sizes) for each in both]
    assert [each.nsection for each in pairs] == [10, 1, 1]


@pytest.mark.parametrize(("size", "count"), [(8, 1), (16, 2), (7, 3), (5, 5), (1, 1)])
def test_all_simulations_are_drawn_equally_often_and_none_twice_at_once(
    size: int, count: int
) -> None:
    counts = [0] * size
    for _ in range(40):
        before = list(counts)
        drawn = target_pair.draw_least(counts, count)
        assert len(set(drawn)) == count
        assert [n + (i in drawn) for i, n in enumerate(before)] == counts
        assert max(counts) - min(counts) <= 1


def test_simulations_are_drawn_in_random_order() -> None:
    assert len({tuple(target_pair.draw_least([0] * 8, 8)) for _ in range(20)}) > 15
