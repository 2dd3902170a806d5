"""The command `mjbench selfcheck`: how often verdicts are wrong."""

import contextlib
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import paired_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import COUNT, JUDGING, STORING, Shares, with_options
from mjbench.errors import MjbenchError
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.records import TrialRecord
    from mjbench.paired.selfcheck import Case
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.simulation.models import ModelSource


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    type=COUNT,
    default=20,
    show_default=True,
    help="Comparisons for each model and slowdown.",
)
@click.option(
    "--slowdowns",
    type=Shares(),
    default="0,0.5,1,2,5",
    show_default=True,
    help="Slowdowns to inject; 0 compares identical targets.",
)
@click.option("--busy", is_flag=True, help="Keep the last core busy during the trials.")
@with_options(*JUDGING, *STORING)
def selfcheck(
    names: tuple[str, ...],
    trials: int,
    slowdowns: list[float],
    busy: bool,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    as_shipped: bool,
    results: Path,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none, and
    reports false alarms, power, the error of the estimate, and seconds per verdict. Without a
    MODEL: cartpole and humanoid.
    """
    from mjbench.paired import selfcheck as checks
    from mjbench.paired.records import trial_records
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.report import verdicts
    from mjbench.report.documents import SelfcheckDocument
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    cases = [checks.Case.create(source, share) for source in sources for share in slowdowns]
    plan = VerdictPlan(min_effect, confidence, precision, time_limit, as_shipped=as_shipped)
    paired_options.warn_if_unpinned()
    arguments = {**asdict(plan), "trials": trials, "busy": busy}
    arguments |= {"slowdowns": slowdowns, "models": [source.name for source in sources]}
    storage = Storage(results, arguments, resume, trial_records)
    files = [source.path for source in sources]
    with RunContext("selfcheck", json_file, files, storage, wait) as run:
        records = trial_records(run.resumed_records)
        remaining = checks.remaining(cases, trials, records)
        with checks.busy_neighbour_core() if busy else contextlib.nullcontext():
            failures = _run_trials(run, remaining, plan, records, trials * len(cases))
        rows = checks.summary(records)
        run.out.print(verdicts.selfcheck_table(rows))
        run.write(SelfcheckDocument(machine=run.machine, busy=busy, results=rows))
    run.exit(failures)


def _run_trials(
    run: RunContext,
    cases: Iterable["Case"],
    plan: "VerdictPlan",
    records: list["TrialRecord"],
    total: int,
) -> list[Status]:
    """Run a trial of each case; store and append its record; return how failed models ended.

    Args:
      run: where records go.
      cases: of the trials.
      plan: of every verdict.
      records: of all trials so far.
      total: number of trials, with those that were done before.
    """
    from mjbench.paired import selfcheck as checks
    from mjbench.paired.worker_pool import WorkerPool

    failures: list[Status] = []
    with run.progress(total) as advance, WorkerPool() as pool:

        def on_trial(record: "TrialRecord") -> None:
            run.record(record)
            records.append(record)
            advance(len(records), f"{record.model} {100 * record.slowdown:g} %", 0.0)

        def on_failure(model: "ModelSource", error: MjbenchError) -> None:
            report_line(f"{model.name}: {error}")
            failures.append(error.status)

        try:
            checks.run(pool, cases, plan, on_trial, on_failure)
        except KeyboardInterrupt:
            run.interrupt()
    return failures
