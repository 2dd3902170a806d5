"""How a model file ended, and what the committed tally and its page say."""

from pathlib import Path
from typing import Any

import pytest
from commands import ROOT

from benchmarks.studies import foreign, foreign_packages, foreign_page, foreign_tally
from benchmarks.studies.foreign_packages import Package, PackageFiles
from benchmarks.studies.foreign_tally import NO_MODEL, FileResult, Outcome
from benchmarks.studies.page_part import of_lines
from mjbench.commands.compare.results import ModelResults
from mjbench.status import ExitCode, Status
from mjbench.verification.records import ModelRecord, VariantRecord

PACKAGE = Package("robots", "1.0")


def judged(root: Path, statuses: dict[str, Status], **model: Any) -> FileResult:
    records = ModelResults(
        ModelRecord(model="bots/a.xml", **{"status": Status.OK, "spread": 1.0, **model}),
        tuple(
            VariantRecord(
                model="bots/a.xml", path=path, options={}, status=status, detail=f"why {status}"
            )
            for path, status in statuses.items()
        ),
    )
    package = PackageFiles(PACKAGE, root, ("bots/a.xml",), 0)
    return foreign_tally.judge(package, "bots/a.xml", records)


@pytest.mark.parametrize(
    ("statuses", "outcome"),
    [
        ([Status.OK, Status.OK], Outcome.AGREES),
        ([Status.OK, Status.UNAVAILABLE], Outcome.REFUSED),
        ([Status.UNAVAILABLE, Status.FAILED], Outcome.FAILED),
        ([Status.FAILED, Status.DISAGREES], Outcome.DISAGREES),
        ([Status.DISAGREES, Status.TIMEOUT], Outcome.TIMEOUT),
        ([Status.TIMEOUT, Status.CRASHED], Outcome.CRASHED),
    ],
)
def test_the_worst_status_of_a_path_is_the_outcome_of_a_model(
    tmp_path: Path, statuses: list[Status], outcome: Outcome
) -> None:
    by_path = dict(zip(("python_loop", "rollout"), statuses, strict=True))
    result = judged(tmp_path, by_path)
    assert result.outcome == outcome
    assert result.statuses == by_path
    expected = "" if outcome == Outcome.AGREES else f"rollout: why {statuses[1]}"
    assert result.detail == expected


def test_a_model_that_agrees_on_fewer_or_closer_starts_says_so(tmp_path: Path) -> None:
    result = judged(
        tmp_path,
        {"rollout": Status.OK},
        nbatch=1,
        diverged=3,
        divergence="BADQACC in 3",
        spread=0.1,
    )
    assert result.outcome == Outcome.AGREES
    assert result.detail == (
        "starts and controls spread 0.1 times as wide as usual;"
        " 3 of 4 simulations diverged (BADQACC in 3)"
    )
    alike = judged(tmp_path, {"rollout": Status.OK}, nbatch=4, diverged=0, spread=0.0)
    assert alike.detail == "starts and controls do not differ between simulations"


# -- the committed tally ------------------------------------------------------------------------


def test_the_page_is_the_one_that_the_committed_tally_writes() -> None:
    tally = foreign_tally.load(foreign.TALLY)
    assert foreign_page.PART.text() == of_lines(foreign_page.lines(tally)), (
        "write it again: python -m benchmarks.studies.foreign_page"
    )


def test_the_numbers_of_the_committed_tally_are_those_of_its_files() -> None:
    tally = foreign_tally.load(foreign.TALLY)
    for package in tally.packages:
        named = Package(package.name, package.version)
        again = foreign_tally.PackageTally.of(named, package.urdf, package.results)
        assert again == package
        reasoned = {Outcome.AGREES, Outcome.NOTHING_TO_STEP}
        assert all(r.detail or r.outcome in reasoned for r in package.remarks)


def test_the_committed_tally_is_of_the_packages_and_variants_of_today() -> None:
    tally = foreign_tally.load(foreign.TALLY)
    packages = [Package(package.name, package.version) for package in tally.packages]
    assert packages == list(foreign_packages.PACKAGES)
    assert tally.variants == tuple(map(str, foreign.plan().variants))
    assert (tally.nbatch, tally.nstep) == (foreign.NBATCH, foreign.NSTEP)


def test_committed_models_disagree_only_where_rollouts_stop_at_a_warning() -> None:
    tally = foreign_tally.load(foreign.TALLY)
    remarks = [result for package in tally.packages for result in package.remarks]
    disagreeing = [result for result in remarks if result.outcome == Outcome.DISAGREES]
    assert all(result.detail.startswith(foreign_tally.STOPPED_BY) for result in disagreeing)
    assert foreign.exit_code(tally) == (ExitCode.FINDING if disagreeing else ExitCode.OK)
    assert sum(package.models for package in tally.packages) >= 331


def test_no_committed_reason_names_a_folder_of_the_machine_it_was_run_on() -> None:
    text = foreign.TALLY.read_text() + foreign_page.PART.text()
    assert "/.cache/" not in text
    assert "/home/" not in text
    assert "/root/" not in text
    assert str(ROOT) not in text


def test_every_reason_why_a_file_is_no_model_is_explained() -> None:
    counted = {"agrees", "disagrees", "refused", "failed", "crashed", "timeout"}
    assert {outcome.value for outcome in Outcome} == counted | {o.value for o in NO_MODEL}
