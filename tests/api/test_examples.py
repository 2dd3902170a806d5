"""The examples of docs/python.md run, with shorter limits."""

import functools
import re
from pathlib import Path
from typing import Any

import pytest
from commands import ROOT
from pytest_runs import run_pytest

import mjbench
from mjbench.commands.profile import rendering
from mjbench.results import runs


def blocks(page: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S)


BLOCKS = blocks("docs/python.md")
TESTS = [block for block in BLOCKS if block.startswith("# test_")]


def test_the_examples_of_a_program_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    inline: None,
) -> None:
    sizes: dict[str, Any] = {"nbatch": 2, "nstep": 4, "threads": 1, "paths": "rollout"}
    compare, versions = mjbench.compare, mjbench.versions

    def briefly(*models: Any, **options: Any) -> Any:
        return compare(*models, **{**options, **sizes, "budget_s": 0.1})

    def installed(*releases: str, **options: Any) -> Any:
        options |= {"models": "cartpole", "budget_s": 0.1, "as_shipped": True}
        return versions(*["installed"] * len(releases), **options)

    (tmp_path / "robot.xml").symlink_to(ROOT / "models/humanoid.xml")
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mjbench, "compare", briefly)
    monkeypatch.setattr(mjbench, "versions", installed)
    monkeypatch.setattr(mjbench, "latency", functools.partial(mjbench.latency, nstep=100))
    monkeypatch.setattr(mjbench, "profile", functools.partial(mjbench.profile, budget_s=0.1))
    monkeypatch.setattr(rendering, "BACKENDS", ())
    names: dict[str, Any] = {}
    for block in BLOCKS:
        if not block.startswith("# test_"):
            exec(block, names)
    printed = capsys.readouterr().out
    assert "humanoid: 2 simulations × 4 steps" in printed
    assert "no model 'humanoit' (did you mean humanoid?)" in printed
    assert "1,000 steps" in printed
    assert names["table"] == names["comparison"].rows()
    assert runs.newest_first(Path("results/runs"))[0] == names["file"]


def test_the_example_of_a_test_runs(tmp_path: Path) -> None:
    (block,) = TESTS
    done = run_pytest(tmp_path, block)
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout or "1 skipped" in done.stdout
