"""The command `mjbench selfcheck`: how often verdicts are wrong."""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import paired_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import COUNT, JUDGING, STARTS, STORING, Shares, start_plan, with_options
from mjbench.errors import MjbenchError
from mjbench.simulation import engine_library
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.selfcheck_cases import Case
    from mjbench.paired.selfcheck_records import CaseRow, TrialRecord
    from mjbench.paired.verdict import VerdictPlan

# The arm of known slowdowns, unless other arms are asked for.
_SLOWDOWNS = (0.0, 0.005, 0.01, 0.02, 0.05)


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    type=COUNT,
    default=20,
    show_default=True,
    help="Comparisons for each row of the table.",
)
@click.option(
    "--slowdowns",
    type=Shares(),
    show_default="0,0.5,1,2,5; none with --inside-step or --between-builds",
    help="Slowdowns to inject: by how much longer each block of the candidate lasts; 0 compares"
    " identical targets.",
)
@click.option(
    "--inside-step",
    "functions",
    type=click.Choice(list(engine_library.FUNCTIONS)),
    multiple=True,
    metavar="FUNCTION",
    help="Slow the candidate down inside mj_step, by one more call of this C function of MuJoCo:"
    f" {', '.join(engine_library.FUNCTIONS)}. Can be given several times.",
)
@click.option(
    "--between-builds",
    is_flag=True,
    help="Compare releases whose steps execute equally many instructions, which should be `same`.",
)
@click.option("--busy", is_flag=True, help="Keep the last core busy during the trials.")
@with_options(*JUDGING, *STARTS, *STORING)
def selfcheck(
    names: tuple[str, ...],
    trials: int,
    slowdowns: list[float] | None,
    functions: tuple[str, ...],
    between_builds: bool,
    busy: bool,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    as_shipped: bool,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
    results: Path,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none, and
    reports false alarms, power, the error of the estimate, and seconds per verdict. As between
    releases, the machine code of both targets is moved from launch to launch, unless --as-shipped
    is given.

    Without a MODEL: cartpole and humanoid, and all shipped models for --between-builds.

    \b
    Examples:
      mjbench selfcheck
      mjbench selfcheck cartpole --slowdowns 0,1 --trials 20
    """
    from mjbench.paired import selfcheck as checks
    from mjbench.paired import selfcheck_cases
    from mjbench.paired.run_sizes import Sizes
    from mjbench.paired.selfcheck_records import trial_records
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.report.kinds import SELFCHECK

    if slowdowns is None:
        slowdowns = [] if functions or between_builds else list(_SLOWDOWNS)
    functions = tuple(dict.fromkeys(functions))
    cases = _cases(names, slowdowns, functions, between_builds)
    sources = list(dict.fromkeys(case.candidate.model for case in cases))
    starts = start_plan(settle_s, states_file, actions_file)
    sizes = Sizes(starts=starts)
    plan = VerdictPlan(min_effect, confidence, precision, time_limit, sizes, as_shipped)
    paired_options.warn_if_unpinned()
    arguments = {**asdict(plan), "trials": trials, "busy": busy}
    arguments |= {"slowdowns": slowdowns, "models": [source.name for source in sources]}
    arguments |= {"inside_step": list(functions), "between_builds": between_builds}
    storage = Storage(results, arguments, resume, trial_records)
    files = [*(source.path for source in sources), *starts.files]
    with RunContext("selfcheck", json_file, files, storage, wait) as run:
        records = trial_records(run.resumed_records)
        remaining = selfcheck_cases.remaining(cases, trials, records)
        with checks.busy_neighbour_core() if busy else contextlib.nullcontext():
            failures = _run_trials(run, remaining, plan, records, trials * len(cases))
        run.show_results(SELFCHECK)
        run.write_results(SELFCHECK)
    run.exit(failures)


def _cases(
    names: Sequence[str], slowdowns: Sequence[float], functions: Sequence[str], between_builds: bool
) -> list["Case"]:
    """Return the cases of all arms that were asked for."""
    from mjbench.paired import selfcheck_cases
    from mjbench.releases.release import NO_CHANGE_PAIRS
    from mjbench.simulation import models

    few = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    cases = [selfcheck_cases.slowed(source, share) for source in few for share in slowdowns]
    cases += [selfcheck_cases.inside_step(source, name) for source in few for name in functions]
    if between_builds:
        sources = [models.resolve(name) for name in names or models.shipped()]
        cases += [
            selfcheck_cases.between_builds(source, pair)
            for source in sources
            for pair in NO_CHANGE_PAIRS
        ]
    return cases


def _run_trials(
    run: RunContext,
    cases: Iterable["Case"],
    plan: "VerdictPlan",
    records: list["TrialRecord"],
    total: int,
) -> list[Status]:
    """Run a trial of each case; store and append its record; return how failed models ended.

    Args:
      total: trials, with those that were done before.
    """
    from mjbench.paired import selfcheck as checks
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.selfcheck import describe_case

    failures: list[Status] = []
    with run.progress(total) as advance, WorkerPool() as pool:

        def on_trial(record: "TrialRecord") -> None:
            run.record(record)
            records.append(record)
            advance(len(records), f"{record.model}, {describe_case(record)}", 0.0)

        def on_failure(case: "CaseRow", error: MjbenchError) -> None:
            report_line(f"{case.model}, {describe_case(case)}: {error}")
            failures.append(error.status)

        try:
            checks.run(pool, cases, plan, on_trial, on_failure)
        except KeyboardInterrupt:
            run.interrupt()
    return failures
