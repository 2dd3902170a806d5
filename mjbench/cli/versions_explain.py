"""`mjbench versions --explain`: what changed from one release to another, by function."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.cli.versions import releases_and_models
from mjbench.commands.versions.options import ExplainOptions
from mjbench.errors import InputError
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.counts.instructions import InstructionCounter, ModelCount
    from mjbench.paired.records import VerdictRow
    from mjbench.paired.targets import Target
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.results.content import Section
    from mjbench.results.runs import Record, Run
    from mjbench.session import Items, Observer


@cli.command("versions --explain")
@click.argument("names", nargs=-1, required=True, metavar="OLD NEW MODEL…")
@takes(ExplainOptions)
def versions_explain(names: tuple[str, ...], options: ExplainOptions) -> None:
    """Explain what changed from the OLD release to the NEW one: instructions, work, or time alone.

    Needs valgrind. Lists instructions per step by function and by stage, the largest difference
    first, with the work done and the ratio of wall-clock times. Times and counts are of the same
    simulations.

    \b
    Example:
      mjbench versions --explain 3.17.0 4.0.0 pile
    """
    from mjbench.counts import show as report
    from mjbench.counts.explain import explain_change
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.counts.records import ExplainRecord
    from mjbench.paired.targets import Target
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import installs
    from mjbench.session import Item, Measurement, finished, input_files

    releases, sources = releases_and_models(names)
    if len(releases) > 2:
        raise InputError("--explain compares one OLD and one NEW release")
    specs, plan = installs.parse_available(releases), options.plan
    counted: dict[str, tuple[ModelCount, ModelCount]] = {}

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Items":
        known = {each.model for each in earlier if isinstance(each, ExplainRecord)}
        remaining = [source for source in sources if source.name not in known]
        with WorkerPool() as pool, InstructionCounter(plan.sizes) as counter:
            # workloads last as long as the pool
            times: list[VerdictRow | None] = []
            shares = plan.budget.divided(2 * len(remaining))  # counts take as long, about
            for number, source in enumerate(remaining):
                observer(f"{source.name}: time", number / len(remaining) / 2)
                targets = [Target(spec, source) for spec in specs]
                timed = replace(plan, time_limit_s=shares.next_s())
                times.append(
                    None if options.skip else _compare_times(pool, counter, targets, timed)
                )
            observer("instructions", 0.5)
            baselines, candidates = (list(counter.count(spec, remaining)) for spec in specs)
            for baseline, candidate, time in zip(baselines, candidates, times, strict=True):
                counted[candidate.model] = baseline, candidate
                yield Item([explain_change(baseline, candidate, time)])

    def sections(run: "Run") -> "Iterator[Section]":
        for record in run.of_type(ExplainRecord):
            yield report.explanation_section(*counted[record.model], record, options.top)

    arguments = {
        **asdict(plan),
        "releases": [spec.key for spec in specs],
        "models": [source.name for source in sources],
        "skip": options.skip,
    }
    files = input_files(sources, specs, plan.sizes.starts)
    measurement = Measurement("explain", arguments, files, items, finished)
    run = measure_and_print(measurement, options, each=sections)
    rows = run.session.run().of_type(ExplainRecord)
    run.exit(
        row.time.status if row.time and row.status == Status.OK else row.status for row in rows
    )


def _compare_times(
    pool: "WorkerPool",
    counter: "InstructionCounter",
    targets: Sequence["Target"],
    plan: "VerdictPlan",
) -> "VerdictRow":
    """Compare the times of one model; have the counter count the same simulations."""
    from mjbench.paired import verdict

    baseline, candidate = targets
    use_workload = functools.partial(counter.use_workload, baseline.model)
    record = verdict.decide_pair(pool, baseline, candidate, plan, use_workload=use_workload)
    if record.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    return record.row()
