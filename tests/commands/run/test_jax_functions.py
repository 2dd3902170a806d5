"""Calls of JAX count by line, and are what they were."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hook_clock import Clock

from mjbench.commands.run import call_times, step_times
from mjbench.commands.run.hook import (
    argument_types,
    call_bursts,
    call_clock,
    jax_functions,
    step_clock,
    watch,
)

HOOK = Path(call_clock.__file__).parent


@pytest.fixture
def clock(tmp_path):
    fake = Clock()
    of_calls = call_clock.CallClock(str(tmp_path), fake)
    return jax_functions.JaxFunctions(of_calls, fake, lambda: fake.now_ns)


def read(folder):
    return call_times.read_all(folder, step_times.read_headers(folder)).calls


def counts_of(folder):
    counts = Counter()
    for call in read(folder):
        counts[call.callee] += call.calls
    return counts


def seconds_of(folder):
    seconds = Counter()
    for call in read(folder):
        seconds[call.callee] += call.seconds
    return seconds


def test_what_jax_compiles_inside_another_function_counts_once(clock, tmp_path):
    trace, _, compiled = jax_functions._EVENTS
    clock._now_ns = iter((10_000_000, 12_000_000, 20_000_000)).__next__
    clock.note_event(trace, 0.004)  # from 6 to 10 ms, inside the next
    clock.note_event(trace, 0.010)  # from 2 to 12 ms
    clock.note_event(compiled, 0.005)
    clock.note_event("/jax/another/event", 9.0)
    seconds = seconds_of(tmp_path)
    assert sum(seconds.values()) == pytest.approx(0.015)
    assert seconds[call_clock.COMPILE] == pytest.approx(0.005)
    assert counts_of(tmp_path)[call_clock.COMPILE] == 1


def test_what_is_compiled_in_a_call_is_no_part_of_the_call(clock, tmp_path):
    def compiles():
        clock._now_ns.now_ns += 50_000_000
        clock.note_event(list(jax_functions._EVENTS)[-1], 0.05)

    clock._timed(compiles, call_clock.DISPATCH)()
    clock.end()
    seconds = seconds_of(tmp_path)
    assert seconds[call_clock.COMPILE] == pytest.approx(0.05)
    assert seconds[call_clock.DISPATCH] < 1e-5


def test_calls_inside_another_are_part_of_it(clock, tmp_path):
    inner = clock._timed(lambda: 3, call_clock.DEVICE_WAIT)
    outer = clock._timed(lambda: inner(), call_clock.DISPATCH)
    assert outer() == 3
    clock.end()
    assert counts_of(tmp_path) == {call_clock.DISPATCH: 1}


def test_bursts_cost_no_more_than_their_share_and_stand_for_all_calls(clock, tmp_path, monkeypatch):
    monkeypatch.setattr(call_bursts, "FREE_COST_NS", 0)
    step_clock.StepClock(str(tmp_path), clock._calls, watch.Watch(str(tmp_path), clock._calls))
    clock.bursts.call_cost_ns = 30
    timed, count = clock._timed(lambda: None, call_clock.DISPATCH), 100_000
    of_jax, counts = clock._calls.step_counts[0], set()

    def work():
        for _ in range(count):
            timed()
            counts.add(of_jax())
            clock._now_ns.now_ns += 2_000

    work()
    clock.end()
    (call,) = read(tmp_path)
    assert call.calls == pytest.approx(count, rel=0.05)
    assert len(counts) == count
    assert (
        clock.bursts.calls_timed * clock.bursts.call_cost_ns
        < 1.5 * call_bursts.MAX_COST_SHARE * clock._now_ns()
    )


def test_a_program_of_mjx_steps_from_what_is_first_compiled(clock, tmp_path, monkeypatch):
    compiled = list(jax_functions._EVENTS)[-1]
    call = clock._timed(lambda: None, call_clock.DISPATCH)
    monkeypatch.delitem(sys.modules, "mujoco.mjx", raising=False)
    call()
    assert call_times.first_compiled_ns(tmp_path) is None, "it may compile a policy"
    monkeypatch.setitem(sys.modules, "mujoco.mjx", call_times)
    clock.note_event(compiled, 0.1)
    assert call_times.first_compiled_ns(tmp_path) is None, "that may create an array"
    clock.note_event(compiled, 2.0)
    first_ns = call_times.first_compiled_ns(tmp_path)
    assert 0 < first_ns <= clock._now_ns.now_ns
    call()
    assert call_times.first_compiled_ns(tmp_path) == first_ns
    clock._calls.begin_process()
    call()
    assert call_times.first_compiled_ns(tmp_path) > first_ns


def test_a_burst_that_another_thread_has_ended_is_not_ended_again(clock):
    clock._timed(lambda: None, call_clock.DISPATCH)()
    clock.bursts._finish(clock._now_ns())
    clock.bursts._finish(clock._now_ns())
    assert clock.bursts.calls_timed == 1


def test_a_fork_begins_anew(clock, tmp_path):
    clock.bursts.pacer.let_pass(5)
    clock.begin_process()
    clock._timed(lambda: None, call_clock.DISPATCH)()
    clock.end()
    assert counts_of(tmp_path) == {call_clock.DISPATCH: 1}


PROGRAM = """
import copy, functools, inspect, pickle
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 2)  # not once a device has started

@jax.jit
def double(x):
    return 2 * x

@jax.jit(static_argnames="n")
def power(x, n):
    return x ** n

class Net:
    @functools.partial(jax.jit, static_argnums=0)
    def __call__(self, x):
        return x + 1

net = Net()
for i in range(20):
    x = jnp.asarray(np.full(3, i))
    x = jax.device_put(np.ones(3))
    y = double(x)
    power(y, n=2)
    net(y)
    y.block_until_ready()
    np.asarray(y)
    float(y.sum())
    jax.device_get(y)
    assert np.asarray([1.0], np.float32).dtype == np.asarray(a=[1], dtype="f4").dtype == "f4"
    assert np.array([2], dtype=np.int8, ndmin=2).shape == np.array(object=[[2]]).shape
    jnp.asarray(y)
for _ in range(3):
    double(jnp.ones(4))
print(double(2), double.__name__, inspect.signature(double))
print(isinstance(double, jax.stages.Wrapped), double.__wrapped__(2))
print(copy.copy(double)(2), double.lower(2).compile()(2), {double: 1}[double])
print(jax.vmap(double)(jnp.ones(2)), jax.grad(lambda x: double(x))(1.0))
try:
    pickle.dumps(double)
except pickle.PicklingError:
    print("not by reference")
"""


@pytest.fixture(scope="module")
def observed(tmp_path_factory):
    """Run a program with the clocks and without them; return both, and the folder of the files."""
    pytest.importorskip("jax")
    folder = tmp_path_factory.mktemp("clock")
    file = tmp_path_factory.mktemp("program") / "program.py"
    file.write_text(PROGRAM)
    inherited = filter(None, [os.environ.get("PYTHONPATH")])
    clocks = {
        "PYTHONPATH": os.pathsep.join([str(HOOK), *inherited]),
        "MJBENCH_STEP_CLOCK": str(folder),
    }

    def run(variables):
        return subprocess.run(
            [sys.executable, str(file)],
            env={**os.environ, "JAX_PLATFORMS": "cpu", **variables},
            capture_output=True,
            text=True,
            timeout=120,
        )

    return run(clocks), run({}), folder


def test_a_program_of_jax_does_the_same_as_without_the_clock(observed):
    done, plain, _ = observed
    assert done.returncode == 0, done.stderr
    assert done.stdout == plain.stdout


def test_each_line_has_its_calls(observed):
    _, _, folder = observed
    counts, seconds = Counter(), Counter()
    for call in read(folder):
        if call.loop is not None:
            counts[call.place.text, call.callee] += call.calls
            seconds[call.place.text, call.callee] += call.seconds
    assert {key for key, count in counts.items() if count == 20} == {
        ("x = jnp.asarray(np.full(3, i))", call_clock.TRANSFER),
        ("x = jax.device_put(np.ones(3))", call_clock.TRANSFER),
        ("y = double(x)", call_clock.DISPATCH),
        ("power(y, n=2)", call_clock.DISPATCH),
        ("net(y)", call_clock.DISPATCH),
        ("y.block_until_ready()", call_clock.DEVICE_WAIT),
        ("np.asarray(y)", call_clock.DEVICE_WAIT),
        ("float(y.sum())", call_clock.DEVICE_WAIT),
        ("jax.device_get(y)", call_clock.DEVICE_WAIT),
    }
    assert counts["y = double(x)", call_clock.COMPILE] == 1
    assert seconds["y = double(x)", call_clock.TRACE] > 0


def test_a_function_that_is_compiled_again_is_noted_with_the_argument_that_differs(observed):
    _, _, folder = observed
    incidents = call_times.read_all(folder, step_times.read_headers(folder)).incidents
    (again,) = [each for each in incidents if each.place.text == "double(jnp.ones(4))"]
    assert (again.name, again.count, again.is_wrong) == (call_clock.RECOMPILED, 1, False)
    assert again.seconds > 0
    change = call_times.ArgumentChange("x", argument_types.SHAPE, "float32[3]", "float32[4]")
    assert again.changes == [change]
    assert not again.is_unfinished


def test_a_compilation_that_the_end_of_the_run_cuts_short_lasts_until_then(clock, tmp_path):
    def compiles(x):
        clock.note_event(jax_functions._LOWERED, 1e-3)
        if x.ndim:
            raise KeyboardInterrupt  # as the end of a run does

    pytest.importorskip("jax")
    function = jax_functions.CompiledFunction(compiles, clock)
    function(np.zeros(()))
    with pytest.raises(KeyboardInterrupt):
        function(np.zeros(2))
    begin_s = 1e-9 * clock._now_ns.now_ns
    headers = step_times.read_headers(tmp_path)
    (cut,) = call_times.read_all(tmp_path, headers, begin_s + 30.0).incidents
    assert (cut.name, cut.count, cut.is_unfinished) == (call_clock.RECOMPILED, 1, True)
    assert cut.seconds == pytest.approx(30.0, abs=0.1)
