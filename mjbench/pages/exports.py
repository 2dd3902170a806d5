"""Run files in the formats of other tools."""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from mjbench.comparison.plan import Variant
from mjbench.comparison.records import ModelRecord
from mjbench.errors import InputError, MachineError
from mjbench.instrument.runs import Run
from mjbench.paired import family
from mjbench.paired.records import VerdictRecord
from mjbench.report import rows, verdicts
from mjbench.report.results import derive_all
from mjbench.status import Status


@dataclass(frozen=True)
class Metric:
    """One number of a run.

    Attributes:
      name: what it is of.
      unit: of it; smaller is better.
      value: the number.
      low: lower end of its interval; None without one.
      high: upper end.
    """

    name: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None


def metrics(run: Run) -> list[Metric]:
    """Return nanoseconds of a step of every path, and ratios of paired comparisons.

    Raises:
      InputError: the run has neither.
    """
    _check_kind(run)
    return [*_step_times(run), *_ratios(run)]


def _check_kind(run: Run) -> None:
    """Refuse a run that is neither of `compare` nor of paired comparisons."""
    kinds = (ModelRecord, VerdictRecord)
    if not any(isinstance(record, kinds) for record in run.records):
        raise InputError(
            f"a run of `{run.header.command}` has no such form: give one of compare, versions or"
            " ab, or --format csv"
        )


def _step_times(run: Run) -> Iterator[Metric]:
    if run.of_type(ModelRecord):
        for model_results in derive_all(run.records):
            for r in model_results.results:
                if r.step_ns is not None:
                    name = f"{r.model}: {Variant(r.path, r.options)}, {r.nbatch} simulations"
                    yield Metric(name, "ns/step", r.step_ns.median)


def _ratios(run: Run) -> Iterator[Metric]:
    for record in run.of_type(VerdictRecord):
        if record.ratio is not None:
            row = record.row()
            name = f"{row.model}: {verdicts.describe_targets(row)}"
            yield Metric(name, "ratio", record.ratio.estimate, record.ratio.low, record.ratio.high)


def as_csv(run: Run) -> str:
    """Return the results of a run as CSV (RFC 4180)."""
    table = rows.of_run(run)
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(table[0]) if table else [])
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


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
        entries.append(entry)
    return json.dumps(entries, indent=1) + "\n"


def as_bencher(run: Run) -> str:
    """Return metrics in the Bencher Metric Format, for `bencher run --adapter json`."""
    measures = {"ns/step": "latency", "ratio": "ratio"}
    report: dict[str, dict[str, dict[str, float]]] = {}
    for metric in metrics(run):
        value = {"value": metric.value}
        if metric.low is not None and metric.high is not None:
            value |= {"lower_value": metric.low, "upper_value": metric.high}
        report[metric.name] = {measures[metric.unit]: value}
    return json.dumps(report, indent=1) + "\n"


def as_otava(run: Run) -> str:
    """Return metrics as one row of CSV, as Apache Otava reads it: a time, then a column each.

    Rows of several runs make the series in which Otava detects changes. The time is when the run
    began.

    Raises:
      InputError: the run is of an earlier version, and does not say when it began.
    """
    if not run.header.began:
        raise InputError("this run file is of an earlier version, and does not say when it began")
    all_metrics = metrics(run)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["time", *(metric.name for metric in all_metrics)])
    writer.writerow([run.header.began, *(metric.value for metric in all_metrics)])
    return text.getvalue()


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
    Status.INTERRUPTED: "skipped",
}


def _cases(run: Run) -> Iterator[_Case]:
    if run.of_type(ModelRecord):
        for model_results in derive_all(run.records):
            for r in model_results.results:
                outcome = _OUTCOMES.get(r.status, "error")
                yield _Case(r.model, str(Variant(r.path, r.options)), outcome, r.detail)
    rows_of_verdicts = [record.row() for record in run.of_type(VerdictRecord)]
    decided = family.decide(rows_of_verdicts, family.confidence_of(run.header))
    for row in rows_of_verdicts:
        outcome = _OUTCOMES.get(row.status, "error")
        if row in decided.slower or row.changed_work:
            outcome = "failure"
        elif not outcome and row in decided.undecided:
            outcome = "skipped"
        text = verdicts.describe_verdict(row)
        yield _Case(row.model, verdicts.describe_targets(row), outcome, text)


def write_parquet(run: Run, file: Path) -> None:
    """Write the results of a run as Parquet.

    Raises:
      MachineError: neither pandas with pyarrow nor polars is installed.
    """
    table: Sequence[Mapping[str, rows.Cell]] = rows.of_run(run)
    try:
        import polars
    except ImportError:
        pass
    else:
        polars.DataFrame(table, infer_schema_length=None, strict=False).write_parquet(file)
        return
    try:
        import pandas

        pandas.DataFrame(table).to_parquet(file)
    except ImportError as error:
        raise MachineError("--format parquet needs polars, or pandas with pyarrow") from error


# The text formats by name.
FORMATS: Mapping[str, Callable[[Run], str]] = {
    "csv": as_csv,
    "github-action-benchmark": as_github_action_benchmark,
    "bencher": as_bencher,
    "otava": as_otava,
    "junit": as_junit,
}
