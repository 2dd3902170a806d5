"""What `mjbench versions` measures in environments; nothing is installed or started."""

import pytest

from mjbench.api.versions import measurement_of
from mjbench.errors import InputError
from mjbench.paired.metrics import Metric
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases import installs
from mjbench.simulation import models

SOURCES = [models.resolve("cartpole")]


@pytest.mark.parametrize("package", ["jax", "jaxlib", "mujoco-mjx", "warp-lang", "own-tool"])
def test_packages_that_the_plain_loop_does_not_use_need_a_path_or_a_function(package: str) -> None:
    specs = [installs.parse_release(f"{package}=={version}") for version in ("0.7.0", "0.7.1")]
    with pytest.raises(InputError, match=rf"does not use {package}: name a path"):
        measurement_of(specs, SOURCES, None, VerdictPlan())
    arguments = measurement_of(specs, SOURCES, ["python_loop"], VerdictPlan()).arguments
    assert [target.path for target in arguments["targets"]] == ["python_loop", "python_loop"]


def test_numpy_is_of_the_plain_loop() -> None:
    specs = [installs.parse_release(f"numpy=={version}") for version in ("2.3.5", "2.4.0")]
    arguments = measurement_of(specs, SOURCES, None, VerdictPlan()).arguments
    assert [target.path for target in arguments["targets"]] == ["python_loop", "python_loop"]


def test_compiled_paths_are_compared_in_each_pair_of_environments() -> None:
    specs = [installs.parse_release(f"jax==0.7.{patch}") for patch in range(3)]
    arguments = measurement_of(specs, SOURCES, ["mjx", "mjx64"], VerdictPlan()).arguments
    assert (arguments["paths"], arguments["family"]) == (["mjx", "mjx64"], 4)


def test_paths_that_compile_are_compared_by_their_time_or_by_compiling() -> None:
    specs = [installs.parse_release(f"jax==0.7.{patch}") for patch in range(2)]
    compiling = VerdictPlan(sizes=Sizes(metric=Metric.COMPILE))
    arguments = measurement_of(specs, SOURCES, ["mjx"], compiling).arguments
    assert arguments["sizes"]["metric"] == Metric.COMPILE
    memory = VerdictPlan(sizes=Sizes(metric=Metric.MEMORY))
    with pytest.raises(InputError, match=r"mjx .* alone, by time or compile: .* --metric memory"):
        measurement_of(specs, SOURCES, ["mjx"], memory)
    with pytest.raises(InputError, match="alone, by time or compile: leave out rollout"):
        measurement_of(specs, SOURCES, ["mjx", "rollout"], VerdictPlan())
    with pytest.raises(InputError, match="is of paths that compile only"):
        measurement_of(specs, SOURCES, ["python_loop"], compiling)
