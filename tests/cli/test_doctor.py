"""`mjbench doctor`: conditions, what can be decided, and the exit code."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import mjbench

from mjbench.cli import cli
from mjbench.commands.doctor import detectable_change
from mjbench.commands.doctor.detectable_change import Noise
from mjbench.commands.profile import rendering
from mjbench.commands.profile.rendering import FrameTime
from mjbench.errors import MachineError
from mjbench.host import conditions
from mjbench.host.conditions import Condition, Grade
from mjbench.paired.worker_pool import WorkerPool

QUIET = Noise(launches=20, deviation=0.003, launch_s=0.6, ratio=1.0)


@pytest.fixture(autouse=True)
def _briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Load a core for the share that the host takes no longer than for a first reading."""
    monkeypatch.setattr(conditions, "_STOLEN_S", 0.01)


def test_a_machine_is_described_and_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(detectable_change, "MIN_LAUNCHES", 2)
    done = mjbench("doctor", "--budget", "8s", "--json", "out.json", cwd=tmp_path)
    assert done.returncode in (0, 1), done.stderr  # what it can decide depends on its noise
    document = json.loads((tmp_path / "out.json").read_text())
    assert {c["name"] for c in document["conditions"]} >= {"cores", "load", "Python", "clock"}
    noise = document["noise"]
    assert noise["launches"] >= 2
    assert noise["trusted"] == (noise["decidable"] <= 0.01)
    is_bad = any(condition["grade"] == "bad" for condition in document["conditions"])
    assert (done.returncode == 0) == (noise["trusted"] and not is_bad)
    assert ("Bad for measuring: " in done.stdout) == is_bad
    assert "decide changes of 1 % now: a verdict of a minute decides those of" in done.stdout


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    monkeypatch.setattr(detectable_change, "noise", lambda pool, seconds: QUIET)
    monkeypatch.setattr(detectable_change, "clock_share", lambda: 0.3)
    monkeypatch.setattr(conditions, "all_conditions", lambda others: [])
    monkeypatch.setattr(
        rendering, "measure", lambda model, backend, limit_s: FrameTime(backend, 0.004)
    )
    yield monkeypatch


@pytest.mark.parametrize(("deviation", "code"), [(0.003, 0), (0.05, 1)])
def test_noise_decides_the_exit_code(
    quick: pytest.MonkeyPatch, deviation: float, code: int
) -> None:
    noise = replace(QUIET, deviation=deviation)
    quick.setattr(detectable_change, "noise", lambda pool, seconds: noise)
    result = CliRunner().invoke(cli, ["doctor"])
    assert result.exit_code == code, result.output
    assert ("cannot decide changes of 1 %" in result.output) == bool(code)
    assert ("or --min-effect 3.9%" in result.output) == bool(code)
    assert "takes 30 % of a cart-pole's step" in result.output


def test_what_is_bad_fails_and_is_named_at_the_end(quick: pytest.MonkeyPatch) -> None:
    busy = Condition("load", Grade.BAD, "is 3.0 on 2 cores", "end other programs")
    quick.setattr(conditions, "all_conditions", lambda others: [busy])
    result = CliRunner().invoke(cli, ["doctor"])
    assert result.exit_code == 1
    assert result.output.splitlines()[-1].startswith("Bad for measuring: load.")


def test_interrupted_it_says_so_in_one_line(quick: pytest.MonkeyPatch) -> None:
    def interrupt(pool: WorkerPool, seconds: float) -> Noise:
        raise KeyboardInterrupt

    quick.setattr(detectable_change, "noise", interrupt)
    result = CliRunner().invoke(cli, ["doctor"])
    assert result.exit_code == 130
    assert result.stderr.endswith("mjbench: interrupted\n")


def test_backends_that_render_nothing_are_named(quick: pytest.MonkeyPatch) -> None:
    assert "egl 4.0 ms a frame" in CliRunner().invoke(cli, ["doctor"]).output
    quick.setattr(
        rendering, "measure", lambda model, backend, limit_s: FrameTime(backend, None, "no library")
    )
    result = CliRunner().invoke(cli, ["doctor"])
    assert result.exit_code == 0
    assert "egl: no library" in " ".join(result.output.split())


def test_a_check_that_fails_is_the_machines_fault(quick: pytest.MonkeyPatch) -> None:
    def fail(pool: WorkerPool, seconds: float) -> Noise:
        raise MachineError("no processes")

    quick.setattr(detectable_change, "noise", fail)
    result = CliRunner().invoke(cli, ["doctor"])
    assert result.exit_code == 3
    assert "Not measured: no processes" in result.output
