"""Run files and run sets in the formats of other tools."""

import csv
import io
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from mjbench.comparison.records import ModelRecord
from mjbench.errors import InputError
from mjbench.paired import family
from mjbench.paired.metrics import METRICS
from mjbench.paired.records import VerdictRecord
from mjbench.report import rows, verdicts, verdicts_across
from mjbench.report.machines_side_by_side import verdict_cell
from mjbench.report.path_speedups import derive_all, disturbed, path_results
from mjbench.report.verdicts_across import MachinesOutcome
from mjbench.status import Status
from mjbench.store.machine_identity import identify
from mjbench.store.run_set import RunSet
from mjbench.store.runs import Run

# What the formulas of spreadsheets begin with, in narrow and in wide letters.
_FORMULA = tuple("=+-@\t\r\n＝＋－＠")


@dataclass(frozen=True)
class ExportedMetric:
    """One number of a run, smaller being better, with its interval if it has one."""

    name: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None
    disturbances: Sequence[str] = ()


def metrics(stored: RunSet) -> list[ExportedMetric]:
    """Return nanoseconds of a step of every path, and ratios of paired comparisons.

    Of several machines, names begin with that of the machine.

    Raises:
      InputError: there is neither, or a machine measured something several times.
    """
    runs = stored.runs
    _check_kind(runs)
    values = [
        replace(metric, name=f"{prefix}{metric.name}")
        for run, prefix in _prefixed(runs)
        for metric in (*_step_times(run), *_ratios(run))
    ]
    names = Counter(metric.name for metric in values)
    repeated = [name for name, count in names.items() if count > 1]
    if repeated and len(runs) > 1:
        raise InputError(
            f"{repeated[0]} was measured {names[repeated[0]]} times, and this form has room for"
            " one: give a run file, or --format csv"
        )
    return values


def cautions(stored: RunSet) -> list[str]:
    """Return what to know before the numbers of runs of `compare`, a line each."""
    lines = (
        f"{prefix}{model_results.model.model}: {caution}"
        for run, prefix in _prefixed(stored.runs)
        for model_results in derive_all(run.records)
        for caution in model_results.cautions
    )
    return list(dict.fromkeys(lines))


def _prefixed(runs: Sequence[Run]) -> list[tuple[Run, str]]:
    machines = identify([run.header.machine for run in runs])
    has_several = len(set(machines)) > 1
    return [
        (run, f"{machine.name}: " if has_several else "")
        for run, machine in zip(runs, machines, strict=True)
    ]


def _check_kind(runs: Sequence[Run]) -> None:
    """Refuse runs none of which is of `compare` or of paired comparisons."""
    kinds = (ModelRecord, VerdictRecord)
    if not any(isinstance(record, kinds) for run in runs for record in run.records):
        commands = dict.fromkeys(f"`{run.header.command}`" for run in runs)
        raise InputError(
            f"a run of {', '.join(commands) or 'nothing'} has no such form: give one of compare,"
            " versions or ab, or --format csv"
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


def as_csv(stored: RunSet) -> str:
    table = rows.of_set(stored)
    return csv_text([list(table[0]) if table else [], *(row.values() for row in table)])


def csv_text(table: Iterable[Iterable[rows.Cell]]) -> str:
    """Return rows as CSV (RFC 4180)."""
    text = io.StringIO()
    csv.writer(text).writerows(map(_cell, row) for row in table)
    return text.getvalue()


def _cell(cell: rows.Cell) -> rows.Cell:
    """Return a cell of CSV that no spreadsheet takes for a formula: such a text begins with `'`."""
    if not isinstance(cell, str) or not cell.startswith(_FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def as_github_action_benchmark(stored: RunSet) -> str:
    """Return metrics for benchmark-action/github-action-benchmark, tool customSmallerIsBetter."""
    entries = []
    for metric in metrics(stored):
        entry: dict[str, str | float] = {
            "name": metric.name,
            "unit": metric.unit,
            "value": metric.value,
        }
        if metric.low is not None and metric.high is not None:
            entry["range"] = f"{metric.low:.4g} to {metric.high:.4g}"
        if metric.disturbances:
            entry["extra"] = disturbed(metric.disturbances)
        entries.append(entry)
    return json.dumps(entries, indent=1) + "\n"


def as_junit(stored: RunSet) -> str:
    """Return what was compared as JUnit XML, one test case each.

    A path that disagrees, and a release that is slower or does other work, is a failure; what
    crashed or hung is an error; what could not be compared, or was not decided, is skipped. As for
    `--fail-on`, all comparisons are decided together; of several machines, all their verdicts.
    """
    runs = stored.runs
    _check_kind(runs)
    commands = dict.fromkeys(run.header.command for run in runs)
    suite = ElementTree.Element("testsuite", name=f"mjbench {', '.join(commands)}")
    cases = _cases(runs[0]) if len(runs) == 1 else _cases_by_machine(runs)
    for case in cases:
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
_MACHINE_OUTCOMES: Mapping[MachinesOutcome, str] = {
    MachinesOutcome.SLOWER: "failure",
    MachinesOutcome.FASTER: "",
    MachinesOutcome.SAME: "",
    MachinesOutcome.UNDECIDED: "skipped",
}


def _cases(run: Run) -> Iterator[_Case]:
    yield from _path_cases(run)
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


def _path_cases(run: Run) -> Iterator[_Case]:
    for r in path_results(run.records):
        yield _Case(r.model, str(r.variant), _OUTCOMES.get(r.status, "error"), r.detail)


def _cases_by_machine(runs: Sequence[Run]) -> Iterator[_Case]:
    machines = [machine.name for machine in identify([run.header.machine for run in runs])]
    for run, machine in zip(runs, machines, strict=True):
        yield from (replace(case, name=f"{machine}: {case.name}") for case in _path_cases(run))
    across = verdicts_across.decide(verdicts_across.rows_of(runs, machines))
    for comparison in across.comparisons:
        name = verdicts.comparison_name(comparison)
        sentence = verdicts.describe_machines(comparison, name)
        for verdict in comparison.machines:
            outcome = _MACHINE_OUTCOMES[verdict.outcome]
            if verdict.changed_work:
                outcome = "failure"
            elif verdict.ratio is None:
                outcome = "error"
            detail = f"{verdict_cell(verdict)}; {sentence}"
            yield _Case(comparison.model, f"{verdict.machine}: {name}", outcome, detail)


# The formats by name.
FORMATS: Mapping[str, Callable[[RunSet], str]] = {
    "csv": as_csv,
    "github-action-benchmark": as_github_action_benchmark,
    "junit": as_junit,
}
