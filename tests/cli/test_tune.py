"""`mjbench tune` from the command line: what it prints and stores, and bad input."""

import contextlib
import json
import signal
import time

import psutil
import pytest
from commands import ROOT, mjbench, started

CARTPOLE = ROOT / "models" / "cartpole.xml"


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Return a folder in which a cart-pole was tuned, with a brief budget, and the process."""
    folder = tmp_path_factory.mktemp("tuned")
    arguments = ["tune", str(CARTPOLE), "--allow", "free", "--budget", "5s", "--only", "program"]
    arguments += ["--json", "tune.json", "--results", "runs"]
    return folder, mjbench(*arguments, cwd=folder)


def test_it_ends_well_and_stores_what_it_tried(tuned):
    folder, done = tuned
    assert done.returncode == 0, done.stderr
    (record,) = json.loads((folder / "tune.json").read_text())["results"]
    assert record["status"] == "ok"
    assert record["present"]["error"] is None, "no reference is needed for what changes nothing"
    assert record["present"]["nrun"] == 64
    tried = [each["settings"][0]["label"] for each in record["attempts"]]
    assert "timer off" in tried
    # whatever this machine finds faster is free, and was confirmed
    for each in record["front"]:
        assert each["effect"] == "free"
        assert each["ratio"]["high"] < 1
        assert each["accuracy"]["distance"]["share"] == 0.0


def test_a_stored_search_is_shown_and_reported(tuned):
    folder, done = tuned
    (run,) = (folder / "runs").iterdir()
    shown = mjbench("show", str(run), cwd=folder)
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.splitlines()[1] in done.stdout
    report = mjbench("show", str(run), "--html", "a.html", "--markdown", "a.md", cwd=folder)
    assert report.returncode == 0, report.stderr
    for name in ("a.html", "a.md"):
        assert "No reference was run" in (folder / name).read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nosuch"], "no model 'nosuch'"),
        (["empty.xml"], "is empty"),
        (["cartpole", "--max-error", "0"], "above 0% and below"),
        (["cartpole", "--allow", "cheap"], "cheap"),
        (["cartpole", "--skip", "timestp"], "did you mean timestep"),
        (["cartpole", "--states", "missing.npz"], "no such file"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_measured(tmp_path, arguments, message):
    (tmp_path / "empty.xml").touch()
    done = mjbench("tune", *arguments, "--results", "runs", cwd=tmp_path)
    assert done.returncode in (2, 3)
    assert message in done.stderr
    assert not list(tmp_path.glob(".*")), "nothing is left"


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<mujoco><worldbody/></mujoco>", "no degree of freedom"),
        ("<mujoco>", "cannot load"),
        (
            '<mujoco><option timestep="0.5"/><worldbody><body><joint stiffness="1e9"/>'
            '<geom size="0.1" pos="1 0 0"/></body></worldbody><keyframe><key qpos="1"/></keyframe>'
            "</mujoco>",
            "diverge",
        ),
    ],
)
def test_a_model_that_cannot_be_stepped_is_one_line_and_others_go_on(
    tmp_path, xml, message, inline
):
    (tmp_path / "bad.xml").write_text(xml)
    done = mjbench("tune", "bad.xml", "--results", "runs", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("bad.xml")]
    assert message in line


def measures(pid: int) -> bool:
    """Return whether a process measures in a child; it starts others as it imports MuJoCo."""
    lines = []
    for child in psutil.Process(pid).children():
        with contextlib.suppress(psutil.NoSuchProcess):
            lines.append(child.cmdline())
    return any("isolate" in word for line in lines for word in line)


def test_ctrl_c_keeps_what_was_tried(tmp_path):
    words = ["tune", str(CARTPOLE), "--results", "runs", "--json", "tune.json"]
    process = started("-m", "mjbench", *words, cwd=tmp_path)
    while process.poll() is None and not measures(process.pid):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in out and "what was measured is saved" in err
    assert "Traceback" not in out + err
    (record,) = json.loads((tmp_path / "tune.json").read_text())["results"]
    assert record["status"] == "interrupted"
