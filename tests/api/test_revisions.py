"""Measurements of functions in two revisions; nothing is started."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from set_files import MACHINE, run_file

from mjbench.api import revisions
from mjbench.api.session import Observer
from mjbench.measuring.ratio import Ratio
from mjbench.paired.function_pair import FunctionTarget, FunctionTargets
from mjbench.paired.judgement import Judgement
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.revision_sides import FunctionName
from mjbench.paired.timed_function import CodeOrigin, FunctionSource
from mjbench.paired.verdict import VerdictPlan, completed_share
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.revisions import Revision
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import runs

MAIN, HEAD = Revision("main", "a" * 40), Revision("HEAD", "b" * 40)


class Comparison:
    """Stands for a comparison of two revisions with the same files, so that nothing is timed."""

    baseline, candidate, files, notes = MAIN, HEAD, (), ()
    functions = tuple(FunctionName(f"bench:{name}", name, module="bench") for name in ("a", "b"))


def targets(function: FunctionName) -> tuple[FunctionTarget, FunctionTarget]:
    baseline = FunctionTarget(
        function.text,
        MAIN,
        "tree",
        FunctionSource(function.name, "bench"),
        CodeOrigin(frozenset(), (), ""),
        ReleaseSpec("installed", "4.0.0"),
    )
    return baseline, replace(baseline, revision=HEAD)


def test_what_a_run_file_holds_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        revisions.revision_sides, "check_out", lambda *_: [*map(targets, Comparison.functions)]
    )
    comparison: Any = Comparison()
    measurement = revisions.revision_verdicts(comparison, VerdictPlan())
    first, second = (
        record for item in measurement.measure([], Observer()) for record in item.records
    )
    stored = runs.load(run_file(tmp_path, MACHINE, first, command="ab"), RECORD_TYPES)
    (item,) = measurement.measure(stored.records, Observer())
    (record,) = item.records
    assert isinstance(record, type(second))
    assert record.model == "bench:b"


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
        on_launch(Judgement(Verdict.SAME, Ratio(1.0, 0.999, 1.001), 8, True))
        old, new = (side.row() for side in sides)
        return VerdictRecord(
            model=new.model, path="", old="main", new="HEAD", sides=(old, new), status=Status.OK
        )

    monkeypatch.setattr(
        revisions.revision_sides, "check_out", lambda *_: [*map(targets, Comparison.functions)]
    )
    monkeypatch.setattr(revisions.function_verdict, "decide", decide)
    comparison: Any = Comparison()
    measurement = revisions.revision_verdicts(comparison, VerdictPlan(family=family))
    shares: list[float] = []
    list(measurement.measure([], Observer(lambda name, share: shares.append(share))))
    done = completed_share(8) / 2
    assert shares == [0.0, done, 0.5, 0.5 + done]
    assert measurement.arguments["family"] == expected
