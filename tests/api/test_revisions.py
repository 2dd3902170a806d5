"""Measurements of functions in two revisions; nothing is started."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from set_files import MACHINE, run_file

from mjbench.api import revisions
from mjbench.api.session import Observer
from mjbench.paired.function_pair import FunctionTarget
from mjbench.paired.revision_sides import FunctionName
from mjbench.paired.timed_function import CodeOrigin, FunctionSource
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.revisions import Revision
from mjbench.report.kinds import RECORD_TYPES
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
