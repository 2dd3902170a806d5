"""The command `mjbench selfcheck`: how often verdicts are wrong."""

import contextlib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, JUDGING, RESULTS, with_options
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.paired.records import TrialRecord


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    type=click.IntRange(min=1),
    default=20,
    show_default=True,
    help="Comparisons for each model and slowdown.",
)
@click.option(
    "--slowdowns",
    default="0,0.5,1,2,5",
    show_default=True,
    metavar="PERCENT,…",
    help="Slowdowns to inject; 0 is an A/A comparison.",
)
@click.option("--busy", is_flag=True, help="Keep the last core busy meanwhile.")
@with_options(*JUDGING, RESULTS, JSON)
def selfcheck(
    names: tuple[str, ...],
    trials: int,
    slowdowns: str,
    busy: bool,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    results: Path,
    json_file: str | None,
) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none, and
    reports false alarms, power, the error of the estimate, and seconds per verdict. Without a
    MODEL, it takes cartpole and humanoid.
    """
    from mjbench.paired import selfcheck as checks
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report import verdicts
    from mjbench.report.documents import SelfcheckDocument
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    shares = _shares(slowdowns)
    cases = [checks.Case.create(source, share) for source in sources for share in shares]
    plan = VerdictPlan(min_effect, confidence, precision, time_limit)
    records: list[TrialRecord] = []
    arguments = {**asdict(plan), "trials": trials, "busy": busy}
    with RunContext("selfcheck", json_file, results, arguments) as run:
        with (
            run.progress(trials * len(cases)) as advance,
            checks.busy_neighbour_core() if busy else contextlib.nullcontext(),
            WorkerPool() as pool,
        ):

            def on_trial(record: "TrialRecord") -> None:
                run.record(record)
                records.append(record)
                advance(len(records), f"{record.model} {100 * record.slowdown:g} %", 0.0)

            try:
                checks.run(pool, cases, trials, plan, on_trial)
            except KeyboardInterrupt:
                run.interrupt()
        rows = checks.summary(records)
        run.out.print(verdicts.selfcheck_table(rows))
        run.write(SelfcheckDocument(machine=run.machine, busy=busy, results=rows))
    run.exit([])


def _shares(slowdowns: str) -> list[float]:
    """Return the shares that percentages such as `0,0.5%` stand for.

    Raises:
      InputError: one is not a number.
    """
    try:
        return [float(word.removesuffix("%")) / 100 for word in slowdowns.split(",")]
    except ValueError:
        raise InputError(
            f"--slowdowns {slowdowns}: not a list of percentages such as 0,0.5,1"
        ) from None
