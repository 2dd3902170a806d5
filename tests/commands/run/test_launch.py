"""Programs end when their seconds are over, whatever they ignore."""

import math
import os
import signal
import tempfile
from pathlib import Path

import pytest

from mjbench.commands.run import activities, launch, py_spy
from mjbench.commands.run.launch import Program
from mjbench.errors import InputError

STEPS = """
import mujoco, signal
signal.signal(signal.SIGINT, signal.{handler})
signal.signal(signal.SIGTERM, signal.{handler})
model = mujoco.MjModel.from_xml_string("<mujoco/>")
data = mujoco.MjData(model)
while True:
    mujoco.mj_step(model, data)
"""


MJX_STEPS = """
import time
import jax
from mujoco import mjx
end = time.monotonic() + 120
step = jax.jit(lambda state: state + 1.0)
while time.monotonic() < end:
    step(0.0)
"""


RAISES = """
import json
def load():
    raise ValueError("no such\\nrobot")
load()
"""


@pytest.fixture
def stubborn(tmp_path, monkeypatch):
    """Return a program that steps for ever, and ignores Ctrl-C and SIGTERM."""
    monkeypatch.setattr(launch, "_END_S", 0.2)
    file = tmp_path / "stubborn.py"
    file.write_text(STEPS.format(handler="SIG_IGN"))
    return Program([str(file)])


def test_a_program_is_ended_by_force_where_it_ignores_signals(stubborn):
    seen = launch.run(stubborn, seconds=0.2)
    assert seen.was_ended
    assert seen.exit_code == 128 + 9
    assert seen.steps[0].step.count > 0


def test_a_program_that_does_not_step_is_ended_when_its_time_is_over(tmp_path):
    file = tmp_path / "waits.py"
    file.write_text("import time\ntime.sleep(60)")
    seen = launch.run(Program([str(file)]), seconds=60.0, most_s=0.3)
    assert seen.was_ended
    assert all(times.nstep == 0 for times in seen.steps)


def test_a_program_of_mjx_is_ended_though_it_never_calls_the_engine(tmp_path, without_warp):
    pytest.importorskip("mujoco.mjx")
    file = tmp_path / "mjx_steps.py"
    file.write_text(MJX_STEPS)
    assert launch.run(Program([str(file)]), seconds=0.2).was_ended


@pytest.fixture
def full_disk():
    """Let no file be larger than one MiB, in this process and those that it starts."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.usefixtures("full_disk")
def test_a_program_runs_as_ever_where_its_steps_cannot_be_timed(tmp_path, monkeypatch, capfd):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    file = tmp_path / "program.py"
    file.write_text("import mujoco, sys\nsys.exit(7)")
    seen = launch.run(Program([str(file)]))
    assert seen.exit_code == 7
    assert capfd.readouterr() == ("", "")
    assert seen.pid in seen.untimed_pids
    assert seen.steps == []
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_and_the_program_whatever_it_ignores(stubborn, monkeypatch, number):
    first_step_ns = launch._first_step_ns

    def interrupt_once_it_steps(folder):
        first_ns = first_step_ns(folder)
        if first_ns is not None:
            os.kill(os.getpid(), number)
        return first_ns

    monkeypatch.setattr(launch, "_first_step_ns", interrupt_once_it_steps)
    monkeypatch.setattr(launch, "_END_S", math.inf)
    handler = signal.getsignal(number)
    seen = launch.run(stubborn, ends_on_signal=True)
    assert seen.was_interrupted
    assert seen.was_ended
    assert seen.exit_code == 128 + 9
    assert seen.models == (), "nothing is stepped again"
    assert signal.getsignal(number) is handler


def test_an_exception_that_ends_a_program_is_known_with_its_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    activities.shown_path.cache_clear()
    (tmp_path / "raises.py").write_text(RAISES)
    exception = launch.run(Program(["raises.py"])).exception
    assert exception.text == "ValueError: no such robot"
    assert (exception.place.file, exception.place.line) == ("raises.py", 4)
    assert not exception.is_of_model


def test_a_model_with_too_little_memory_is_told_what_helps(tmp_path):
    file = tmp_path / "1.exception"
    file.write_text("FatalError: mj_stackAlloc: out of memory, stack overflow max = 1\n")
    exception = launch._exception(file)
    assert exception.is_of_model
    assert "fusestatic" in exception.text
    assert "max = 1" not in exception.text


def test_a_program_that_exits_has_no_exception(tmp_path):
    file = tmp_path / "exits.py"
    file.write_text("raise SystemExit(3)")
    seen = launch.run(Program([str(file)]))
    assert (seen.exit_code, seen.exception, seen.was_interrupted) == (3, None, False)


def test_a_program_ends_where_the_profiler_cannot_start(stubborn, monkeypatch):
    processes = []
    start_program = launch._start

    def start(program, folder, environment):
        processes.append(start_program(program, folder, environment))
        return processes[0]

    def refuse(*arguments):
        raise OSError("No space left on device")

    monkeypatch.setattr(launch, "_start", start)
    monkeypatch.setattr(py_spy, "start", refuse)
    with pytest.raises(OSError, match="No space left"):
        launch.run(stubborn)
    assert processes[0].returncode is not None, "it has ended"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-m"], "name of a module"),
        (["missing.py"], "no such file"),
        (["x" * 5000], "no such file"),
        (["notes.ipynb"], "notebook"),
    ],
)
def test_what_cannot_be_run_is_refused(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.ipynb").write_text("{}")
    with pytest.raises(InputError, match=message):
        launch.check(Program(arguments))


def test_a_file_whose_name_begins_with_a_dash_is_no_option_of_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = "-cprint('INJECTED')#.py"
    (tmp_path / name).write_text("import sys; sys.exit(7)")
    assert Program([name, "-x"], "python").command == ["python", f"./{name}", "-x"]
    assert launch.run(Program([name])).exit_code == 7
    assert Program(["-m", "work"], "python").command == ["python", "-m", "work"]


def test_a_crash_is_at_the_users_own_line(tmp_path):
    clock = f"{Path(launch.__file__).parent}/hook/step_clock.py"
    stack = [
        (clock, 176, "call"),
        ("/home/me/train.py", 7, "work"),
        ("/home/me/train.py", 9, "main"),
    ]
    lines = [f'  File "{file}", line {line} in {function}' for file, line, function in stack]
    (tmp_path / "1.fault").write_text("\n".join(["Fatal Python error: Segmentation fault", *lines]))
    place = launch._crash(tmp_path)
    assert (str(place), place.function) == ("/home/me/train.py:7", "work")
