"""`mjbench show`: print a run file again."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import CODE, JSON, RESULTS, with_options

if TYPE_CHECKING:
    from mjbench.instrument.runs import Run

# Functions of a count that are listed.
_MOST_FUNCTIONS = 10


@cli.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@CODE
@with_options(RESULTS, JSON)
def show(file: Path | None, code: bool, results: Path, json_file: str | None) -> None:
    """Print a run FILE again; without one, the newest in results/runs.

    \b
    Examples:
      mjbench show
      mjbench show results/runs/run.jsonl --code
    """
    from mjbench.comparison.scaling import ScalingRecord
    from mjbench.counts.records import ExplainRecord, InstructionsRecord
    from mjbench.instrument import runs
    from mjbench.paired.placement_spread import SpreadRecord
    from mjbench.paired.records import VerdictRecord
    from mjbench.paired.selfcheck_records import TrialRecord
    from mjbench.releases.release_ratios import RatioRecord
    from mjbench.report.counts import print_changes, print_counts
    from mjbench.report.documents import RECORD_TYPES, ExplainDocument, InstructionsDocument

    file = file or runs.latest(results)
    stored = runs.load(file, RECORD_TYPES)
    with RunContext("show", json_file, inputs=[file]) as run:
        if stored.of_type(TrialRecord):
            _show_selfcheck(run, stored)
        elif stored.of_type(VerdictRecord):
            _show_verdicts(run, stored)
        elif stored.of_type(SpreadRecord):
            _show_spreads(run, stored)
        elif stored.of_type(RatioRecord):
            _show_release_ratios(run, stored)
        elif stored.of_type(ExplainRecord):
            rows = stored.of_type(ExplainRecord)
            print_changes(run.out, rows)
            run.write(ExplainDocument(results=rows))
        elif counts := stored.of_type(InstructionsRecord):
            print_counts(run.out, counts, _MOST_FUNCTIONS)
            run.write(InstructionsDocument(results=counts))
        elif stored.of_type(ScalingRecord):
            _show_scaling(run, stored, code)
        elif not _show_loops(run, stored, code):
            _show_comparison(run, stored, code)


def _show_selfcheck(run: RunContext, stored: "Run") -> None:
    from mjbench.paired import selfcheck
    from mjbench.paired.selfcheck_records import TrialRecord
    from mjbench.report import selfcheck as report
    from mjbench.report.documents import SelfcheckDocument

    rows = selfcheck.summary(stored.of_type(TrialRecord))
    report.print_tables(run.out, rows)
    busy = stored.header.arguments.get("busy")
    run.write(SelfcheckDocument(machine=stored.header.machine, busy=busy, results=rows))


def _show_verdicts(run: RunContext, stored: "Run") -> None:
    from mjbench.paired.records import VerdictRecord
    from mjbench.report import verdicts
    from mjbench.report.documents import VerdictDocument

    rows = [record.row() for record in stored.of_type(VerdictRecord)]
    verdicts.print_table(run.out, rows, verdicts.confidence_of(stored.header))
    run.write(VerdictDocument(machine=stored.header.machine, results=rows))


def _show_spreads(run: RunContext, stored: "Run") -> None:
    from mjbench.paired.placement_spread import SpreadRecord
    from mjbench.report.documents import PlacementDocument
    from mjbench.report.placement import print_spreads

    rows = [record.row() for record in stored.of_type(SpreadRecord)]
    print_spreads(run.out, rows)
    run.write(PlacementDocument(machine=stored.header.machine, results=rows))


def _show_release_ratios(run: RunContext, stored: "Run") -> None:
    from mjbench.releases.release_ratios import RatioRecord
    from mjbench.report import release_ratios as report
    from mjbench.report.documents import HistoryDocument

    records = stored.of_type(RatioRecord)
    report.print_table(run.out, records)
    run.write(HistoryDocument.of(stored.header.machine, records))


def _show_scaling(run: RunContext, stored: "Run", code: bool) -> None:
    from mjbench.comparison.scaling import ScalingRecord
    from mjbench.paired.confirmation import ConfirmationRecord
    from mjbench.report import scaling as report
    from mjbench.report import thread_advice
    from mjbench.report.documents import CompareDocument

    confirmations = stored.of_type(ConfirmationRecord)
    models = thread_advice.by_model(stored.of_type(ScalingRecord), confirmations)
    for results in models:
        report.print_results(run.out, results, code)
    run.write(CompareDocument.of_scaling(stored.header.machine, models))


def _show_loops(run: RunContext, stored: "Run", code: bool) -> bool:
    """Print what a command around one loop measured; return whether one did."""
    from mjbench.comparison.planning_run import PlanningRow
    from mjbench.environment.records import EnvironmentRecord
    from mjbench.loop.latency import LatencyRow
    from mjbench.loop.overhead import OverheadRow
    from mjbench.loop.profile import ProfileRow
    from mjbench.program.records import ProgramRow
    from mjbench.report import (
        documents,
        environment,
        environment_results,
        latency,
        overhead,
        planning,
    )
    from mjbench.report.profile import print_profile
    from mjbench.report.program import print_program

    machine = stored.header.machine
    if costs := stored.of_type(OverheadRow):
        for table in filter(None, (row.table() for row in costs)):
            overhead.print_table(run.out, table, code)
        run.write(documents.OverheadDocument(machine=machine, results=costs))
    elif profiles := stored.of_type(ProfileRow):
        for profile in filter(None, (row.profile() for row in profiles)):
            print_profile(run.out, profile)
        run.write(documents.ProfileDocument(machine=machine, results=profiles))
    elif latencies := stored.of_type(LatencyRow):
        measured = [row for row in latencies if row.work is not None]
        for _, of_model in itertools.groupby(measured, lambda row: row.model):
            latency.print_rows(run.out, list(of_model))
        run.write(documents.LatencyDocument(machine=machine, results=latencies))
    elif plans := stored.of_type(PlanningRow):
        for _, of_size in itertools.groupby(plans, lambda r: (r.model, r.samples, r.horizon)):
            planning.print_rows(run.out, list(of_size))
        planning.print_sizes(run.out, plans)
        run.write(documents.PlanDocument(machine=machine, results=plans))
    elif programs := stored.of_type(ProgramRow):
        for program in programs:
            print_program(run.out, program)
        run.write(documents.ProgramDocument(machine=machine, results=programs))
    elif environments := stored.of_type(EnvironmentRecord):
        rows = [environment_results.derive(record) for record in environments]
        for row in rows:
            environment.print_environment(run.out, row)
        run.write(documents.EnvDocument(machine=machine, results=rows))
    else:
        return _show_searches(run, stored)
    return True


def _show_searches(run: RunContext, stored: "Run") -> bool:
    """Print what searches for settings came to; return whether there is one."""
    from mjbench.report import tuning_accelerated
    from mjbench.report.documents import TuneDocument
    from mjbench.tuning.accelerated_records import EngineTuneRecord
    from mjbench.tuning.records import TuneRecord

    searches: list[TuneRecord | EngineTuneRecord] = []
    searches += stored.of_type(TuneRecord)
    searches += stored.of_type(EngineTuneRecord)
    for search in searches:
        tuning_accelerated.print_any(run.out, search)
    if searches:
        run.write(TuneDocument.of(stored.header.machine, searches))
    return bool(searches)


def _show_comparison(run: RunContext, stored: "Run", code: bool) -> None:
    from mjbench.report import comparison as report
    from mjbench.report.documents import CompareDocument
    from mjbench.report.results import derive_all

    models = derive_all(stored.records)
    if not models:
        report_line("the run ended before anything was measured")
    report.print_models(run.out, models, code)
    if not code:
        report.print_code_hint(run.out, models)
    run.write(CompareDocument.of(stored.header.machine, models))
