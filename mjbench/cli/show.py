"""`mjbench show`: print a run file or a run set again."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import CODE, JSON, RESULTS, with_options

if TYPE_CHECKING:
    from mjbench.instrument.runs import Run

# Runs of a set that are printed; of more there is a list. Functions of a count that are listed.
_MOST_RUNS, _MOST_FUNCTIONS = 20, 10


@cli.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@CODE
@with_options(RESULTS, JSON)
def show(file: Path | None, code: bool, results: Path, json_file: str | None) -> None:
    """Print a run FILE or a run set again; without one, the newest in results/runs.

    Of several machines, it first prints what they show side by side.

    \b
    Examples:
      mjbench show
      mjbench show results/runs/run.jsonl --code
    """
    from mjbench.instrument import run_set, runs
    from mjbench.report.documents import RECORD_TYPES

    file = file or runs.latest(results)
    stored = run_set.read(file, RECORD_TYPES)
    with RunContext("show", json_file, inputs=[file]) as run:
        if stored.is_run_file:
            run.write(_shown(run, stored.runs[0], code))
        else:
            _show_set(run, stored.runs, code)


def _show_set(run: RunContext, stored: "Sequence[Run]", code: bool) -> None:
    """Print what machines show side by side, and each run after it; of many runs, a list."""
    from mjbench.report import across_machines
    from mjbench.report.set_document import RunSetDocument

    results = across_machines.side_by_side(stored)
    if results.has_several:
        across_machines.print_side_by_side(run.out, results)
    names = [machine.name for machine in results.machines]
    if len(stored) > _MOST_RUNS:
        run.out.print()
        across_machines.print_runs(run.out, stored, names)
        report_line(f"{len(stored)} runs: only listed; `mjbench report` has a section of each")
    else:
        for number, (each, name) in enumerate(zip(stored, names, strict=True), 1):
            run.out.print()
            run.out.rule(f"Run {number} of {len(stored)}: {each.header.command} on {name}")
            _shown(run, each, code)
    run.write(RunSetDocument.of(stored, results))


def _shown(run: RunContext, stored: "Run", code: bool) -> object:
    """Print a run; return its JSON document."""
    from mjbench.counts.records import ExplainRecord, InstructionsRecord
    from mjbench.paired.placement_spread import SpreadRecord
    from mjbench.paired.records import VerdictRecord
    from mjbench.paired.selfcheck_records import TrialRecord
    from mjbench.releases.release_ratios import RatioRecord
    from mjbench.report.counts import print_changes, print_counts
    from mjbench.report.documents import ExplainDocument, InstructionsDocument

    if stored.of_type(TrialRecord):
        return _selfcheck(run, stored)
    if stored.of_type(VerdictRecord):
        return _verdicts(run, stored)
    if stored.of_type(SpreadRecord):
        return _spreads(run, stored)
    if stored.of_type(RatioRecord):
        return _release_ratios(run, stored)
    if rows := stored.of_type(ExplainRecord):
        print_changes(run.out, rows)
        return ExplainDocument(results=rows)
    if counts := stored.of_type(InstructionsRecord):
        print_counts(run.out, counts, _MOST_FUNCTIONS)
        return InstructionsDocument(results=counts)
    return (
        _loops(run, stored, code)
        or _searches(run, stored)
        or _web(run, stored)
        or _comparison(run, stored, code)
    )


def _selfcheck(run: RunContext, stored: "Run") -> object:
    from mjbench.paired import selfcheck
    from mjbench.paired.selfcheck_records import TrialRecord
    from mjbench.report import selfcheck as report
    from mjbench.report.documents import SelfcheckDocument

    rows = selfcheck.summary(stored.of_type(TrialRecord))
    report.print_tables(run.out, rows)
    busy = stored.header.arguments.get("busy")
    return SelfcheckDocument(machine=stored.header.machine, busy=busy, results=rows)


def _verdicts(run: RunContext, stored: "Run") -> object:
    from mjbench.paired import family
    from mjbench.paired.records import VerdictRecord
    from mjbench.report import verdicts
    from mjbench.report.documents import VerdictDocument

    rows = [record.row() for record in stored.of_type(VerdictRecord)]
    verdicts.print_table(run.out, rows, family.confidence_of(stored.header))
    return VerdictDocument(machine=stored.header.machine, results=rows)


def _spreads(run: RunContext, stored: "Run") -> object:
    from mjbench.paired.placement_spread import SpreadRecord
    from mjbench.report.documents import PlacementDocument
    from mjbench.report.placement import print_spreads

    rows = stored.of_type(SpreadRecord)
    print_spreads(run.out, rows)
    return PlacementDocument(machine=stored.header.machine, results=rows)


def _release_ratios(run: RunContext, stored: "Run") -> object:
    from mjbench.releases.release_ratios import RatioRecord
    from mjbench.report import release_ratios as report
    from mjbench.report.documents import HistoryDocument

    records = stored.of_type(RatioRecord)
    report.print_table(run.out, records)
    return HistoryDocument.of(stored.header.machine, records)


def _loops(run: RunContext, stored: "Run", code: bool) -> object | None:
    """Print what a command around one loop measured; return its document, None without any."""
    from mjbench.comparison.planning_run import PlanningRow
    from mjbench.environment.records import EnvironmentRecord
    from mjbench.loop.latency import LatencyRow
    from mjbench.loop.overhead import OverheadRow
    from mjbench.loop.profile import ProfileRow
    from mjbench.program.records import ProgramRow
    from mjbench.report import (
        documents,
        environment,
        latency,
        overhead,
        planning,
    )
    from mjbench.report.profile import print_profile
    from mjbench.report.program import print_program

    machine = stored.header.machine
    if costs := stored.of_type(OverheadRow):
        for row in costs:
            if row.is_measured:
                overhead.print_table(run.out, row, code)
        return documents.OverheadDocument(machine=machine, results=costs)
    if profiles := stored.of_type(ProfileRow):
        for profile in filter(None, (row.profile() for row in profiles)):
            print_profile(run.out, profile)
        return documents.ProfileDocument(machine=machine, results=profiles)
    if latencies := stored.of_type(LatencyRow):
        measured = [row for row in latencies if row.work is not None]
        for _, of_model in itertools.groupby(measured, lambda row: row.model):
            latency.print_rows(run.out, list(of_model))
        return documents.LatencyDocument(machine=machine, results=latencies)
    if plans := stored.of_type(PlanningRow):
        for _, of_size in itertools.groupby(plans, lambda r: (r.model, r.samples, r.horizon)):
            planning.print_rows(run.out, list(of_size))
        planning.print_sizes(run.out, plans)
        return documents.PlanDocument(machine=machine, results=plans)
    if programs := stored.of_type(ProgramRow):
        for program in programs:
            print_program(run.out, program)
        return documents.ProgramDocument(machine=machine, results=programs)
    if environments := stored.of_type(EnvironmentRecord):
        for record in environments:
            environment.print_environment(run.out, record)
        return documents.EnvDocument(machine=machine, results=environments)
    return None


def _searches(run: RunContext, stored: "Run") -> object | None:
    """Print what searches for settings came to; return their document, None without any."""
    from mjbench.pages import tuning
    from mjbench.report.documents import TuneDocument
    from mjbench.tuning.records import TuneRecord

    searches = stored.of_type(TuneRecord)
    for search in searches:
        tuning.print_record(run.out, search)
    machine = stored.header.machine
    return TuneDocument(machine=machine, results=searches) if searches else None


def _web(run: RunContext, stored: "Run") -> object | None:
    """Print what WebAssembly builds were like; return the document, or None without any."""
    from mjbench.report import web
    from mjbench.report.documents import WebDocument
    from mjbench.web.records import WebRecord

    records = stored.of_type(WebRecord)
    for record in records:
        web.print_model(run.out, record)
    return WebDocument(machine=stored.header.machine, results=records) if records else None


def _comparison(run: RunContext, stored: "Run", code: bool) -> object:
    from mjbench.report import comparison as report
    from mjbench.report.documents import CompareDocument
    from mjbench.report.results import derive_all

    models = derive_all(stored.records)
    if not models:
        report_line("the run ended before anything was measured")
    report.print_models(run.out, models, code)
    if not code:
        report.print_code_hint(run.out, models)
    return CompareDocument.of(stored.header.machine, models)
