"""Run files in the formats of other tools."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from xml.etree import ElementTree

from mjbench.commands.compare.results import derive_all, path_results
from mjbench.commands.show import comment
from mjbench.commands.versions import family
from mjbench.commands.versions import show as verdicts
from mjbench.errors import InputError
from mjbench.host import disturbance
from mjbench.paired.metrics import METRICS
from mjbench.paired.records import VerdictRecord
from mjbench.results import json_form
from mjbench.results.runs import Run
from mjbench.status import Status
from mjbench.verification.records import ModelRecord


@dataclass(frozen=True)
class _Entry:
    """A number for github-action-benchmark, smaller being better; empty texts are left out."""

    name: str
    unit: str
    value: float
    range: str = ""
    extra: str = ""


def cautions(stored: Iterable[Run]) -> list[str]:
    """Return what to know before the numbers of runs of `compare`, a line each."""
    lines = (
        f"{model_results.model.model}: {caution}"
        for run in stored
        for model_results in derive_all(run.records)
        for caution in model_results.cautions
    )
    return list(dict.fromkeys(lines))


def _check_kind(run: Run) -> None:
    """Refuse a run that is neither of `compare` nor of paired comparisons of time."""
    if not any(isinstance(record, ModelRecord | VerdictRecord) for record in run.records):
        raise InputError(
            f"this run of `{run.header.command}` has no such form: give one of compare, or one of"
            " versions or ab that did not count instructions; or write --csv"
        )


def _entries(run: Run) -> Iterator[_Entry]:
    for r in path_results(run.records):
        if r.step_ns is not None:
            name = f"{r.model}: {r.variant}, {r.nbatch} simulations"
            extra = disturbance.sentence(r.disturbances) if r.disturbances else ""
            yield _Entry(name, "ns/step", r.step_ns, extra=extra)
    for record in run.of_type(VerdictRecord):
        if (ratio := record.ratio) is not None:
            row = record.row()
            name = f"{row.model}: {verdicts.describe_targets(row)}{METRICS[row.metric].suffix}"
            has_ends = ratio.low is not None and ratio.high is not None
            ends = f"{ratio.low:.4g} to {ratio.high:.4g}" if has_ends else ""
            yield _Entry(name, "ratio", ratio.estimate, ends)


def as_github_action_benchmark(run: Run) -> str:
    """Return times for benchmark-action/github-action-benchmark, tool customSmallerIsBetter.

    They are nanoseconds of a step of every path, and ratios of paired comparisons.

    Raises:
      InputError: there is neither.
    """
    _check_kind(run)
    entries = [{k: v for k, v in asdict(e).items() if v != ""} for e in _entries(run)]
    return json_form.text(entries)


def as_junit(run: Run) -> str:
    """Return what was compared as JUnit XML, one test case each.

    A path that disagrees, and a release that is slower or does other work, is a failure; what
    crashed or hung is an error; what could not be compared, or was not decided, is skipped. As for
    `--fail-on`, all comparisons are decided together.
    """
    _check_kind(run)
    suite = ElementTree.Element("testsuite", name=f"mjbench {run.header.command}")
    for case in _cases(run):
        element = ElementTree.SubElement(suite, "testcase", classname=case.group, name=case.name)
        if case.outcome:
            ElementTree.SubElement(element, case.outcome, message=case.detail)
    for outcome, key in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        suite.set(key, str(len(suite.findall(f"testcase/{outcome}"))))
    suite.set("tests", str(len(suite)))
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


@dataclass(frozen=True)
class _Case:
    """A test case of JUnit: its group and name, and the element for its outcome; empty if fine."""

    group: str
    name: str
    outcome: str = ""
    detail: str = ""


_OUTCOMES: Mapping[Status, str] = {
    Status.OK: "",
    Status.DISAGREES: "failure",
    Status.UNAVAILABLE: "skipped",
    Status.NEW: "skipped",
    Status.INTERRUPTED: "skipped",
}


def _cases(run: Run) -> Iterator[_Case]:
    for r in path_results(run.records):
        yield _Case(r.model, str(r.variant), _OUTCOMES.get(r.status, "error"), r.detail)
    rows_of_verdicts = [record.row() for record in run.of_type(VerdictRecord)]
    decided = family.adjust_for_family(rows_of_verdicts, family.confidence_of(run.header))
    for row in rows_of_verdicts:
        outcome = _OUTCOMES.get(row.status, "error")
        if row in decided.slower or row.changed_work:
            outcome = "failure"
        elif not outcome and row in decided.undecided:
            outcome = "skipped"
        text = verdicts.describe_verdict(row)
        yield _Case(row.model, verdicts.describe_targets(row), outcome, text)


# What options of `mjbench show` write of one run.
BY_FLAG: Mapping[str, Callable[[Run], str]] = {
    "--junit": as_junit,
    "--comment": comment.text,
    "--github-benchmark": as_github_action_benchmark,
}
