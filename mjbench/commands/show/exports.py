"""Run files in the formats of other tools."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from mjbench.commands.compare.results import derive_all, path_results
from mjbench.commands.show import comment
from mjbench.commands.versions import family
from mjbench.commands.versions import show as verdicts
from mjbench.errors import InputError
from mjbench.host import disturbance
from mjbench.paired.metrics import METRICS
from mjbench.paired.records import VerdictRecord
from mjbench.results.runs import Run
from mjbench.status import Status
from mjbench.verification.records import ModelRecord


@dataclass(frozen=True)
class ExportedMetric:
    """One number of a run, smaller being better, with its interval if it has one."""

    name: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None
    disturbances: Sequence[str] = ()


def metrics(run: Run) -> list[ExportedMetric]:
    """Return nanoseconds of a step of every path, and ratios of paired comparisons.

    Raises:
      InputError: there is neither.
    """
    _check_kind(run)
    return [*_step_times(run), *_ratios(run)]


def cautions(run: Run) -> list[str]:
    """Return what to know before the numbers of runs of `compare`, a line each."""
    lines = (
        f"{model_results.model.model}: {caution}"
        for model_results in derive_all(run.records)
        for caution in model_results.cautions
    )
    return list(dict.fromkeys(lines))


def _check_kind(run: Run) -> None:
    """Refuse a run that is neither of `compare` nor of paired comparisons."""
    if not any(isinstance(record, ModelRecord | VerdictRecord) for record in run.records):
        raise InputError(
            f"a run of `{run.header.command}` has no such form: give one of compare, versions or"
            " ab, or write --csv"
        )


def _step_times(run: Run) -> Iterator[ExportedMetric]:
    for r in path_results(run.records):
        if r.step_ns is not None:
            name = f"{r.model}: {r.variant}, {r.nbatch} simulations"
            yield ExportedMetric(name, "ns/step", r.step_ns, disturbances=r.disturbances)


def _ratios(run: Run) -> Iterator[ExportedMetric]:
    for record in run.of_type(VerdictRecord):
        if record.ratio is not None:
            row = record.row()
            name = f"{row.model}: {verdicts.describe_targets(row)}{METRICS[row.metric].suffix}"
            yield ExportedMetric(
                name, "ratio", record.ratio.estimate, record.ratio.low, record.ratio.high
            )


def as_github_action_benchmark(run: Run) -> str:
    """Return metrics for benchmark-action/github-action-benchmark, tool customSmallerIsBetter."""
    entries = []
    for metric in metrics(run):
        entry: dict[str, str | float] = {
            "name": metric.name,
            "unit": metric.unit,
            "value": metric.value,
        }
        if metric.low is not None and metric.high is not None:
            entry["range"] = f"{metric.low:.4g} to {metric.high:.4g}"
        if metric.disturbances:
            entry["extra"] = disturbance.sentence(metric.disturbances)
        entries.append(entry)
    return json.dumps(entries, indent=1) + "\n"


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
