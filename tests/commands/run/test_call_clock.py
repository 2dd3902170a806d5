"""The call clock counts calls by the line that makes them, and changes none of them."""

import copy
import itertools
import multiprocessing.process
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from hook_clock import Clock

from mjbench.commands.run import call_times, recorded_models, step_times
from mjbench.commands.run.activities import Activity
from mjbench.commands.run.hook import call_bursts, call_clock, rare_calls, step_file, watch
from mjbench.commands.run.step_times import Header

HOOK = Path(call_clock.__file__).parent


@pytest.fixture
def clock(tmp_path):
    return call_clock.CallClock(str(tmp_path), Clock())


@pytest.fixture
def looks(clock, tmp_path):
    return watch.Watch(str(tmp_path), clock)


@pytest.fixture
def slow(clock, looks):
    return rare_calls.RareCalls(clock, looks)


def read(folder):
    return call_times.read_all(folder, step_times.read_headers(folder))


def write_header(folder, header):
    of_steps = itertools.takewhile(lambda name: name != "collections", header)
    step_file.StepFile(str(folder)).write_header(*map(header.get, of_steps))


def test_a_slow_call_is_counted_by_its_line_with_what_it_took(clock, tmp_path):
    timed = clock.slow(lambda value: value + 1, "MjData")
    assert [timed(i) for i in range(3)] == [1, 2, 3]
    (call,) = read(tmp_path).calls
    assert (call.callee, call.calls, call.seconds) == ("MjData", 3, pytest.approx(3e-6))
    assert call.activity == Activity.COPYING
    assert call.place.file.endswith("test_call_clock.py")
    assert "timed(i) for i" in call.place.text
    assert call.loop is not None
    assert call.lines[0] == call.place.position


def test_a_method_has_the_name_that_samples_give_it(clock, tmp_path):
    class Env:
        def observe(self):
            clock.slow(lambda: None, "render")()

    Env().observe()
    (call,) = read(tmp_path).calls
    assert call.place.function.endswith("Env.observe")


@pytest.mark.parametrize("file", [step_times.__file__, call_clock.__file__])
def test_lines_of_mjbench_are_never_the_programs(clock, tmp_path, file):
    code = compile("for _ in range(3): timed()", file, "exec")
    names = {"timed": clock.slow(lambda: None, "MjData")}
    thread = threading.Thread(target=exec, args=(code, names))  # with no line of the program below
    thread.start()
    thread.join()
    assert read(tmp_path).calls == []
    exec(code, names)
    (call,) = read(tmp_path).calls
    assert call.calls == 3
    assert all(path.endswith("test_call_clock.py") or "-packages" in path for path, _ in call.lines)
    assert call.place.text == "exec(code, names)"


def test_a_call_inside_another_is_part_of_it(clock, tmp_path):
    inner = clock.slow(lambda: None, "MjData")
    outer = clock.slow(lambda: inner(), "compile")
    outer()
    assert [call.callee for call in read(tmp_path).calls] == ["compile"]


def test_an_exception_passes_and_its_call_counts(clock, tmp_path):
    def fail():
        raise KeyError("x")

    with pytest.raises(KeyError, match="x"):
        clock.slow(fail, "MjData")()
    assert read(tmp_path).calls[0].calls == 1


def test_models_that_are_loaded_without_a_step_between_them_count_once(clock, tmp_path):
    steps = iter([0, 0, 0, 0, 5, 5])  # seen before each load
    clock.step_counts.append(lambda: next(steps))
    load, draw = (clock.slow(lambda: None, name) for name in ("compile", "Renderer"))
    roll_out = clock.slow(lambda: None, "Rollout.rollout", lambda *_: (1, 1))
    for before in (draw, roll_out, draw):
        before()
        load()
        load()
    assert sum(call.calls for call in read(tmp_path).calls if call.callee == "compile") == 2


def test_the_file_holds_what_was_counted_at_any_moment(clock, tmp_path):
    """A program that is killed leaves it: nothing is written at the end."""
    timed = clock.slow(lambda: None, "Renderer")
    timed()
    raw = (tmp_path / f"{os.getpid()}.calls").read_bytes()
    assert call_clock.SLOT.unpack_from(raw, call_clock.SLOT.size)[0] == 1


def test_more_lines_than_slots_share_the_last_one(clock, tmp_path, monkeypatch):
    monkeypatch.setattr(call_clock, "MAX_SLOTS", 2)
    frame = sys._getframe()
    for name in ("a", "b", "c"):
        clock.add(name, frame, 0, 10)
    assert [call.callee for call in read(tmp_path).calls] == ["a"]


class EzPickle:
    """An environment that is copied as Gymnasium's base class does it."""

    data = SimpleNamespace(time=1.0)

    def __getstate__(self):
        return {"is_state": True}

    def __setstate__(self, state):
        self.is_copy = state["is_state"]


class HasNoData(EzPickle):
    @property
    def data(self):
        raise RuntimeError("call reset first")


class HasNoTime(EzPickle):
    data = SimpleNamespace(time=lambda: 1.0)


@pytest.mark.parametrize("kind", [EzPickle, HasNoData, HasNoTime])
def test_copies_of_environments_are_noted_and_never_fail(looks, tmp_path, monkeypatch, kind):
    monkeypatch.setattr(EzPickle, "__setstate__", EzPickle.__setstate__)  # restored afterwards
    looks.install_copies(SimpleNamespace(EzPickle=EzPickle))
    assert copy.deepcopy(kind()).is_copy
    noted = [incident.name for incident in read(tmp_path).incidents]
    assert noted == ([call_clock.COPIED_ENVIRONMENT] if kind is EzPickle else [])


def test_two_threads_in_one_simulation_are_an_incident(looks, tmp_path):
    frame = sys._getframe()
    looks.enter(7, frame, 1)
    looks.enter(7, frame, 2)
    other = threading.Thread(target=lambda: looks.enter(7, frame, 3))
    other.start()
    other.join()
    assert [(each.name, each.count) for each in read(tmp_path).incidents] == [
        (call_clock.SHARED_DATA, 1)
    ]


def test_a_simulation_that_one_thread_leaves_another_may_step(looks, tmp_path):
    frame = sys._getframe()
    looks.enter(7, frame, 1)
    looks.leave(7)
    other = threading.Thread(target=lambda: looks.enter(7, frame, 3))
    other.start()
    other.join()
    assert read(tmp_path).incidents == []


def test_warnings_count_from_the_last_look_on(looks, tmp_path):
    (tmp_path / "engine.json").write_text('{"warnings": {"0": "INERTIA", "1": "BADQACC"}}')
    frame = sys._getframe()
    data = SimpleNamespace(warning=SimpleNamespace(number=np.array([0, 2])))
    looks.look_for_warnings(data, frame, 1)
    looks.look_for_warnings(data, frame, 2)
    data.warning.number[:] = 0, 1  # reset, and one more
    looks.look_for_warnings(data, frame, 3)
    incidents = read(tmp_path).incidents
    assert {each.name for each in incidents} == {"BADQACC"}
    assert sum(each.count for each in incidents) == 3


def test_rollout_counts_steps_of_all_simulations(slow, tmp_path):
    module = ModuleType("rollout")
    module.rollout = lambda model, data, state: (np.zeros((8, 5, 3)), None)
    slow.install_rollout(module)
    model, data = object(), object()
    module.rollout(model, data, None)
    module.rollout(model, data=[data, data], state=None)
    single, threaded = read(tmp_path).calls
    assert (single.callee, threaded.callee) == ("rollout", call_clock.THREADED_ROLLOUT)
    assert (single.steps, single.all_steps) == (5, 40)
    assert single.is_step


def test_the_first_simulation_of_a_rollout_is_looked_at_from_time_to_time(slow, monkeypatch):
    class Rollout:
        def rollout(self, model, data, initial_state):
            return np.zeros((2, 2, 3)), None

    seen, looks = [], slow._watch
    monkeypatch.setattr(looks, "look", lambda model, data, *_: seen.append((model, data)))
    module = ModuleType("rollout")
    module.rollout, module.Rollout = lambda *_: (np.zeros((1, 2, 3)), None), Rollout
    slow.install_rollout(module)
    module.rollout("model", "data", None)
    module.Rollout().rollout(["one", "two"], data=["first", "second"], initial_state=None)
    assert seen == [("model", "data"), ("one", "first")]
    looks.next_look_ns = sys.maxsize
    module.rollout("model", "data", None)
    assert len(seen) == 2


def test_rollout_and_its_pool_stay_two_functions(slow, tmp_path):
    class Rollout:
        def rollout(self, model, data, initial_state):
            return np.zeros((1, 2, 3)), None

    module = ModuleType("rollout")
    module.rollout, module.Rollout = lambda *_: (np.zeros((1, 2, 3)), None), Rollout
    slow.install_rollout(module)
    module.rollout(object(), object(), None)
    module.Rollout().rollout(object(), [], None)
    assert [call.callee for call in read(tmp_path).calls] == ["rollout", "Rollout.rollout"]


@pytest.mark.parametrize(("width", "frame"), [(640, (480, 640)), (None, None)])
def test_what_gymnasium_draws_is_timed_with_its_size_and_a_state(
    slow, looks, tmp_path, monkeypatch, width, frame
):
    class MujocoRenderer:
        model, data, height = "model", "data", 480

        def render(self, render_mode):
            return render_mode

    states = []
    monkeypatch.setattr(looks, "keep_state", lambda *state: states.append(state))
    MujocoRenderer.width = width
    slow.install_gymnasium(SimpleNamespace(MujocoRenderer=MujocoRenderer))
    assert MujocoRenderer().render("rgb_array") == "rgb_array"
    (call,) = read(tmp_path).calls
    assert (call.callee, call.activity, call.frame) == ("render", Activity.RENDERING, frame)
    assert states == [("model", "data")]


def test_a_scene_of_mujoco_leaves_the_state_that_it_shows(slow, looks, monkeypatch):
    class Renderer:
        model, height, width = "model", 48, 64

        def update_scene(self, data):
            pass

        def render(self):
            pass

    states = []
    monkeypatch.setattr(looks, "keep_state", lambda *state: states.append(state))
    module = ModuleType("mujoco")
    module.Renderer = Renderer
    slow.install(module)
    renderer = module.Renderer()
    renderer.update_scene("data")
    renderer.render()
    assert states == [("model", "data")]


def test_a_callback_is_the_programs_own_when_it_asks_for_it(slow):
    module = ModuleType("mujoco")
    kept = {}
    module.set_mjcb_control = lambda function: kept.update(control=function)
    module.get_mjcb_control = lambda: kept.get("control")
    slow.install(module)
    assert module.get_mjcb_control() is None

    def control(model, data):
        pass

    module.set_mjcb_control(control)
    assert kept["control"] is not control
    assert module.get_mjcb_control() is control


def test_a_call_of_a_forked_process_is_none_of_its_parents_lines(clock, tmp_path):
    """A worker whose lines are all of a package has its place there."""
    folder = tmp_path / "site-packages"
    names = {"count": lambda: clock.add("mj_step", sys._getframe(2), 1, 2, 1, 1)}
    worker = compile("def work():\n    count()\nwork()", str(folder / "worker.py"), "exec")
    process = compile(
        "def _bootstrap():\n    exec(worker, names)\n_bootstrap()",
        multiprocessing.process.__file__,
        "exec",
    )
    exec(process, {"worker": worker, "names": names})
    (call,) = read(tmp_path).calls
    assert call.place.file == "worker.py"


def test_no_file_of_lines_stays_open_that_a_program_could_get(clock, tmp_path):
    before = len(list(Path("/proc/self/fd").iterdir()))
    clock.add("mj_step", sys._getframe(), 1, 2)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_batch_counts_the_simulations_that_it_steps(slow, tmp_path):
    class Batch:
        nsim = 16

        def step(self, ids=None, nstep=1):
            return None

        def rollout(self, nstep, control=None):
            return {}

    module = ModuleType("batch")
    module.Batch = Batch
    slow.install_batch(module)
    batch = Batch()
    batch.step()
    batch.step([1, 2], nstep=3)
    batch.rollout(10)
    counts = {(call.callee, call.all_steps) for call in read(tmp_path).calls}
    assert counts == {("Batch.step", 16), ("Batch.step", 6), ("Batch.rollout", 160)}


def test_callbacks_between_bursts_are_those_of_the_steps_of_their_own_loop(clock, tmp_path):
    burst = call_bursts.Burst(clock)

    def program():
        frame = sys._getframe()
        for i in range(10):
            clock.add("callback mjcb_control", frame, 100 * i, 100 * i + 5)
            burst.add("mj_step", frame, 100 * i, 100 * i + 10, 1)
        burst.write()
        for i in range(10, 20):
            burst.add("mj_step", frame, 100 * i, 100 * i + 10, 1)
        burst.pass_on(burst.write(), 9, until_ns=20_000)

    thread = threading.Thread(target=program)  # without the loops of those who run tests
    thread.start()
    thread.join()
    header = dict.fromkeys(Header.__dataclass_fields__, 0) | {"pid": os.getpid(), "first_ns": 1}
    write_header(tmp_path, header)
    callback, with_callback, without = read(tmp_path).calls
    assert (with_callback.calls, without.calls) == (10, 100)
    assert callback.calls == 10


@pytest.mark.parametrize("cost_ns", [0, 10**9])
def test_steps_take_what_was_measured_however_much_the_clock_seems_to_cost(
    clock, tmp_path, cost_ns
):
    burst = call_bursts.Burst(clock)
    burst.add("mj_step", sys._getframe(), 1_000, 1_400, 1)
    burst.pass_on(burst.write(), 9, until_ns=5_000)
    header = dict.fromkeys(Header.__dataclass_fields__, 0)
    header |= {"pid": os.getpid(), "first_ns": 1_000, "cost_ns": cost_ns}
    write_header(tmp_path, header)
    (call,) = read(tmp_path).calls
    assert call.calls == 10
    assert call.seconds == pytest.approx(400e-9 if cost_ns else 4_000e-9)


def test_a_damaged_file_is_left_out(tmp_path):
    (tmp_path / "1.calls").write_bytes(b"short")
    (tmp_path / "1.sites").write_text("{")
    assert read(tmp_path).calls == []


# Its bursts may cost what they like, so no call passes between two of them untimed.
PROGRAM = """
import sys
import mujoco
sys.modules["mjbench_hook.call_bursts"].FREE_COST_NS = sys.maxsize
model = mujoco.MjModel.from_xml_string('''
<mujoco>
  <option integrator="RK4"/>
  <worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>
</mujoco>''')
def control(model, data):
    pass
mujoco.set_mjcb_control(control)
simulations = [mujoco.MjData(model) for _ in range(3)]
for i in range(300):
    for data in simulations:
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
mujoco.set_mjcb_control(None)
for i in range(250):
    mujoco.mj_step1(model, data)
    mujoco.mj_step2(model, data)
data.qpos[0] = float("nan")
mujoco.mj_step(model, data)
for i in range(60):
    fresh = mujoco.MjData(model)
    for _ in range(10):
        mujoco.mj_step(model, fresh)
print(isinstance(data, mujoco.MjData), mujoco.mj_forward.__name__)
"""


@pytest.fixture(scope="module")
def observed(tmp_path_factory):
    """Run one program under the clocks; return what it printed and the folder of their files."""
    folder = tmp_path_factory.mktemp("clock")
    file = tmp_path_factory.mktemp("program") / "program.py"
    file.write_text(PROGRAM)
    inherited = filter(None, [os.environ.get("PYTHONPATH")])
    done = subprocess.run(
        [sys.executable, "-W", "error", str(file)],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(HOOK), *inherited]),
            "MJBENCH_STEP_CLOCK": str(folder),
        },
        cwd=file.parent,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done, folder


def test_the_program_runs_as_without_the_clock(observed):
    done, _ = observed
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "True mj_forward"


def test_calls_of_a_program_are_known_by_line(observed):
    _, folder = observed
    counts = {}
    for call in read(folder).calls:
        counts[call.callee] = counts.get(call.callee, 0) + round(call.calls)
    assert counts["from_xml_string"] == 0  # before the first step
    assert counts["MjData"] == 63
    assert counts["mj_step"] == 1501
    assert counts["mj_forward"] == 300
    assert counts["mj_step2"] == 250
    assert counts["callback mjcb_control"] >= 3 * 4 * 200


def test_what_only_a_run_shows_is_seen(observed):
    _, folder = observed
    incidents = {each.name: each for each in read(folder).incidents}
    in_turn = [each for each in read(folder).incidents if each.name == call_clock.IN_TURN]
    assert {each.count for each in in_turn} == {3}  # not of those that each iteration creates
    assert not incidents[call_clock.IN_TURN].is_wrong
    assert incidents[call_clock.HALVES].place.text == "mujoco.mj_step2(model, data)"
    assert incidents["BADQPOS"].count == 1


def test_models_and_states_are_written_for_later(observed):
    _, folder = observed
    (model,) = recorded_models.read_all(folder)
    assert len(model.mjb) > 1000
    assert 1 <= len(model.states) <= watch.MAX_STATES
    assert np.isfinite(model.states).all()


def test_states_are_spread_over_the_whole_program(tmp_path):
    file = tmp_path / "0.states"
    states = watch.SpreadStates(str(file))
    for number in range(101):
        if states.is_due():
            states.keep(bytes([number]))
    kept = list(file.read_bytes())
    assert watch.MAX_STATES / 2 < len(kept) <= watch.MAX_STATES
    assert kept == [16 * place for place in range(len(kept))]
