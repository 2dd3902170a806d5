"""`mjbench versions --explain`: what changed from one release to another, by function."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import COUNT, JSON, VERDICT_PLAN, WAIT, with_options
from mjbench.cli.versions import releases_and_models
from mjbench.errors import InputError
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.counts.records import ExplainRecord
    from mjbench.paired.records import VerdictRow
    from mjbench.paired.targets import Target
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.paired.worker_pool import WorkerPool


@cli.command("versions --explain")
@click.argument("names", nargs=-1, required=True, metavar="OLD NEW [MODEL]…")
@click.option(
    "--top",
    type=COUNT,
    default=15,
    show_default=True,
    help="List this many functions.",
)
@click.option(
    "--clock/--no-clock", default=True, show_default=True, help="Compare wall-clock times too."
)
@with_options(VERDICT_PLAN, WAIT, JSON)
def versions_explain(
    names: tuple[str, ...],
    top: int,
    clock: bool,
    plan: "VerdictPlan",
    wait: bool,
    json_file: str | None,
) -> None:
    """Explain what changed from the OLD release to the NEW one: code, work, or time alone.

    Needs valgrind. Lists instructions per step by function and by stage, the largest difference
    first, with the work done and the ratio of wall-clock times, and says whether the machine code
    changed that executes. Times and counts are of the same simulations. Without a MODEL: all
    shipped models.

    \b
    Example:
      mjbench versions --explain 3.17.0 4.0.0 pile
    """
    from mjbench.api.session import Measurement, Session, input_files
    from mjbench.counts.explain import explain_change
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.paired.targets import Target
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import installs
    from mjbench.report import counts
    from mjbench.report.kinds import EXPLAIN

    release_names, sources = releases_and_models(names)
    if len(release_names) != 2:
        raise InputError(
            "name an OLD and a NEW release, such as `mjbench versions --explain 3.17.0 4.0.0`"
        )
    specs = [installs.parse_release(name) for name in release_names]
    files = input_files(sources, specs, plan.sizes.starts)
    session = Session(Measurement("explain", {}, files), wait, report=report_line)
    rows: list[ExplainRecord] = []
    statuses: list[Status] = []
    with (
        RunContext(json_file, files, session) as run,
        WorkerPool() as pool,  # workloads last as long as the pool
        InstructionCounter(plan.sizes) as counter,
    ):
        times = [
            _compare_times(pool, counter, [Target(spec, source) for spec in specs], plan)
            if clock
            else None
            for source in sources
        ]
        baselines, candidates = (counter.count(spec, sources) for spec in specs)
        for baseline, candidate, time in zip(baselines, candidates, times, strict=True):
            rows.append(explain_change(baseline, candidate, time))
            run.show([counts.explanation_section(baseline, candidate, rows[-1], top)])
            statuses += [baseline.status, candidate.status, time.status if time else Status.OK]
        run.write(EXPLAIN.document_type(results=rows))
    run.exit(statuses)


def _compare_times(
    pool: "WorkerPool",
    counter: "InstructionCounter",
    targets: Sequence["Target"],
    plan: "VerdictPlan",
) -> "VerdictRow":
    """Compare the times of one model; have the counter count the same simulations."""
    from mjbench.paired import verdict

    baseline, candidate = targets
    result = verdict.decide(pool, baseline, candidate, plan)
    if result.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    if result.workload_file:
        counter.use_workload(baseline.model, result.workload_file)
    return result.row()
