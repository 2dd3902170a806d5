"""Controls of the user's own: which simulation takes which, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.simulation import given_controls, models, workload_sampling
from mjbench.simulation.starts import KEYFRAME_STARTS, StartPlan
from mjbench.simulation.workload_sampling import Sample, SampleRequest

CARTPOLE = models.load(models.resolve("cartpole"))
# Three sequences of four controls: 0.00, 0.01, … and 0.10, 0.11, … and 0.20, ….
SEQUENCES = (0.1 * np.arange(3)[:, None] + 0.01 * np.arange(4))[:, :, None]


def save(folder: Path, **arrays: Any) -> Path:
    file = folder / "actions.npz"
    np.savez(file, **arrays)
    return file


def draw(
    file: Path,
    nbatch: int = 5,
    nstep: int = 4,
    hold: int = 1,
    states: Path | None = None,
    may_shorten: bool = False,
    settle_s: float | None = 0.0,
) -> Sample:
    plan = StartPlan(None if states else settle_s, states, file)
    request = SampleRequest(nbatch, nstep, hold, starts=plan, may_shorten=may_shorten)
    return workload_sampling.draw(CARTPOLE, request)


def test_every_simulation_takes_one_sequence_from_its_first_control(tmp_path: Path) -> None:
    for arrays in ({"ctrl": SEQUENCES[1]}, {"actions": SEQUENCES[1]}, {"ctrl": SEQUENCES[1:2]}):
        for settle_s in (0.0, 0.01):
            sample = draw(save(tmp_path, **arrays), nstep=3, settle_s=settle_s)
            assert sample.starts.controls_file == "actions.npz"
            np.testing.assert_array_equal(
                sample.workload.control, np.tile(SEQUENCES[1, :3], (5, 1, 1))
            )


def test_simulations_take_several_sequences_in_turn(tmp_path: Path) -> None:
    sample = draw(save(tmp_path, ctrl=SEQUENCES))
    np.testing.assert_array_equal(sample.workload.control, SEQUENCES[[0, 1, 2, 0, 1]])


def test_each_control_is_held(tmp_path: Path) -> None:
    workload = draw(save(tmp_path, ctrl=SEQUENCES), nstep=8, hold=2).workload
    assert workload.ncontrol == 4
    np.testing.assert_array_equal(workload.step_control[1, :, 0], np.repeat(SEQUENCES[1, :, 0], 2))


def test_an_npy_file_holds_controls_too(tmp_path: Path) -> None:
    np.save(tmp_path / "actions.npy", SEQUENCES)
    assert given_controls.read(tmp_path / "actions.npy", CARTPOLE).most_nstep(5) == 20


def test_starts_are_those_of_ordinary_controls(tmp_path: Path) -> None:
    ordinary = workload_sampling.draw(
        CARTPOLE, SampleRequest(5, 4, starts=KEYFRAME_STARTS)
    ).workload
    own = draw(save(tmp_path, ctrl=SEQUENCES)).workload
    np.testing.assert_array_equal(own.initial_state, ordinary.initial_state)


def test_a_sequence_for_each_state_belongs_to_that_state(tmp_path: Path) -> None:
    states = tmp_path / "states.npz"
    np.savez(states, qpos=[[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]], qacc_warmstart=np.zeros((3, 2)))
    workload = draw(save(tmp_path, ctrl=SEQUENCES), nbatch=3, states=states).workload
    x = workload.initial_state[:, 1]
    assert sorted(x) == [0.0, 0.1, 0.2]
    np.testing.assert_allclose(workload.control[:, 0, 0], x)
    # and in turn where they are not as many
    np.savez(states, qpos=[[0.0, 0.0], [0.1, 0.0]], ctrl=[[9.0], [9.0]])
    workload = draw(save(tmp_path, ctrl=SEQUENCES), nbatch=2, states=states).workload
    np.testing.assert_array_equal(workload.control, SEQUENCES[:2])


def test_more_steps_than_controls_are_refused_or_fewer_taken(tmp_path: Path) -> None:
    file = save(tmp_path, ctrl=SEQUENCES)
    with pytest.raises(InputError) as caught:
        draw(file, nstep=10, hold=2)
    assert str(caught.value) == (
        "actions.npz has 4 controls, each held for 2 steps, and not for 10 steps: give --nstep 8 at"
        " most"
    )
    assert draw(file, nstep=10, hold=2, may_shorten=True).workload.nstep == 8
    assert draw(file, nstep=2, may_shorten=True).workload.nstep == 2


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "actions.npz has neither ctrl nor actions; it has nothing"),
        ({"action": SEQUENCES}, "actions.npz has neither ctrl nor actions; it has action"),
        ({"ctrl": np.zeros(4)}, "shape (4,); expected (ncontrol, nu), or (nsequence, "),
        ({"ctrl": np.zeros((4, 2))}, "the model has 1 controls, the file's have 2 numbers"),
        ({"ctrl": np.zeros((0, 1))}, "actions.npz holds no controls"),
        ({"ctrl": np.full((4, 1), np.nan)}, "actions.npz holds numbers that are not finite"),
        ({"ctrl": np.full((4, 1), np.inf)}, "actions.npz holds numbers that are not finite"),
        ({"ctrl": np.full((4, 1), "x")}, "actions.npz does not hold numbers"),
        ({"ctrl": np.full((4, 1), 1j)}, "actions.npz does not hold numbers"),
        ({"ctrl": np.array([[{}]])}, "cannot read controls from actions.npz"),
        (
            {"ctrl": SEQUENCES[0], "mjbench_capture": np.array("{}")},
            "actions.npz holds captured states: give it to --states",
        ),
    ],
)
def test_controls_that_do_not_fit_are_refused(
    tmp_path: Path, arrays: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        given_controls.read(save(tmp_path, **arrays), CARTPOLE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"ctrl", b"PK\x03\x04 cut short", b"\x93NUMPY\x01\x00"])
def test_a_file_that_holds_no_array_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "actions.npz"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"cannot read controls from actions\.npz"):
        given_controls.read(file, CARTPOLE)


def test_a_model_without_controls_takes_none(tmp_path: Path) -> None:
    cubes = models.load(models.resolve("cube_table"))
    with pytest.raises(InputError, match="the model has 0 controls, the file's have 0 numbers"):
        given_controls.read(save(tmp_path, ctrl=np.zeros((3, 0))), cubes)
