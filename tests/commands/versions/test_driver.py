"""What `mjbench versions` and `mjbench ab` measure; nothing is installed or started."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from set_files import MACHINE, run_file

from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.versions import driver as verdict_measurements
from mjbench.commands.versions.driver import between_releases, completed_share
from mjbench.commands.versions.function_sides import FunctionName, FunctionTarget, FunctionTargets
from mjbench.errors import InputError
from mjbench.interval import Interval
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.timed_function import CodeOrigin, FunctionSource
from mjbench.paired.verdict import Judgement, VerdictPlan
from mjbench.releases import release_names
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Revision
from mjbench.results import runs
from mjbench.session import Observer
from mjbench.simulation import models
from mjbench.status import Status

SOURCES = [models.resolve("cartpole")]
MAIN, HEAD = Revision("main", "a" * 40), Revision("HEAD", "b" * 40)


class Comparison:
    """Stands for a comparison of two revisions with the same files, so that nothing is timed."""

    baseline, candidate, files, notes, own_files = MAIN, HEAD, (), (), False
    functions = tuple(
        FunctionName(f"bench.py::{name}", name, Path("bench.py")) for name in ("a", "b")
    )


def targets(function: FunctionName) -> tuple[FunctionTarget, FunctionTarget]:
    baseline = FunctionTarget(
        function.text,
        MAIN,
        "tree",
        FunctionSource(function.name, "bench", "bench.py", b""),
        CodeOrigin(frozenset(), (), ""),
        ReleaseSpec("installed", "4.0.0"),
    )
    return baseline, replace(baseline, revision=HEAD)


def test_what_a_run_file_holds_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        verdict_measurements.function_sides,
        "check_out",
        lambda *_: [*map(targets, Comparison.functions)],
    )
    comparison: Any = Comparison()
    measurement = verdict_measurements.between_revisions(comparison, VerdictPlan())
    first, second = (
        record for item in measurement.measure([], Observer()) for record in item.records
    )
    stored = runs.load(run_file(tmp_path, MACHINE, first, command="ab"), RECORD_TYPES)
    (item,) = measurement.measure(stored.records, Observer())
    (record,) = item.records
    assert isinstance(record, type(second))
    assert record.model == "bench.py::b"


@pytest.mark.parametrize(("family", "expected"), [(1, 2), (30, 30)])
def test_progress_is_of_this_run_where_other_runs_are_of_the_family_too(
    family: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def decide(
        pool: object,
        sides: FunctionTargets,
        plan: VerdictPlan,
        on_launch: Callable[[Judgement], None],
    ) -> VerdictRecord:
        assert (plan.family, plan.as_shipped) == (expected, True)
        on_launch(Judgement(Verdict.SAME, Interval(1.0, 0.999, 1.001), 8, True))
        old, new = (side.row() for side in sides)
        return VerdictRecord(
            model=new.model, path="", old="main", new="HEAD", sides=(old, new), status=Status.OK
        )

    monkeypatch.setattr(
        verdict_measurements.function_sides,
        "check_out",
        lambda *_: [*map(targets, Comparison.functions)],
    )
    monkeypatch.setattr(verdict_measurements.function_verdict, "decide_function", decide)
    comparison: Any = Comparison()
    measurement = verdict_measurements.between_revisions(comparison, VerdictPlan(family=family))
    shares: list[float] = []
    list(measurement.measure([], Observer(lambda name, share: shares.append(share))))
    done = completed_share(8) / 2
    assert shares == [0.0, done, 0.5, 0.5 + done]
    assert measurement.arguments["family"] == expected


@pytest.mark.parametrize("package", ["jax", "jaxlib", "mujoco-mjx", "warp-lang", "own-tool"])
def test_packages_that_the_plain_loop_does_not_use_need_a_path_or_a_function(package: str) -> None:
    specs = [release_names.parse_release(f"{package}=={version}") for version in ("0.7.0", "0.7.1")]
    with pytest.raises(InputError, match=rf"does not use {package}: name a path"):
        between_releases(specs, SOURCES, None, VerdictPlan())
    arguments = between_releases(specs, SOURCES, ["python_loop"], VerdictPlan()).arguments
    assert [target.path for target in arguments["targets"]] == ["python_loop", "python_loop"]


def test_numpy_is_of_the_plain_loop() -> None:
    specs = [release_names.parse_release(f"numpy=={version}") for version in ("2.3.5", "2.4.0")]
    arguments = between_releases(specs, SOURCES, None, VerdictPlan()).arguments
    assert [target.path for target in arguments["targets"]] == ["python_loop", "python_loop"]


def test_compiled_paths_are_compared_in_each_pair_of_environments() -> None:
    specs = [release_names.parse_release(f"jax==0.7.{patch}") for patch in range(3)]
    arguments = between_releases(specs, SOURCES, ["mjx", "mjx64"], VerdictPlan()).arguments
    assert (arguments["paths"], arguments["family"]) == (["mjx", "mjx64"], 4)


def test_paths_that_compile_are_compared_by_their_time_or_by_compiling() -> None:
    specs = [release_names.parse_release(f"jax==0.7.{patch}") for patch in range(2)]
    compiling = VerdictPlan(sizes=Sizes(metric=Metric.COMPILE))
    arguments = between_releases(specs, SOURCES, ["mjx"], compiling).arguments
    assert arguments["sizes"]["metric"] == Metric.COMPILE
    memory = VerdictPlan(sizes=Sizes(metric=Metric.MEMORY))
    with pytest.raises(InputError, match=r"mjx .* alone, by time or compile: .* --metric memory"):
        between_releases(specs, SOURCES, ["mjx"], memory)
    with pytest.raises(InputError, match="alone, by time or compile: leave out rollout"):
        between_releases(specs, SOURCES, ["mjx", "rollout"], VerdictPlan())
    with pytest.raises(InputError, match="is of paths that compile only"):
        between_releases(specs, SOURCES, ["python_loop"], compiling)
