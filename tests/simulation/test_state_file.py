"""Start states of the user's own, as `mjbench.record` returns them."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench.commands.record.recording import record
from mjbench.errors import InputError
from mjbench.simulation import compat, models, state_file, workload_sampling
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.simulation.workload import Workload
from mjbench.simulation.workload_sampling import SampleRequest

CARTPOLE = models.load(models.resolve("cartpole"))
NSTEP = 50


@pytest.fixture
def recorded() -> dict[str, Any]:
    """Return what `record` returns of fifty steps with controls 0, 1, 2, … thousandths."""
    data, control = mujoco.MjData(CARTPOLE), np.arange(float(NSTEP))[:, None] / 1000
    return record(CARTPOLE, data, NSTEP, ["qpos", "qvel", "ctrl", "time"], controls=control)


def save(folder: Path, **arrays: Any) -> Path:
    file = folder / "states.npz"
    np.savez(file, **arrays)
    return file


def draw(file: Path, nbatch: int = 4, nstep: int = 6, hold: int = 1, seed: int = 0) -> Workload:
    request = SampleRequest(nbatch, nstep, hold, seed, StartPlan(file=file))
    sample = workload_sampling.draw(CARTPOLE, request)
    replayed = file.name if "ctrl" in np.load(file).files else None
    assert sample.starts == Starts(0.0, 0.0, file=file.name, controls_file=replayed)
    return sample.workload


def column(drawn: Workload, field: str) -> np.ndarray:
    place = compat.state_columns(CARTPOLE)[field]
    return drawn.initial_state[:, place]


def test_a_simulation_goes_on_as_it_was_recorded(tmp_path: Path, recorded: dict[str, Any]) -> None:
    drawn = draw(save(tmp_path, **recorded))
    data = mujoco.MjData(CARTPOLE)
    for row, control in zip(drawn.initial_state, drawn.control, strict=True):
        compat.set_state(CARTPOLE, data, row)
        step = round(data.time / CARTPOLE.opt.timestep) - 1  # of the recording
        np.testing.assert_allclose(data.qpos, recorded["qpos"][step], atol=1e-12)
        np.testing.assert_array_equal(control, recorded["ctrl"][step + 1 : step + 7])
    assert len(np.unique(column(drawn, "time"))) == 4


def test_a_held_control_is_the_one_of_its_first_step(
    tmp_path: Path, recorded: dict[str, Any]
) -> None:
    drawn = draw(save(tmp_path, **recorded), hold=3)
    step = np.round(column(drawn, "time")[:, 0] / CARTPOLE.opt.timestep).astype(int) - 1
    np.testing.assert_array_equal(drawn.control[:, 1], recorded["ctrl"][step + 4])


def test_rows_follow_from_the_seed(tmp_path: Path, recorded: dict[str, Any]) -> None:
    file = save(tmp_path, **recorded)
    digests = [draw(file, seed=seed).digest() for seed in (1, 1, 2)]
    assert digests[0] == digests[1] != digests[2]


def test_controls_are_not_replayed_across_the_end_of_an_episode(
    tmp_path: Path, recorded: dict[str, Any]
) -> None:
    episodes = {name: np.concatenate([rows[:10], rows[:9]]) for name, rows in recorded.items()}
    times = column(draw(save(tmp_path, **episodes), nbatch=20), "time")
    # of ten rows the first three have seven more: one to step once, and six to replay
    steps = np.round(times / CARTPOLE.opt.timestep).astype(int)
    assert set(steps.ravel()) <= {2, 3, 4}


def test_states_without_controls_get_random_ones(tmp_path: Path, recorded: dict[str, Any]) -> None:
    drawn = draw(save(tmp_path, qpos=recorded["qpos"][:1]), nbatch=3)
    assert len(np.unique(drawn.control)) > 3
    assert np.ptp(column(drawn, "qpos"), axis=0).max() == 0.0


def test_warm_starts_of_the_file_are_kept(tmp_path: Path, recorded: dict[str, Any]) -> None:
    warm = np.full((NSTEP, CARTPOLE.nv), 0.25)
    drawn = draw(save(tmp_path, qpos=recorded["qpos"], qacc_warmstart=warm))
    assert set(column(drawn, "qacc_warmstart").ravel()) == {0.25}
    assert set(map(tuple, column(drawn, "qpos"))) <= set(map(tuple, recorded["qpos"]))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "has no qpos, which start states need; it has nothing"),
        ({"qvel": np.zeros((2, 2))}, "has no qpos, which start states need; it has qvel"),
        ({"qpos": np.zeros((2, 7))}, "the model's qpos has 2 numbers, the file's 7"),
        ({"qpos": np.zeros((0, 2))}, "qpos has no rows"),
        ({"qpos": np.float64(1)}, "qpos has no rows"),
        ({"qpos": np.full((2, 2), np.nan)}, "not finite"),
        ({"qpos": np.full((2, 2), "x")}, "does not hold numbers"),
        ({"qpos": np.zeros((2, 2)), "qvel": np.zeros((3, 2))}, "qvel has 3 rows, qpos has 2"),
        (
            {"qpos": np.zeros((5, 2)), "ctrl": np.zeros((5, 1))},
            "no 8 consecutive rows, which replaying 6 steps takes; give a smaller --nstep",
        ),
    ],
)
def test_states_that_do_not_fit_are_refused(
    tmp_path: Path, arrays: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        draw(save(tmp_path, **arrays))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_single_array_and_a_pickle_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"
    with file.open("wb") as stream:
        np.save(stream, np.zeros((2, 2)))
    with pytest.raises(InputError, match="holds one array"):
        state_file.read(file, CARTPOLE)
    np.savez(file, qpos=np.array([{}]))
    with pytest.raises(InputError, match="cannot read states"):
        state_file.read(file, CARTPOLE)
