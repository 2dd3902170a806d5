"""A Ray that is started here is open to nobody else."""

import contextlib
import os
import sys

import pytest

from mjbench.host import ray_environment
from mjbench.sweep import ray_session
from mjbench.sweep.ray_session import LOCAL


@pytest.fixture
def no_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray was not imported yet, and there is no secret."""
    monkeypatch.setattr(ray_environment, "_secret", {})
    monkeypatch.delitem(sys.modules, "ray", raising=False)
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    monkeypatch.delenv("RAY_AUTH_TOKEN", raising=False)


@pytest.mark.usefixtures("no_ray")
def test_the_secret_is_in_the_environment_for_the_block_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "a cluster")
    with ray_environment.local({"RAY_ADDRESS": None}):
        first = os.environ["RAY_AUTH_TOKEN"]
        assert len(first) == 64
        assert os.environ["RAY_AUTH_MODE"] == "token"
        assert "RAY_ADDRESS" not in os.environ
    assert "RAY_AUTH_TOKEN" not in os.environ
    assert os.environ["RAY_ADDRESS"] == "a cluster"


@pytest.mark.usefixtures("no_ray")
@pytest.mark.parametrize(("address", "mode"), [(LOCAL, "token"), ("10.0.0.1:6379", None)])
def test_a_sweep_starts_ray_with_the_secret_and_joins_other_clusters_without(
    monkeypatch: pytest.MonkeyPatch, address: str, mode: str | None
) -> None:
    modes = []
    monkeypatch.setattr(
        ray_session, "_start", lambda *_, **__: modes.append(os.environ.get("RAY_AUTH_MODE"))
    )
    with contextlib.ExitStack() as closing:
        ray_session._connect(address, closing)
    assert modes == [mode]
