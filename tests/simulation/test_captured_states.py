"""Files of captured states: which rows are replayed, which models they fit, what is refused."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.simulation import capture_header, compat, models, state_file, workload_sampling
from mjbench.simulation.capture_header import ARRAY, SEGMENT_ARRAY, CaptureHeader, ModelLayout
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.starts import StartPlan
from mjbench.simulation.workload_sampling import Sample, SampleRequest

CARTPOLE = models.load(models.resolve("cartpole"))
SPEC = compat.INTEGRATION


def header(**changes: Any) -> CaptureHeader:
    values = {
        "format": capture_header.FORMAT,
        "model": capture_header.model_name(CARTPOLE),
        "layout": ModelLayout.of(CARTPOLE),
        "digests": (model_digest(CARTPOLE),),
        "mujoco_version": mujoco.__version__,
        "timestep_s": float(CARTPOLE.opt.timestep),
        "steps": 100,
    }
    return CaptureHeader(**{**values, **changes})


def save(folder: Path, lengths: list[int], **changes: Any) -> Path:
    """Write segments of so many states; in segment i the cart is at i, controls are i + 0.01 k.

    All times are 0, as where the program sets them.
    """
    columns = compat.state_columns(CARTPOLE, SPEC)
    segments = [np.zeros((length, compat.state_size(CARTPOLE, SPEC))) for length in lengths]
    for i, segment in enumerate(segments):
        segment[:, columns["qpos"].start] = i
        segment[:, columns["ctrl"]] = i + 0.01 * np.arange(len(segment))[:, None]
    file = folder / "states.npz"
    with file.open("wb") as stream:
        state_file.write(stream, header(**changes), columns, segments)
    return file


def draw(file: Path, nbatch: int = 6, nstep: int = 4, **request: Any) -> Sample:
    plan = StartPlan(file=file)
    return workload_sampling.draw(CARTPOLE, SampleRequest(nbatch, nstep, starts=plan, **request))


def edit(file: Path, **arrays: Any) -> None:
    with np.load(file) as stored:
        np.savez(file, **{**dict(stored), **arrays})


def test_simulations_replay_the_controls_of_one_segment_whatever_its_times_are(
    tmp_path: Path,
) -> None:
    sample = draw(save(tmp_path, [5, 3, 5, 1, 7]), nbatch=5)
    assert sample.starts.file == sample.starts.controls_file == "states.npz"
    controls = sample.workload.control[:, :, 0]
    # in segments of five, five and seven states are one, one and three with four more after them
    np.testing.assert_allclose(np.diff(controls, axis=1), 0.01)
    firsts = sorted(np.round(controls[:, 0], 2))
    assert firsts == [0.01, 2.01, 4.01, 4.02, 4.03]
    columns = compat.state_columns(CARTPOLE, SPEC)
    x = sample.workload.initial_state[:, columns["qpos"].start]
    np.testing.assert_array_equal(x, np.floor(controls[:, 0]))


def test_a_workload_is_as_long_as_leaves_enough_starts(tmp_path: Path) -> None:
    def nstep(lengths: list[int], nbatch: int, hold: int = 1) -> int:
        file = save(tmp_path, lengths)
        sample = draw(file, nbatch, 200 // hold * hold, hold=hold, may_shorten=True)
        return sample.workload.nstep

    assert nstep([101] * 20, 20) == 100  # each window is a start
    assert nstep([101] * 20, 60) == 98  # three starts in each
    assert nstep([1001], 64) == 200  # no longer than was asked for
    assert nstep([101], 1000) == 51  # half of all states can be starts
    assert nstep([101] * 20 + [2] * 50, 20) == 100  # a few ends of episodes do not matter
    assert nstep([2] * 300 + [101], 20) == 1  # one long segment is not where the program was
    assert nstep([101] * 20, 20, hold=30) == 120  # the last control is that of one step
    assert nstep([3] * 20, 20, hold=5) == 5


def test_a_segment_that_is_too_short_is_refused_where_the_user_chose(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no 5 consecutive rows, which replaying 4 steps takes"):
        draw(save(tmp_path, [4, 4]))


def test_a_model_that_differs_a_little_is_noted(tmp_path: Path) -> None:
    file = save(tmp_path, [9])
    assert not draw(file).starts.is_other_model
    heavier = models.load(models.resolve("cartpole"))
    heavier.body_mass[1] *= 2
    request = SampleRequest(2, 2, starts=StartPlan(file=file))
    assert workload_sampling.draw(heavier, request).starts.is_other_model
    file = save(tmp_path, [9], digests=(model_digest(CARTPOLE), model_digest(heavier)))
    assert not workload_sampling.draw(heavier, request).starts.is_other_model


def test_inputs_that_the_program_set_are_noted(tmp_path: Path) -> None:
    file = save(tmp_path, [9], changed_inputs=("qacc_warmstart", "xfrc_applied"))
    assert draw(file).starts.held_inputs == ("xfrc_applied",)


def test_states_of_another_model_are_refused_in_one_line(tmp_path: Path) -> None:
    file = save(tmp_path, [9])
    humanoid = models.load(models.resolve("humanoid"))
    with pytest.raises(InputError) as caught:
        state_file.read(file, humanoid)
    assert str(caught.value) == (
        "states.npz holds states of another model, cartpole: nq 2, nv 2, nu 1, na 0; this one has"
        " nq 28, nv 27, nu 21, na 0"
    )
    hinges = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='a'/><joint axis='0 1 0'/><geom size='.1'/></body>"
        "</worldbody><actuator><motor joint='a'/></actuator></mujoco>"
    )
    with pytest.raises(InputError, match="its joints are of other types than this one's"):
        state_file.read(file, hinges)


def without(*keys: str) -> Callable[[dict[str, Any]], Any]:
    return lambda values: {key: value for key, value in values.items() if key not in keys}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: "text", "does not say where its states come from"),
        (lambda values: [], "does not say where its states come from"),
        (lambda values: {**values, "format": 99}, "has format 99 of captured states, and this"),
        (lambda values: {**values, "format": "x"}, "does not say where its states come from"),
        (lambda values: {**values, "format": float("inf")}, "does not say where its states"),
        (lambda values: {**values, "digests": 3}, "does not say where its states come from"),
        (lambda values: {**values, "layout": {"nq": 2}}, "does not say where its states come from"),
        (without("timestep_s"), "does not say where its states come from"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], Any], message: str
) -> None:
    file = save(tmp_path, [9])
    with np.load(file) as stored:
        values = json.loads(str(stored[ARRAY]))
    edit(file, **{ARRAY: np.array(json.dumps(change(values)))})
    with pytest.raises(InputError, match=message) as caught:
        state_file.read(file, CARTPOLE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({ARRAY: np.zeros(3)}, "does not say where its states come from"),
        ({ARRAY: np.array({})}, "cannot read states"),
        ({SEGMENT_ARRAY: np.zeros(3, int)}, "does not say which rows are consecutive steps"),
        ({SEGMENT_ARRAY: np.zeros(9)}, "does not say which rows are consecutive steps"),
        ({SEGMENT_ARRAY: np.arange(9)[::-1]}, "does not say which rows are consecutive steps"),
    ],
)
def test_arrays_that_make_no_sense_are_refused(
    tmp_path: Path, arrays: dict[str, Any], message: str
) -> None:
    file = save(tmp_path, [9])
    edit(file, **arrays)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        state_file.read(file, CARTPOLE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_that_was_cut_short_is_refused(tmp_path: Path, share: float) -> None:
    file = save(tmp_path, [9])
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"cannot read states from states\.npz"):
        state_file.read(file, CARTPOLE)


def test_control_characters_of_a_model_s_name_do_not_reach_the_terminal(tmp_path: Path) -> None:
    file = save(tmp_path, [9], model="\x1b[31mred\nline")
    with pytest.raises(InputError) as caught:
        state_file.read(file, models.load(models.resolve("humanoid")))
    assert str(caught.value).isprintable()
