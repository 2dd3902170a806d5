"""`mjbench run` finds what was planted in programs, and leaves the programs as they are."""

import functools
import json
import signal
import sys
import threading
from pathlib import Path

import program_runs
import pytest
from commands import ROOT, mjbench, mjbench_process, python, started

PLANTED = ROOT / "tests" / "commands" / "run" / "planted"
HUMANOID = str(ROOT / "models" / "humanoid.xml")


@pytest.fixture(scope="module", autouse=True)
def brief():
    with pytest.MonkeyPatch.context() as patch:
        program_runs.measure_briefly(patch)
        yield


def run(tmp_path, *arguments, env=None):
    """Run `mjbench run`; return how it ended, without the program's output, and the row of its
    document.
    """
    document = tmp_path / "run.json"
    words = ("run", "--json", str(document), *map(str, arguments))
    done = mjbench(*words, cwd=tmp_path, env=env)
    if not document.exists():
        return done, None
    (row,) = json.loads(document.read_text())["results"]
    if row["status"] == "unavailable" and "SYS_PTRACE" in row["detail"]:
        pytest.skip(f"no profiler here: {row['detail']}")
    return done, row


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """Return a function that runs a program once; it returns what `run` does, and the folder."""

    @functools.cache
    def run_once(program, *arguments):
        folder = tmp_path_factory.mktemp("planted")
        # more samples than usual, so that short programs have enough
        return *run(folder, "--sample-rate", "100", PLANTED / program, HUMANOID, *arguments), folder

    return run_once


@pytest.mark.parametrize(
    ("program", "arguments", "activity"),
    [
        ("collector.py", ["2000"], "garbage collection"),
        ("vector_env.py", ["1500", "fork"], "waiting for other processes"),
    ],
)
def test_the_planted_cause_comes_first(planted, program, arguments, activity):
    done, row, _ = planted(program, *arguments)
    assert done.returncode == 0, done.stderr
    first = row["loops"][0]["remedies"][0]
    assert first["activity"] == activity
    assert first["gain"] > 0.1
    (conclusion, *_) = [line for line in done.stderr.splitlines() if line.startswith(program)]
    assert f"first, {activity}" in conclusion
    shares = row["loops"][0]["time"]["activities"].values()
    assert sum(shares) == pytest.approx(1.0)


def test_slow_python_without_a_known_change_is_named_as_that(planted):
    program = "slow_observation.py"
    done, row, _ = planted(program, "6000")
    assert done.returncode == 7, done.stderr
    assert all(each["activity"] != "Python" for each in row["loops"][0]["remedies"])
    lines = [line for line in done.stderr.splitlines() if line.startswith(program)]
    ending, conclusion = lines[:2]  # how it ended comes first
    assert ending == f"{program}: it ended with exit code 7"
    assert f"{program}: your own Python and NumPy at" in conclusion


def test_a_stored_view_comes_first_since_it_is_a_wrong_result(tmp_path, capfd):
    done, row = run(
        tmp_path, "--sample-rate", "100", PLANTED / "stored_views.py", HUMANOID, "10000"
    )
    assert capfd.readouterr().out == "10000\n"
    assert row["wrong"][0]["code"] == "MJB001"
    assert "correct a wrong result" in done.stderr


def can_render():
    """Return whether MuJoCo draws by EGL here."""
    model = "mujoco.MjModel.from_xml_string('<mujoco/>')"
    text = f"import mujoco; mujoco.Renderer({model}).render()"
    return python("-c", text, env={"MUJOCO_GL": "egl"}).returncode == 0


def test_rendering_comes_first(tmp_path):
    if not can_render():
        pytest.skip("MuJoCo cannot draw by EGL here")
    done, row = run(
        tmp_path,
        *("--sample-rate", "20", "--seconds", "3", PLANTED / "rendering.py", HUMANOID, "100000"),
        env={"MUJOCO_GL": "egl"},
    )
    assert row["was_ended"]
    assert done.returncode == 0
    assert "images are drawn for a simulated second" in done.stderr


def test_a_policy_comes_first(tmp_path):
    pytest.importorskip("torch", reason="PyTorch is not installed")
    done, _ = run(tmp_path, "--sample-rate", "100", PLANTED / "policy.py", HUMANOID, "20000")
    assert "policy.py: policy at" in done.stderr


def test_output_input_arguments_and_exit_code_are_the_programs(tmp_path):
    program = tmp_path / "talk.py"
    program.write_text(
        "import sys\nprint(sys.argv[1:], input())\nprint('to stderr', file=sys.stderr)\nsys.exit(5)"
    )
    words = ["run", str(program), "--seconds", "-m", "--help"]
    done = mjbench_process(*words, cwd=tmp_path, input="typed\n")
    assert done.returncode == 5
    assert done.stdout == "['--seconds', '-m', '--help'] typed\n"
    assert "to stderr" in done.stderr


def test_a_module_runs_with_its_arguments(tmp_path, capfd):
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "train.py").write_text("import sys\nprint(__name__, sys.argv[1:])")
    done, row = run(tmp_path, "-m", "package.train", "--json", "x")
    assert done.returncode == 0, done.stderr
    assert capfd.readouterr().out == "__main__ ['--json', 'x']\n"
    assert row["program"] == "package.train"


def test_an_exception_is_shown_as_python_shows_it(tmp_path, capfd):
    program = tmp_path / "broken.py"
    program.write_text("raise RuntimeError('mine')")
    plain = python(str(program))
    done, row = run(tmp_path, program)
    assert done.returncode == 1
    assert capfd.readouterr().err == plain.stderr
    assert row["exit_code"] == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a program"),
        (["missing.py"], "no such file: missing.py"),
        (["--sample-rate", "0", "x.py"], "--sample-rate"),
    ],
)
def test_bad_usage_is_one_line(tmp_path, arguments, message):
    done = mjbench("run", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_json_on_standard_output_is_refused(tmp_path):
    (tmp_path / "x.py").touch()
    done = mjbench("run", "--json", "-", "x.py", cwd=tmp_path)
    assert done.returncode == 2
    assert "standard output is the program's own" in done.stderr


def test_a_missing_profiler_is_named_with_what_installs_it(tmp_path, monkeypatch):
    from mjbench.commands.run import py_spy
    from mjbench.errors import UnavailableError

    monkeypatch.setattr(py_spy.sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UnavailableError, match="pip install"):
        py_spy.program()


def test_a_signal_reaches_the_program_and_the_report_comes(tmp_path):
    if sys.platform == "win32":
        pytest.skip("no signals on this platform")
    program = tmp_path / "patient.py"
    program.write_text(
        "import pathlib, time\npathlib.Path('ready').touch()\n"
        "try:\n    while True: time.sleep(0.01)\n"
        "except KeyboardInterrupt:\n    print('cleaned up')\n    raise SystemExit(9)\n"
    )
    words = ["run", "--json", "run.json", str(program)]
    process = started("-m", "mjbench", *words, cwd=tmp_path)
    while not Path(tmp_path / "ready").exists():
        assert process.poll() is None
        threading.Event().wait(0.05)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 9, errors
    assert output == "cleaned up\n"
    assert (tmp_path / "run.json").exists()


def test_a_stored_run_is_shown_and_reported(planted, tmp_path):
    *_, folder = planted("collector.py", "2000")
    (file,) = (folder / "results" / "runs").glob("*.jsonl")
    shown = mjbench("show", str(file), "--json", "-")
    assert json.loads(shown.stdout)["results"][0]["program"] == "collector.py"
    page = tmp_path / "report.html"
    assert mjbench("show", str(file), "--html", str(page)).returncode == 0
    assert "garbage collection" in page.read_text()
