"""Instructions: counted, and compared between releases."""

import sys
from typing import Any

import click

from mjbench.cli.group import cli
from mjbench.cli.paired_options import verdict_plan
from mjbench.cli.shared import (
    JSON,
    JUDGING,
    SEED,
    SIZES,
    exit_code,
    output,
    progress,
    seconds,
    with_options,
)
from mjbench.errors import InputError


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--release",
    "words",
    multiple=True,
    metavar="RELEASE",
    help="May be given several times  [default: installed]",
)
@click.option("--top", type=click.IntRange(min=1), default=10, show_default=True)
@click.option("--time-limit", default="600s", show_default=True, callback=seconds)
@with_options(SEED, JSON)
def instructions(
    names: tuple[str, ...],
    words: tuple[str, ...],
    top: int,
    time_limit: float,
    seed: int,
    json_file: str | None,
) -> None:
    """Count instructions per step, by function and stage, exact on any machine.

    Needs valgrind. Every release does the work that the first one named drew.
    """
    from mjbench.counts import instructions as room
    from mjbench.paired.preparation import Sizes
    from mjbench.releases import installs
    from mjbench.report import counts, tables
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or models.shipped()]
    releases = [installs.parse_release(word) for word in words or (installs.INSTALLED,)]
    out = tables.console(stderr=json_file == "-")
    found = []
    with output(json_file) as write_json, room.Counter(Sizes(seed=seed)) as counter:
        with progress(out, len(releases)) as advance:
            for number, release in enumerate(releases):
                advance(number, f"MuJoCo {release.version}", 0.0)
                found += counter.count(release, sources, time_limit)
        counts.print_counts(out, found, top)
        write_json({"schema": 1, "results": [room.as_result(count) for count in found]})
    sys.exit(exit_code(count.status for count in found))


@cli.command()
@click.argument("words", nargs=-1, required=True, metavar="OLD NEW MODEL…")
@click.option("--top", type=click.IntRange(min=1), default=15, show_default=True)
@click.option("--clock/--no-clock", default=True, help="Compare wall-clock times too.")
@with_options(*JUDGING, *SIZES, JSON)
def explain(
    words: tuple[str, ...], top: int, clock: bool, json_file: str | None, **chosen: Any
) -> None:
    """Tell what changed from the OLD release to the NEW one: code, work, or the clock alone.

    Needs valgrind. Instructions per step by function and by stage, sorted by what they contribute
    to the difference; beside them the work done and the paired wall-clock ratio, of the same
    simulations.
    """
    from mjbench.counts import explain as derive
    from mjbench.counts import instructions as room
    from mjbench.paired import verdict
    from mjbench.paired.targets import Target
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import installs
    from mjbench.report import counts, tables
    from mjbench.simulation import models

    named = [word for word in words if installs.is_release(word)]
    if len(named) != 2:
        raise InputError("name an OLD and a NEW release, such as `mjbench explain 3.17.0 4.0.0`")
    releases = [installs.parse_release(word) for word in named]
    given = [word for word in words if word not in named]
    sources = [models.resolve(name) for name in given or models.shipped()]
    plan = verdict_plan(**chosen)
    out = tables.console(stderr=json_file == "-")
    results, statuses = [], []
    with (
        output(json_file) as write_json,
        WorkerPool() as pool,
        room.Counter(plan.sizes) as counter,
    ):
        outcomes: list[verdict.PairedResult | None] = []
        for source in sources:
            before, after = (Target(release, source) for release in releases)
            outcome = verdict.decide(pool, before, after, plan) if clock else None
            if outcome and outcome.status == "interrupted":
                raise KeyboardInterrupt
            if outcome and outcome.workload_file:
                counter.give(source, outcome.workload_file)
            outcomes.append(outcome)
        counted = [counter.count(release, sources) for release in releases]
        for old, new, outcome in zip(*counted, outcomes, strict=True):
            counts.print_explanation(out, old, new, outcome, top)
            results.append(derive.as_result(old, new, outcome))
            statuses += [old.status, new.status, outcome.status if outcome else "ok"]
        write_json({"schema": 1, "results": results})
    sys.exit(exit_code(statuses))
