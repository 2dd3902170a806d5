"""Models that a path steps which compiles: what their environments hold."""

from pathlib import Path

import pytest

from mjbench.commands.versions import accelerated_environments
from mjbench.commands.versions.accelerated_environments import AcceleratedComparison
from mjbench.errors import InputError
from mjbench.paired.metrics import Metric
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.timed_function import FunctionSource
from mjbench.releases import named_packages
from mjbench.releases.release_names import INSTALLED, ReleaseSpec
from mjbench.simulation import models

HERE = {"mujoco": "4.0.0", "mujoco-mjx": "3.17.0", "jax": "0.9.0"}


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(named_packages, "versions", lambda folder: HERE)


def with_engine(spec: ReleaseSpec) -> ReleaseSpec:
    comparison = AcceleratedComparison([spec, spec], [], ["mjx"], Sizes())
    return accelerated_environments.with_engines(comparison).specs[0]


def test_mjx_stands_beside_the_named_packages_in_the_version_that_is_installed_here() -> None:
    named = ("jax==0.7.0", "jaxlib==0.7.0")
    jax = ",".join(named)
    spec = with_engine(ReleaseSpec(jax, "4.0.0", requirements=named, has_packages=True))
    assert spec.requirements == (*named, "mujoco-mjx==3.17.0")
    assert spec.label == jax


def test_what_is_named_stays() -> None:
    named = ("mujoco-mjx==3.3.0", "jax==0.7.0")
    spec = ReleaseSpec("x", "4.0.0", requirements=named, has_packages=True)
    assert with_engine(spec).requirements == named


def test_another_release_gets_what_pip_chooses() -> None:
    spec = with_engine(ReleaseSpec("3.5.0", "3.5.0"))
    assert spec.requirements == ("jax", "mujoco-mjx")
    assert spec.label == "mujoco==3.5.0"


def test_this_environment_is_refused() -> None:
    with pytest.raises(InputError, match="name the packages in place of installed"):
        with_engine(ReleaseSpec(INSTALLED, "4.0.0"))


def source_of(path: str, folder: Path, metric: Metric = Metric.TIME) -> FunctionSource:
    model, workload, cache = models.resolve("cartpole"), folder / "workload", folder / "cache"
    return accelerated_environments._source(model, path, workload, cache, metric)


def test_a_module_compiles_without_the_cache_where_compiling_is_compared(tmp_path: Path) -> None:
    cache = str(tmp_path / "cache").encode()
    steps, compiling = (source_of("mjx", tmp_path, m).text for m in (Metric.TIME, Metric.COMPILE))
    assert steps is not None
    assert compiling is not None
    assert b"= compiled_step(" in steps
    assert cache in steps
    assert b"= compilation(" in compiling
    assert cache not in compiling


@pytest.mark.parametrize("path", ["mjx", "warp"])
def test_the_module_of_a_model_has_no_package_s_name(path: str, tmp_path: Path) -> None:
    source = source_of(path, tmp_path)
    assert source.module not in {"jax", "mjx", "mujoco", "mujoco_warp", "warp"}
    assert source.file == f"{source.module}.py"
