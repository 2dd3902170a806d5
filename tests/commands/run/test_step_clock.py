"""The step clock times calls in bursts, costs little, and changes nothing of what is called."""

import gc
import itertools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from commands import ROOT

from mjbench.commands.run import call_times, step_times
from mjbench.commands.run.hook import (
    call_bursts,
    call_clock,
    step_clock,
    step_file,
    watch,
)

CALL_NS, BETWEEN_NS = 40_000, 10_000


class FakeClock:
    """A clock that only a call of the engine, or `spend`, moves."""

    def __init__(self):
        self.now_ns, self.call_ns = 1_000, CALL_NS

    def __call__(self):
        return self.now_ns

    def spend(self, ns):
        self.now_ns += ns


def engine(clock, calls):
    """Return a module that looks like mujoco; its functions take time on the clock."""
    module = ModuleType("mujoco")

    def function(name):
        def call(*args, **kwargs):
            calls.append((name, args, kwargs))
            clock.spend(clock.call_ns)
            return name

        call.__name__ = name
        return call

    resets = ("mj_resetData", "mj_resetDataKeyframe")
    for name in ("mj_step", "mj_step1", "mj_step2", "mj_forward", *resets):
        setattr(module, name, function(name))
    return module


class Data(SimpleNamespace):
    """Has weak references, as MjData has."""


def simulation():
    model = SimpleNamespace(opt=SimpleNamespace(timestep=0.002))
    return model, Data(timer=SimpleNamespace(duration=np.zeros(3)))


@pytest.fixture
def started(tmp_path):
    """Return a step clock, the fake clock, the module, and the calls that reached the engine."""
    fake, calls = FakeClock(), []
    of_calls = call_clock.CallClock(str(tmp_path), now_ns=fake)
    looks = watch.Watch(str(tmp_path), of_calls, fake)
    clock = step_clock.StepClock(str(tmp_path), of_calls, looks, now_ns=fake, processor_ns=fake)
    module = engine(fake, calls)
    clock.install(module)
    clock.timed_ns = clock.cold_ns = clock.passed_ns = 0
    return SimpleNamespace(clock=clock, fake=fake, module=module, calls=calls, folder=tmp_path)


def read(started):
    started.clock.end()
    (steps,) = step_times.read_all(started.folder)
    return steps


def calls_of(started):
    return call_times.read_all(started.folder, step_times.read_headers(started.folder)).calls


def test_calls_reach_the_engine_unchanged(started):
    model, data = simulation()
    assert started.module.mj_step(model, data, nstep=4) == "mj_step"
    assert started.calls == [("mj_step", (model, data, 4), {})]
    assert started.module.mj_step.__name__ == "mj_step"


def test_steps_and_iterations_are_timed(started):
    model, data = simulation()
    for _ in range(300):
        started.module.mj_step(model, data, 2)
        started.fake.spend(BETWEEN_NS)
    steps = read(started)
    assert steps.nstep == 600
    assert steps.step.count == 300
    assert steps.step.p50_ns == steps.step.max_ns == CALL_NS / 2
    assert steps.iteration.p50_ns == CALL_NS + BETWEEN_NS
    assert steps.steps_per_s == pytest.approx(2e9 / (CALL_NS + BETWEEN_NS), rel=0.01)
    assert steps.real_time_factor == pytest.approx(0.002 * steps.steps_per_s)
    assert not steps.of_environment


def test_both_parts_of_a_step_count_as_one(started):
    model, data = simulation()
    for _ in range(50):
        started.module.mj_step1(model, data)
        started.module.mj_step2(model, data)
    steps = read(started)
    assert steps.nstep == 50
    assert steps.step.p50_ns == 2 * CALL_NS


def test_bursts_cost_no_more_than_their_share(started):
    model, data = simulation()
    started.clock.timed_ns = started.clock.cold_ns = CALL_NS // 10
    count = 200_000
    for _ in range(count):
        started.module.mj_step(model, data)
    steps = read(started)
    assert len(started.calls) == count
    assert steps.nstep == pytest.approx(count, rel=0.05)
    limit = call_bursts.MAX_COST_SHARE + call_bursts.FREE_COST_NS / (count * CALL_NS)
    assert 0 < steps.cost_share <= 1.1 * limit


@pytest.mark.parametrize("steps", [0, 50, 500])
def test_bursts_of_calls_without_steps_cost_no_more_than_their_share(started, steps):
    model, data = simulation()
    started.clock.timed_ns = started.clock.cold_ns = CALL_NS // 10
    for _ in range(steps):
        started.module.mj_step(model, data)
    before, count = started.fake(), 200_000
    for _ in range(count):
        started.module.mj_forward(model, data)
    seconds = 1e-9 * (started.fake() - before)
    started.clock.end()
    (forward,) = [each for each in calls_of(started) if each.callee == "mj_forward"]
    assert len(started.calls) == count + steps
    assert forward.calls == pytest.approx(count, rel=0.01)
    assert forward.seconds == pytest.approx(seconds, rel=0.01)
    limit = call_bursts.MAX_COST_SHARE * seconds + 1e-9 * call_bursts.FREE_COST_NS
    assert 0 < forward.clock_s <= 1.1 * limit


@pytest.mark.parametrize("of_step", [300, 36])
def test_many_calls_for_each_step_cost_no_more_than_their_share_either(started, of_step):
    model, data = simulation()
    started.clock.timed_ns = started.clock.cold_ns = CALL_NS // 10
    before, count = started.fake(), 300_000 // of_step
    for _ in range(count):
        started.module.mj_step(model, data)
        for _ in range(of_step):
            started.module.mj_forward(model, data)
    seconds = 1e-9 * (started.fake() - before)
    started.clock.end()
    step, forward = sorted(calls_of(started), key=lambda each: each.calls)
    assert (step.callee, step.calls) == ("mj_step", pytest.approx(count, rel=0.05))
    assert forward.calls == pytest.approx(300_000, rel=0.05)
    limit = call_bursts.MAX_COST_SHARE * seconds + 1e-9 * call_bursts.FREE_COST_NS
    assert forward.clock_s + step.clock_s <= 2.2 * limit


def test_time_in_which_others_have_the_core_earns_no_bursts(tmp_path, monkeypatch):
    monkeypatch.setattr(call_bursts, "FREE_COST_NS", 0)
    timed, (model, data) = [], simulation()
    for share in (1.0, 0.25):
        fake, calls = FakeClock(), []
        folder = tmp_path / str(share)
        folder.mkdir()
        of_calls = call_clock.CallClock(str(folder), fake)
        looks = watch.Watch(str(folder), of_calls, fake)
        processor = lambda: int(share * fake())  # noqa: B023, E731
        clock = step_clock.StepClock(str(folder), of_calls, looks, fake, processor)
        module = engine(fake, calls)
        clock.install(module)
        clock.timed_ns = clock.cold_ns = CALL_NS // 100
        for _ in range(400 * call_bursts.BURST_CALLS):
            module.mj_step(model, data)
        timed.append(clock._calls_timed)
    assert timed[1] == pytest.approx(timed[0] / 4, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_steps_of_a_program_with_phases_and_a_slow_start_have_the_share_that_they_take(
    started, seed
):
    """Episodes differ, so from burst to burst, timing seems to cost more or less."""
    clock, fake, (model, data) = started.clock, started.fake, simulation()
    clock.timed_ns = clock.cold_ns = 1_200
    random, stepped_ns, before_ns = np.random.default_rng(seed), 0, fake.now_ns
    for episode in range(4_000):
        is_begin, is_late = fake.now_ns < 400_000_000, episode > 2_500
        fake.call_ns = int(random.uniform(5_000, 25_000)) * (1 + 2 * is_begin + is_late)
        for _ in range(100):
            started.module.mj_step(model, data)
            stepped_ns += fake.call_ns
            fake.spend(2_000)
    clock.end()
    (call,) = [each for each in calls_of(started) if each.calls]
    wall_ns = fake.now_ns - before_ns
    assert 1e9 * call.seconds / wall_ns == pytest.approx(stepped_ns / wall_ns, abs=0.05)


def test_what_a_call_costs_the_program_is_learned_from_its_bursts(started):
    """Between bursts, a call takes a tenth less."""
    clock = started.clock
    clock.timed_ns = clock.cold_ns = CALL_NS // 20
    clock._burst_period_ns = CALL_NS
    clock._learn_cost(CALL_NS * 9 // 10)
    assert clock.cold_ns == CALL_NS // 10
    clock._learn_cost(0)  # an outlier
    clock._learn_cost(CALL_NS * 9 // 10)
    assert clock.cold_ns == CALL_NS // 10
    clock._burst_period_ns = 0
    for _ in range(9):
        clock._learn_cost(CALL_NS)
    assert clock.cold_ns == clock.timed_ns


def test_the_count_of_steps_changes_with_each_step(started, monkeypatch):
    """Whether steps are timed or pass through."""
    monkeypatch.setattr(call_bursts, "FREE_COST_NS", 0)
    started.clock.timed_ns = started.clock.cold_ns = CALL_NS
    model, data = simulation()
    counts = set()
    for _ in range(3 * call_bursts.BURST_CALLS):
        started.module.mj_step(model, data)
        counts.add(started.clock._calls.step_counts[0]())
    assert len(counts) == 3 * call_bursts.BURST_CALLS


def test_the_engines_timers_give_stages(started):
    model, data = simulation()
    names = {"STEP": 0, "POS_KINEMATICS": 1, "CONSTRAINT": 2}
    for _ in range(call_bursts.BURST_CALLS):
        started.module.mj_step(model, data)
        data.timer.duration += np.array([1.0, 0.25, 0.5]) * 1e-9 * CALL_NS
    started.clock.end()
    (file,) = started.folder.glob("*.steps")
    stages = step_times.read(file, names).stages
    assert stages["kinematics"] == pytest.approx(0.25)
    assert stages["constraint solver"] == pytest.approx(0.5)
    assert sum(stages.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("share", [2.0, 1e-6])
def test_timers_without_a_clock_give_no_stages(started, share):
    model, data = simulation()
    for _ in range(call_bursts.BURST_CALLS):
        started.module.mj_step(model, data)
        data.timer.duration += share * 1e-9 * CALL_NS
    started.clock.end()
    (file,) = started.folder.glob("*.steps")
    assert step_times.read(file, {"STEP": 0, "POS_KINEMATICS": 1}).stages == {}


def test_timers_that_the_program_resets_are_left_out(started):
    model, data = simulation()
    data.timer.duration += 5.0
    for _ in range(call_bursts.BURST_CALLS):
        started.module.mj_step(model, data)
        data.timer.duration[:] = 0.0
    assert read(started).stages == {}


def test_steps_of_an_environment_are_iterations(started):
    model, data = simulation()
    module = ModuleType("environments")

    class Environment:
        def step(self, action):
            for _ in range(5):
                started.module.mj_step(model, data)
            started.fake.spend(BETWEEN_NS)
            return action

    module.Environment = Environment
    started.clock.install_environment(module, "Environment", "step")
    started.clock.install_environment(module, "Missing", "step")
    environment = Environment()
    assert [environment.step(i) for i in range(30)] == list(range(30))
    steps = read(started)
    assert steps.of_environment
    assert steps.iteration.p50_ns == 5 * CALL_NS + BETWEEN_NS


def test_collections_count_from_the_first_step(started):
    model, data = simulation()
    note = started.clock.collections.callback
    for begin in (True, False):
        note("start", {"generation": 2})
        started.fake.spend(3_000_000)
        note("stop", {"generation": 2})
        if begin:
            started.module.mj_step(model, data)
    steps = read(started)
    assert steps.collections == 1
    assert steps.collections_s == steps.longest_collection_s == pytest.approx(0.003)


@pytest.mark.parametrize("reads", [1, 100, 5_000])
def test_calibration_leaves_nothing_wherever_it_is_interrupted(started, reads):
    clock = started.clock
    counted = itertools.count().__next__

    def interrupt():
        if counted() >= reads:
            raise KeyboardInterrupt
        return counted()

    clock._now_ns = interrupt
    with pytest.raises(KeyboardInterrupt):
        clock.install(engine(started.fake, started.calls))
    clock._now_ns = started.fake
    assert read(started).step is None
    assert calls_of(started) == []


def test_the_file_never_overflows(started, monkeypatch):
    monkeypatch.setattr(step_file, "CAPACITY", 4 * call_bursts.BURST_CALLS)
    model, data = simulation()
    for _ in range(20 * call_bursts.BURST_CALLS):
        started.module.mj_step(model, data)
    steps = read(started)
    assert 0 < steps.step.count <= 4 * call_bursts.BURST_CALLS


def test_a_thread_has_iterations_of_its_own():
    header = step_times.Header(1, 1, 0, 0, 0, 0, 0, 0, 0, 0)
    rows = [(step_file.BURST, 1, 0, 0, 0, 0)]
    rows += [
        (step_file.STEP, thread, begin, begin + 10, 1, 0)
        for begin, thread in zip(range(0, 400, 100), itertools.cycle((1, 2)), strict=False)
    ]
    records = np.array(rows, dtype=step_times._RECORDS)
    times = step_times.step_times(header, records, (), {})
    assert times.iteration.count == 2
    assert times.iteration.p50_ns == 200


def test_a_file_that_is_cut_short_is_left_out(tmp_path):
    (tmp_path / "1.steps").write_bytes(b"short")
    with pytest.raises(step_times.InputError, match="step clock"):
        step_times.read(tmp_path / "1.steps", {})
    assert step_times.read_all(tmp_path) == []


def program(tmp_path, text, **environment):
    """Run a program under the hook; return what it printed and the steps of its processes."""
    file, folder = tmp_path / "program.py", tmp_path / "clock"
    file.write_text(text)
    folder.mkdir()
    hook = Path(step_clock.__file__).parent
    inherited = filter(None, [os.environ.get("PYTHONPATH")])
    done = subprocess.run(
        [sys.executable, str(file)],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(hook), *environment.pop("path", []), *inherited]),
            "MJBENCH_STEP_CLOCK": str(folder),
            **environment,
        },
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done, step_times.read_all(folder)


STEPS = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
data = mujoco.MjData(model)
for _ in range(10):
    mujoco.mj_step(model, data)
"""


def test_a_program_is_timed_in_each_process_that_it_forks(tmp_path):
    if not hasattr(os, "fork"):
        pytest.skip("no fork on this platform")
    done, steps = program(tmp_path, f"import os\npid = os.fork()\n{STEPS}\nif pid: os.wait()")
    assert done.stderr == ""
    assert [each.nstep for each in steps if each.step is not None] == [10, 10]


INTERRUPTED = """
import _thread, gc, os, signal
from functools import partial

def handle(number, frame):
    print("handled")
    raise {error}

signal.signal(signal.SIGINT, handle)
"""


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "TimeoutError"])
def test_an_interrupt_in_a_garbage_collection_reaches_the_program(tmp_path, error):
    """The signal comes in a callback of C before the clock's, so Python cannot handle it there."""
    done, steps = program(
        tmp_path,
        INTERRUPTED.format(error=error)
        + f"""
interrupting = type("", (), {{"start": property(partial(next, iter(_thread.interrupt_main, 0)))}})
gc.callbacks.insert(0, partial(getattr, interrupting()))
try:
    gc.collect()
except {error}:
    print("raised")
gc.callbacks.pop(0)
gc.collect()
"""
        + STEPS
        + "gc.collect()",
    )
    assert done.stderr == ""
    assert done.stdout.splitlines() == ["handled", "raised"]
    assert max(each.collections for each in steps) >= 1


def test_an_interrupt_in_a_process_that_was_just_forked_reaches_the_program(tmp_path):
    if not hasattr(os, "fork"):
        pytest.skip("no fork on this platform")
    done, steps = program(
        tmp_path,
        INTERRUPTED.format(error="KeyboardInterrupt")
        + STEPS
        + """
real = os.getpid
def getpid():
    os.getpid = real
    _thread.interrupt_main()
    return real()
os.getpid = getpid  # the clock asks for it when it begins the files of the new process
try:
    pid = os.fork()
except KeyboardInterrupt:
    mujoco.mj_step(model, data)
    os._exit(3)
os.getpid = real
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
""",
    )
    assert done.stderr == ""
    assert done.stdout.splitlines() == ["handled", "3"]
    assert [each.nstep for each in steps if each.step is not None] == [10], "its parent's alone"


def test_what_is_no_simulation_raises_what_it_raises_without_mjbench(tmp_path):
    wrong = "for each in (mujoco.MjData(model), 1, 2):\n    mujoco.mj_step(model, each)"
    done, _ = program(tmp_path, f"{STEPS}\n{wrong}")
    assert "incompatible function arguments" in done.stderr
    assert "weak reference" not in done.stderr


def test_tracebacks_do_not_show_the_clock(tmp_path):
    done, _ = program(tmp_path, STEPS + "\nmujoco.mj_step(1)")
    assert done.returncode == 1
    assert "TypeError" in done.stderr
    assert "hook" not in done.stderr


def test_a_program_that_is_interrupted_ends_without_a_traceback(tmp_path):
    done, _ = program(tmp_path, STEPS + "\nimport _thread\n_thread.interrupt_main()")
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_what_a_program_does_with_the_engines_functions_works_as_before(tmp_path):
    text = (
        STEPS
        + """
import copy, pickle
class Env:
    step_function = mujoco.mj_step
Env().step_function(model, data)
assert pickle.loads(pickle.dumps(mujoco.mj_step)) is mujoco.mj_step
assert copy.copy(mujoco.mj_step) is mujoco.mj_step
copy.deepcopy(mujoco.mj_step)(model, data)
print(mujoco.mj_step.__name__, data.time > 0)
"""
    )
    done, steps = program(
        tmp_path, "import importlib.util\nimportlib.util.find_spec('mujoco')" + text
    )
    assert done.stderr == ""
    assert done.stdout == "mj_step True\n"
    assert max(each.nstep for each in steps) == 12


def test_an_endless_recursion_is_reported_as_without_the_clock(tmp_path):
    done, _ = program(tmp_path, "def f():\n    f()\nf()")
    assert "RecursionError" in done.stderr
    assert "excepthook" not in done.stderr


def test_what_follows_the_last_step_does_not_count(started):
    model, data = simulation()
    for _ in range(call_bursts.BURST_CALLS + 5):
        started.module.mj_step(model, data)
    started.fake.spend(10**12)
    assert read(started).steps_per_s == pytest.approx(1e9 / CALL_NS, rel=0.01)


def test_ctrl_c_while_the_clocks_start_ends_the_program_without_a_traceback(tmp_path):
    program = (
        "import os, runpy, sys\n"
        "class Sender:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'mjbench_hook.start': os.kill(os.getpid(), 2)\n"
        "sys.meta_path.insert(0, Sender())\n"
        "runpy.run_path(sys.argv[1], run_name='sitecustomize')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(ROOT / "mjbench/commands/run/hook/sitecustomize.py")],
        env={**os.environ, "MJBENCH_STEP_CLOCK": str(tmp_path)},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


def test_the_users_own_sitecustomize_runs(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (own / "sitecustomize.py").write_text("print('mine')")
    done, _ = program(
        tmp_path, "import sitecustomize; print(sitecustomize.__file__)", path=[str(own)]
    )
    assert done.stdout.splitlines() == ["mine", str(own / "sitecustomize.py")]


def test_random_streams_and_the_module_path_are_as_without_the_clock(tmp_path):
    text = "import sys, random\nrandom.seed(3)\nprint(random.random(), len(sys.path), sys.argv)"
    file = tmp_path / "program.py"
    file.write_text(text)
    plain = subprocess.run([sys.executable, str(file)], capture_output=True, text=True)
    done, steps = program(tmp_path, text)
    assert done.stdout == plain.stdout
    assert done.stderr == ""
    assert all(each.step is None for each in steps)


def test_the_names_of_timers_are_written(started):
    stored = json.loads((started.folder / "engine.json").read_text())
    assert stored == {"version": "", "timers": {}, "warnings": {}}
    assert gc.isenabled()


def test_a_program_that_never_steps_is_looked_at_in_its_loop(started, monkeypatch):
    seen = []
    monkeypatch.setattr(started.clock._watch, "look", lambda *arguments: seen.append(arguments[:2]))
    model, data = simulation()
    for _ in range(call_bursts.BURST_CALLS):
        started.module.mj_forward(model, data)
    assert not seen, "that may be set-up"
    started.module.mj_forward(model, data)
    assert seen == [(model, data)]
    started.module.mj_step(model, data)
    started.module.mj_forward(model, data)
    assert len(seen) == 1
