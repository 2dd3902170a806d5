"""States of a running program: it does what it does without, and what is kept can be replayed."""

import contextlib
import os
import re
import subprocess
import sys
import threading
import types
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import mjbench
from mjbench.commands.record import captured_steps
from mjbench.commands.record.capture import Capture, Captured
from mjbench.errors import InputError, MachineError
from mjbench.simulation import compat, engine_functions, models, state_file
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.state_file import RecordedStates

Step = Callable[[mujoco.MjModel, mujoco.MjData], object]
SPEC = compat.INTEGRATION
HUMANOID = models.load(models.resolve("humanoid"))
CARTPOLE = models.load(models.resolve("cartpole"))
# A ball that a program pushes about by a force, between mocap walls.
BALL = """<mujoco model="ball"><worldbody>
  <body mocap="true" pos="0 0 -1"><geom type="plane" size="1 1 1"/></body>
  <body><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>"""


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    row = np.empty(compat.state_size(model, SPEC))
    compat.get_state(model, data, row, SPEC)
    return row


def one_by_one(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_step(model, data)


def by_keywords(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_step(m=model, d=data, nstep=3)


def five_at_once(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_step(model, data, 5)


def in_two_halves(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """As dm_control does."""
    mujoco.mj_step2(model, data)
    mujoco.mj_step(model, data, 2)
    mujoco.mj_step1(model, data)


def program(model: mujoco.MjModel, step: Step, ncall: int = 60) -> Iterator[np.ndarray]:
    """Yield the states of a program with random controls and an episode of forty calls."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_forward(model, data)
    for i in range(ncall):
        if i % 40 == 39:
            mujoco.mj_resetData(model, data)
            data.qpos[:] += 0.01 * rng.standard_normal(model.nq)
            mujoco.mj_forward(model, data)
        data.ctrl[:] = 0.1 * rng.standard_normal(model.nu)
        step(model, data)
        yield state_of(model, data)


def captured_states(capture: Capture, model: mujoco.MjModel) -> RecordedStates:
    assert capture.result is not None and capture.result.file is not None
    return state_file.read(capture.result.file, model)


def rows(recorded: RecordedStates, model: mujoco.MjModel) -> np.ndarray:
    """Return the states of a file as rows of mjSTATE_INTEGRATION."""
    columns = compat.state_columns(model, SPEC)
    states = np.zeros((recorded.nrow, compat.state_size(model, SPEC)))
    for field, values in recorded.fields.items():
        states[:, columns[field]] = values
    return states


@pytest.mark.parametrize("step", [one_by_one, by_keywords, five_at_once, in_two_halves])
@pytest.mark.parametrize("max_states", [20, 10_000])
def test_a_program_does_the_same_and_what_is_kept_is_replayed_to_the_last_bit(
    tmp_path: Path, step: Step, max_states: int
) -> None:
    without = list(program(HUMANOID, step))
    with mjbench.capture(tmp_path / "states.npz", max_states=max_states, nstep=8) as capture:
        states = list(program(HUMANOID, step))
    np.testing.assert_array_equal(np.array(states), np.array(without))
    recorded = captured_states(capture, HUMANOID)
    assert recorded.nrow <= max_states
    recorded_states, data = rows(recorded, HUMANOID), mujoco.MjData(HUMANOID)
    for i in range(recorded.nrow - 1):
        if recorded.segment[i] != recorded.segment[i + 1]:
            continue
        compat.set_state(HUMANOID, data, recorded_states[i], SPEC)
        data.ctrl[:] = recorded.fields["ctrl"][i + 1]
        mujoco.mj_step(HUMANOID, data)
        np.testing.assert_array_equal(state_of(HUMANOID, data), recorded_states[i + 1])


def test_all_steps_of_a_short_program_are_kept(tmp_path: Path) -> None:
    with mjbench.capture(tmp_path / "states.npz") as capture:
        states = list(program(HUMANOID, one_by_one))
    recorded = captured_states(capture, HUMANOID)
    # a segment begins with the state before its first step; the reset begins another
    assert np.bincount(recorded.segment).tolist() == [40, 22]
    recorded_states = rows(recorded, HUMANOID)
    np.testing.assert_array_equal(np.delete(recorded_states, [0, 40], axis=0), np.array(states))
    assert capture.result == Captured(
        file=tmp_path / "states.npz",
        model="humanoid",
        model_digest=model_digest(HUMANOID),
        variants=1,
        states=62,
        windows=1,
        steps=60,
        simulated_s=pytest.approx(60 * HUMANOID.opt.timestep),
        unseen=capture.result.unseen if capture.result else (),
    )
    assert str(capture.result) == "62 states from 1 window of 60 steps (0.12 s) of humanoid"


def test_random_numbers_of_the_program_are_its_own(tmp_path: Path) -> None:
    import random

    random.seed(1)
    np.random.seed(1)
    states = random.getstate(), np.random.get_state()[1].tolist()
    with mjbench.capture(tmp_path / "states.npz", max_states=4, nstep=1):
        list(program(CARTPOLE, one_by_one))
    assert (random.getstate(), np.random.get_state()[1].tolist()) == states


def test_exceptions_are_those_of_the_program_and_the_states_before_are_kept(tmp_path: Path) -> None:
    capture = mjbench.capture(tmp_path / "states.npz")
    with pytest.raises(KeyboardInterrupt), capture:
        list(program(CARTPOLE, one_by_one, 7))
        raise KeyboardInterrupt
    assert captured_states(capture, CARTPOLE).nrow == 8


@pytest.mark.parametrize(
    "arguments", [(), (1,), (CARTPOLE,), (CARTPOLE, 2), (1, 2, 3, 4), (CARTPOLE, None, "x")]
)
def test_wrong_arguments_are_refused_by_mujoco_itself(
    tmp_path: Path, arguments: tuple[Any, ...]
) -> None:
    with pytest.raises(TypeError) as expected:
        mujoco.mj_step(*arguments)
    original = mujoco.mj_step
    with (
        warnings.catch_warnings(action="ignore"),
        mjbench.capture(tmp_path / "states.npz"),
        pytest.raises(TypeError) as caught,
    ):
        mujoco.mj_step(*arguments)
    assert str(caught.value) == str(expected.value)
    assert mujoco.mj_step is original


def test_mj_step2_takes_one_step_only(tmp_path: Path) -> None:
    with (
        warnings.catch_warnings(action="ignore"),
        mjbench.capture(tmp_path / "states.npz"),
        pytest.raises(TypeError, match="incompatible function arguments"),
    ):
        mujoco.mj_step2(CARTPOLE, mujoco.MjData(CARTPOLE), nstep=2)


def test_a_callback_that_raises_ends_a_segment_and_not_the_capture(tmp_path: Path) -> None:
    data, calls = mujoco.MjData(CARTPOLE), 0

    def control(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        nonlocal calls
        calls += 1
        if calls == 5:
            raise RuntimeError("the program's own")

    capture = mjbench.capture(tmp_path / "states.npz")
    mujoco.set_mjcb_control(control)
    try:
        with capture:
            for _ in range(9):
                with contextlib.suppress(RuntimeError):
                    mujoco.mj_step(CARTPOLE, data)
    finally:
        mujoco.set_mjcb_control(None)
    assert calls == 9
    assert captured_states(capture, CARTPOLE).nrow >= 8


def test_inputs_that_the_program_sets_between_steps_are_named(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    with mjbench.capture(tmp_path / "states.npz") as capture:
        for i in range(6):
            data.xfrc_applied[2, 0] = i
            data.mocap_pos[0, 2] = -1 - 0.01 * i
            mujoco.mj_step(model, data)
    assert capture.result.changed_inputs == ("mocap_pos", "xfrc_applied")
    assert "it sets mocap_pos, xfrc_applied between steps" in str(capture.result)
    recorded = captured_states(capture, model)
    assert len(set(recorded.segment)) == 1
    np.testing.assert_array_equal(recorded.fields["xfrc_applied"][:, 12], [0, 0, 1, 2, 3, 4, 5])


def test_fields_that_are_always_zero_are_left_out(tmp_path: Path) -> None:
    with mjbench.capture(tmp_path / "states.npz") as capture:
        list(program(CARTPOLE, one_by_one, 3))
    assert "xfrc_applied" not in captured_states(capture, CARTPOLE).fields


def test_the_model_that_is_stepped_most_is_captured_and_others_are_named(tmp_path: Path) -> None:
    def both() -> None:
        list(program(CARTPOLE, one_by_one, 4))
        list(program(HUMANOID, one_by_one, 3))

    file = tmp_path / "states.npz"
    for chosen, name, other in ((None, "cartpole", "humanoid"), (HUMANOID, "humanoid", "cartpole")):
        with mjbench.capture(file, model=chosen) as capture:
            both()
        result = capture.result
        assert (result.model, [o.name for o in result.others]) == (name, [other])
        assert result.steps + result.others[0].steps == 7


def test_one_of_several_simulations_can_be_chosen(tmp_path: Path) -> None:
    datas = [mujoco.MjData(CARTPOLE) for _ in range(3)]
    with mjbench.capture(tmp_path / "states.npz", data=datas[1]) as capture:
        for i in range(5):
            for k, data in enumerate(datas):
                data.ctrl[:] = k
                mujoco.mj_step(CARTPOLE, data)
            assert i < 5
    recorded = captured_states(capture, CARTPOLE)
    assert recorded.fields["ctrl"].tolist() == [[1.0]] * 6
    assert capture.result is not None and capture.result.others[0].steps == 10


def test_simulations_that_take_turns_are_not_mixed_up(tmp_path: Path) -> None:
    datas = [mujoco.MjData(CARTPOLE) for _ in range(3)]
    for k, data in enumerate(datas):
        data.qpos[0] = k
    with mjbench.capture(tmp_path / "states.npz", nstep=4) as capture:
        for _ in range(30):
            for data in datas:
                mujoco.mj_step(CARTPOLE, data)
    recorded = captured_states(capture, CARTPOLE)
    for segment in np.unique(recorded.segment):
        assert len(set(np.round(recorded.fields["qpos"][recorded.segment == segment, 0]))) == 1
    assert recorded.nrow >= 30


def test_a_model_that_is_compiled_anew_or_changed_is_one_model(tmp_path: Path) -> None:
    with mjbench.capture(tmp_path / "states.npz", nstep=3) as capture:
        for episode in range(4):
            model = mujoco.MjModel.from_xml_string(BALL)
            model.body_mass[2] += episode // 2
            data = mujoco.MjData(model)
            mujoco.mj_step(model, data, 3)
    assert (capture.result.steps, capture.result.variants) == (12, 2)
    assert "the program changes its model: 2 variants of it" in str(capture.result)


def test_a_simulation_that_the_program_drops_is_dropped(tmp_path: Path) -> None:
    import gc
    import weakref

    with mjbench.capture(tmp_path / "states.npz"):
        model = mujoco.MjModel.from_xml_string(BALL)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        references = [weakref.ref(model), weakref.ref(data)]
        del model, data
        gc.collect()
        assert [reference() for reference in references] == [None, None]


def test_an_interrupt_when_a_model_is_dropped_reaches_the_program(tmp_path: Path) -> None:
    """The signal comes in a callback of C before that of the capture."""
    import _thread
    import functools
    import weakref

    with mjbench.capture(tmp_path / "states.npz"):
        model = mujoco.MjModel.from_xml_string(BALL)
        mujoco.mj_step(model, mujoco.MjData(model))
        interrupt = functools.partial(next, iter(_thread.interrupt_main, 0))
        reference = weakref.ref(model, interrupt)
        with pytest.raises(KeyboardInterrupt):
            del model
            for _ in range(2):  # between turns of a loop, Python handles signals
                pass
        assert reference() is None


def test_a_window_ends_when_its_simulation_is_no_longer_stepped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(captured_steps, "_PATIENCE_NSTEP", 20)
    first, second = mujoco.MjData(CARTPOLE), mujoco.MjData(CARTPOLE)
    with mjbench.capture(tmp_path / "states.npz", nstep=10) as capture:
        mujoco.mj_step(CARTPOLE, first)
        for _ in range(50):
            mujoco.mj_step(CARTPOLE, second)
    assert capture.result.windows > 1


def test_states_that_are_large_are_fewer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nstate = compat.state_size(HUMANOID, SPEC)
    monkeypatch.setattr(captured_steps, "MAX_BYTES", 30 * 8 * nstate)
    with mjbench.capture(tmp_path / "states.npz", nstep=9) as capture:
        list(program(HUMANOID, one_by_one, 200))
    assert 10 <= captured_states(capture, HUMANOID).nrow <= 30


def test_states_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    with mjbench.capture(tmp_path / "states.npz") as capture:
        mujoco.mj_step(model, data, 3)
        data.qvel[0] = np.inf
        mujoco.mj_step(model, data, 2)  # the engine starts anew
    recorded = captured_states(capture, model)
    assert np.isfinite(recorded.fields["qvel"]).all()


def test_steps_on_several_threads_are_captured(tmp_path: Path) -> None:
    datas = [mujoco.MjData(HUMANOID) for _ in range(4)]

    def simulate(data: mujoco.MjData) -> None:
        for _ in range(50):
            mujoco.mj_step(HUMANOID, data)

    with mjbench.capture(tmp_path / "states.npz", nstep=10) as capture:
        threads = [threading.Thread(target=simulate, args=(data,)) for data in datas]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    expected = mujoco.MjData(HUMANOID)
    simulate(expected)
    for data in datas:
        np.testing.assert_array_equal(state_of(HUMANOID, data), state_of(HUMANOID, expected))
    assert captured_states(capture, HUMANOID).nrow > 10


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_child_writes_nothing(tmp_path: Path) -> None:
    script = tmp_path / "program.py"
    script.write_text(
        "import os, mujoco, mjbench\n"
        "model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><body><freejoint/>"
        '<geom size=".1"/></body></worldbody></mujoco>\')\n'
        "data = mujoco.MjData(model)\n"
        "with mjbench.capture('states.npz') as capture:\n"
        "    mujoco.mj_step(model, data)\n"
        "    child = os.fork()\n"
        "    mujoco.mj_step(model, data, 1 if child else 50)\n"
        "    if child: os.waitpid(child, 0)\n"
        "print(capture.result and capture.result.states)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(mjbench.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["None", "3"], done.stderr


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# -- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "message"),
    [("none/states.npz", "No such file or directory"), ("folder.npz", "Is a directory")],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_program_runs(
    tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(MachineError, match=message), mjbench.capture(tmp_path / name):
        pytest.fail("the block ran")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"file": "states.csv"}, "states.csv: a file of states ends in .npz"),
        ({"file": "a.npz", "save_model": "a.xml"}, "a.xml: a compiled model ends in .mjb"),
        ({"file": "a.npz", "max_states": 1}, "max_states must be a whole number of at least 2"),
        ({"file": "a.npz", "nstep": 0}, "nstep must be a whole number of at least 1, not 0"),
        ({"file": "a.npz", "nstep": 1.5}, "nstep must be a whole number of at least 1, not 1.5"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        mjbench.capture(**arguments)


def test_an_earlier_file_stays_where_no_step_is_seen(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"
    file.write_text("of last week")
    with pytest.warns(RuntimeWarning, match="no step seen"), mjbench.capture(file):
        pass
    assert file.read_text() == "of last week"
    assert names(tmp_path) == ["states.npz"]


def test_a_module_that_bound_a_stepping_function_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    early = types.ModuleType("early_binder")
    exec("from mujoco import mj_step", vars(early))
    monkeypatch.setitem(sys.modules, "early_binder", early)
    with (
        pytest.warns(RuntimeWarning, match=r"no step seen: early_binder bound a stepping function"),
        mjbench.capture(tmp_path / "states.npz") as capture,
    ):
        vars(early)["mj_step"](CARTPOLE, mujoco.MjData(CARTPOLE))
    assert (capture.result.file, capture.result.unseen) == (None, ("early_binder",))


def test_the_model_is_saved_as_it_was_before_its_first_step(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    digest, file = model_digest(model), tmp_path / "ball.mjb"
    with mjbench.capture(tmp_path / "states.npz", save_model=file) as capture:
        list(program(CARTPOLE, one_by_one, 2))
        mujoco.mj_step(model, mujoco.MjData(model), 5)
        model.body_mass[2] *= 2
    assert capture.result is not None and capture.result.model_file == file
    saved = models.load(models.resolve(str(file)))
    assert model_digest(saved) == digest == capture.result.model_digest
    assert names(tmp_path) == ["ball.mjb", "states.npz"]


@pytest.mark.parametrize(
    "error", [mujoco.FatalError("engine error"), MemoryError(), OSError(28, "No space left")]
)
def test_a_model_that_cannot_be_saved_is_reported_when_the_block_ends_and_states_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def refuse(*arguments: Any) -> None:
        raise error

    monkeypatch.setattr(mujoco, "mj_saveModel", refuse)
    states, model_file = tmp_path / "states.npz", tmp_path / "cartpole.mjb"
    with (
        pytest.raises(MachineError, match=f"cannot save {model_file}: "),
        mjbench.capture(states, save_model=model_file),
    ):
        list(program(CARTPOLE, one_by_one, 2))
    assert state_file.read(states, CARTPOLE).nrow == 3
    assert names(tmp_path) == ["states.npz"]


def test_compiled_models_wait_in_files_and_not_in_the_memory_of_the_program() -> None:
    recorder = captured_steps.StepRecorder(10, 1, with_mjb=True)
    recorder.wrappers()["mj_step"](mujoco.mj_step)(CARTPOLE, mujoco.MjData(CARTPOLE))
    (recorded,) = recorder.models()
    assert os.fstat(recorded.mjb.fileno()).st_size == mujoco.mj_sizeModel(CARTPOLE)
    recorder.close()
    assert recorded.mjb.closed


def test_a_capture_that_could_not_begin_can_begin_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = mjbench.capture(tmp_path / "states.npz")
    with monkeypatch.context() as broken:
        broken.setattr(engine_functions, "replaced", None)
        with pytest.raises(TypeError), capture:
            pytest.fail("the block ran")
    with capture:
        list(program(CARTPOLE, one_by_one, 2))
    assert capture.result is not None and capture.result.steps == 2


def test_a_disk_that_fills_up_is_reported_when_the_block_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(state_file, "write", full)
    file = tmp_path / "states.npz"
    with pytest.raises(MachineError, match="No space left on device"), mjbench.capture(file):
        list(program(CARTPOLE, one_by_one, 2))
    with (
        pytest.warns(RuntimeWarning, match="No space left on device"),
        pytest.raises(ZeroDivisionError),
        mjbench.capture(file),
    ):
        list(program(CARTPOLE, one_by_one, 2))
        raise ZeroDivisionError
    assert names(tmp_path) == []


def test_the_file_is_in_the_folder_where_the_block_began_wherever_the_program_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    capture = mjbench.capture("states.npz")
    for folder in (tmp_path, tmp_path / "elsewhere"):
        monkeypatch.chdir(folder)
        with capture:
            list(program(CARTPOLE, one_by_one, 2))
            os.chdir("/")
        assert capture.result is not None and capture.result.file == folder / "states.npz"
        assert (folder / "states.npz").is_file()


def test_a_decorated_function_is_captured_at_each_call(tmp_path: Path) -> None:
    file = tmp_path / "states.npz"

    @mjbench.capture(file)
    def train(ncall: int) -> int:
        return len(list(program(CARTPOLE, one_by_one, ncall)))

    for ncall in (3, 5):
        assert train(ncall) == ncall
        assert state_file.read(file, CARTPOLE).nrow == ncall + 1


def test_one_capture_cannot_run_inside_itself(tmp_path: Path) -> None:
    capture = mjbench.capture(tmp_path / "states.npz")
    with capture:
        list(program(CARTPOLE, one_by_one, 2))
        with pytest.raises(InputError, match="has begun already"), capture:
            pass
    assert capture.result is not None and capture.result.steps == 2


# -- programs of others ---------------------------------------------------------------------------


def test_a_gymnasium_environment_does_the_same_while_it_is_captured(tmp_path: Path) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    pytest.importorskip("imageio", reason="gymnasium's MuJoCo environments import it")

    def observations() -> np.ndarray:
        environment = gymnasium.make("Humanoid-v5")
        environment.reset(seed=0)
        environment.action_space.seed(0)
        steps = [environment.step(environment.action_space.sample()) for _ in range(20)]
        return np.array([step[0] for step in steps])

    without = observations()
    with mjbench.capture(tmp_path / "states.npz") as capture:
        np.testing.assert_array_equal(observations(), without)
    assert capture.result is not None and capture.result.steps == 100
