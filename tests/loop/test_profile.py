"""Where a step's time goes: the page, and what it is made of."""

import json
from pathlib import Path

import pytest
from commands import mjbench
from rich.console import Console

from mjbench.errors import InputError
from mjbench.loop import profile
from mjbench.loop.profile import Frame, StepProfile
from mjbench.report import profile as report
from mjbench.simulation import compat, models


def made(**more: object) -> StepProfile:
    about = {
        "model": "pole",
        "timestep": 0.002,
        "loop_ns": 3000.0,
        "engine_ns": 2000.0,
        "clock_ns": 500.0,
        "work": {"contacts": 4.0, "solver_iterations": 2.5},
        "stages": {"kinematics": 0.25, "other": 0.75, "actuation": 0.0},
        "frames": [Frame("egl", 0.01), Frame("osmesa", None, "it needs libosmesa6")],
    }
    return StepProfile(**(about | more))  # type: ignore[arg-type]


def test_a_second_of_simulated_time_is_physics_python_and_frames() -> None:
    found = made().simulated_second()
    assert found == pytest.approx(
        {"physics": 500 * 2e-6, "Python": 500 * 1e-6, "rendering (egl)": 60 * 0.01}
    )


def test_the_page_tells_all_parts(capsys: pytest.CaptureFixture[str]) -> None:
    report.print_profile(Console(width=120, highlight=False), made())
    page = capsys.readouterr().out
    assert "takes 3 µs: engine 2 µs (67 %), Python 1 µs" in page
    assert "4 contacts, 2.5 solver iterations" in page
    assert "clock, which these timers need, is 17 % of it" in page
    assert "kinematics" in page
    assert "actuation" not in page  # takes no time
    assert "by egl: 10 ms, as long as 3,333 steps" in page
    assert "osmesa: not available (it needs libosmesa6)" in page


def test_a_release_without_a_clock_of_its_own_says_nothing_of_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    report.print_profile(Console(width=120), made(clock_ns=None))
    assert "clock" not in capsys.readouterr().out


def test_stages_are_shares_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    model = models.load(models.resolve("cube_table"))
    for clock in (compat.has_clock, lambda model: False):
        monkeypatch.setattr(compat, "has_clock", clock)
        found = profile._stages(model, 20)
        assert sum(found.values()) == pytest.approx(1.0)
        assert all(share >= 0 for share in found.values())
        assert found["constraint solver"] > 0


def test_the_command_measures_and_writes_json(tmp_path: Path) -> None:
    done = mjbench("profile", "cartpole", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["loop_ns"] > 0
    assert row["engine_ns"] > 0
    assert row["python_ns"] == pytest.approx(row["loop_ns"] - row["engine_ns"])
    assert sum(row["stages"].values()) == pytest.approx(1.0)
    assert [frame["backend"] for frame in row["frames"]] == ["egl", "osmesa"]
    for frame in row["frames"]:
        assert (frame["seconds"] is None) == bool(frame["detail"])


def test_a_model_that_does_not_load_is_bad_input_and_costs_its_row(tmp_path: Path) -> None:
    file = tmp_path / "broken.xml"
    file.write_text("<mujoco><nothing/></mujoco>")
    with pytest.raises(InputError):
        profile.measure(models.resolve(str(file)))
    done = mjbench("profile", "broken.xml", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2
    assert "broken.xml: " in done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["status"] == "input"
