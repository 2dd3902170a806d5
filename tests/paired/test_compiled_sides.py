"""Models that a path steps which compiles: what their environments hold."""

import pytest

from mjbench.errors import InputError
from mjbench.paired import compiled_sides
from mjbench.paired.compiled_sides import CompiledComparison
from mjbench.paired.run_sizes import Sizes
from mjbench.releases import packages
from mjbench.releases.installs import INSTALLED, ReleaseSpec

HERE = {"mujoco": "4.0.0", "mujoco-mjx": "3.17.0", "jax": "0.9.0"}


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "versions", lambda folder: HERE)


def with_engine(spec: ReleaseSpec) -> ReleaseSpec:
    comparison = CompiledComparison(spec, [spec], [], ["mjx"], Sizes())
    return compiled_sides.with_engines(comparison).baseline


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
