"""`mjbench compare` with paths that compile, and sweeps."""

from pathlib import Path

import pytest
from commands import mjbench
from example_models import CONTACT_XML
from pretender import available

from mjbench.commands.compare.options import CompareOptions


@pytest.fixture
def short_race(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have paths that run C take 0.1 s of a model; those that compile take what they need."""
    monkeypatch.setattr(CompareOptions, "EACH_S", 0.1)


def test_a_jax_without_a_device_is_not_said_to_be_the_models_fault(
    tmp_path: Path, without_warp: None, short_race: None
) -> None:
    available("mjx")
    words = ["--paths", "mjx", "--nbatch", "2", "--nstep", "4"]
    run = mjbench("compare", "cartpole", *words, cwd=tmp_path, env={"JAX_PLATFORMS": "abacus"})
    assert run.returncode == 3
    assert "JAX finds no device" in run.stdout
    assert "does not take" not in run.stdout


def test_a_model_that_mjx_does_not_take_is_reported_with_its_own_reason(
    tmp_path: Path, without_warp: None, short_race: None
) -> None:
    path = available("mjx")
    solver = '<mujoco><option solver="PGS"/>'
    (tmp_path / "pgs.xml").write_text(CONTACT_XML.replace("<mujoco>", solver))
    run = mjbench("compare", "pgs.xml", "--paths", path.name, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "MJX does not take this model" in run.stdout


def test_targets_that_take_turns_cannot_be_accelerated() -> None:
    run = mjbench("ab", "pile,path=mjx", "path=rollout")
    assert run.returncode == 2
    assert "mjbench compare --paths mjx" in run.stderr
