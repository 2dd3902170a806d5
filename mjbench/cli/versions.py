"""The command `mjbench versions`: releases of MuJoCo against each other."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli import paired_options
from mjbench.cli.context import OutputOptions, RunContext, Storage
from mjbench.cli.fail_on import FAIL_ON, FailOn, Finding
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, JUDGING, SIZES, STORING, Names, with_options
from mjbench.errors import InputError
from mjbench.paired.outcomes import Metric
from mjbench.status import ExitCode

if TYPE_CHECKING:
    from mjbench.counts.explain import InstructionComparison
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.paired.records import VerdictRow
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.releases.installs import ReleaseSpec


@cli.command()
@click.argument("names", nargs=-1, metavar="[OLD NEW…] [MODEL]…")
@click.option("--old", metavar="RELEASE", help="The old release, if it is not the first argument.")
@click.option(
    "--new",
    "news",
    multiple=True,
    metavar="RELEASE",
    help="A new release; may be given several times.",
)
@click.option(
    "--paths",
    "path_names",
    type=Names(),
    help="Ways of stepping, each compared between the releases  [default: python_loop]",
)
@click.option(
    "--metric",
    type=click.Choice([metric.value for metric in Metric]),
    default=Metric.TIME.value,
    show_default=True,
    help="What to compare: the time of steps; p99, the time that 99 of 100 single steps do not"
    " exceed; or instructions. Instruction counts repeat within 0.1 %. They do not need a quiet"
    " machine, but they need valgrind; they are those of the engine alone, and --confidence,"
    " --precision, --time-limit and --as-shipped do not apply.",
)
@click.option(
    "--family",
    type=COUNT,
    help="Number of comparisons that are decided together, where other commands do some of them: a"
    " change needs more evidence  [default: those of this command]",
)
@with_options(*FAIL_ON, *JUDGING, *SIZES, *STORING)
def versions(
    names: tuple[str, ...],
    old: str | None,
    news: tuple[str, ...],
    path_names: list[str] | None,
    metric: str,
    family: int | None,
    findings: list[Finding],
    allow_inconclusive: bool,
    results: Path,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
    **chosen: Any,
) -> None:
    """Is MODEL slower with a NEW release of MuJoCo than with the OLD one?

    A release is a version (3.5.0), a wheel or a folder of wheels, `installed`, `newest` or
    `previous`, the last release on the package index and the one before it. Each is installed in a
    folder of its own in the cache (`mjbench releases installs`). There may be several NEW ones.
    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench versions 3.3.0 4.0.0 humanoid
      mjbench versions previous newest robot.xml
      mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower,changed-work
      mjbench versions 3.17.0 4.0.0 robot.xml --metric instructions --min-effect 0.5%
      mjbench versions --old installed --new dist/mujoco-4.1.0-cp311-….whl cartpole

    Ratios are new over old: above 1 is slower. Where a release does other work, such as more
    contacts, the verdict says so.
    """
    from mjbench.paired import targets
    from mjbench.paths import BASE

    release_names, sources = paired_options.releases_and_models(names)
    baseline, *candidates = _releases(old, news, release_names)
    path_names = path_names or [BASE]
    plan = paired_options.verdict_plan(**chosen, metric=Metric(metric))
    fail_on = FailOn(findings, allow_inconclusive)
    output = OutputOptions(results, resume, wait, json_file)
    targets.check_metric(Metric(metric), path_names)
    if metric == Metric.INSTRUCTIONS:
        from mjbench.counts.explain import InstructionComparison

        comparison = InstructionComparison(baseline, candidates, sources, plan.min_effect)
        sys.exit(_compare_instructions(comparison, plan, fail_on, output))
    pairs = targets.of_releases(baseline, candidates, sources, path_names)
    plan = replace(plan, family=max(len(pairs), family or 1))
    sys.exit(paired_options.compare_targets("versions", pairs, plan, fail_on, output))


def _releases(
    old: str | None, news: Sequence[str], release_names: Sequence[str]
) -> list["ReleaseSpec"]:
    """Return the old release, then the new ones, from the options and from the arguments."""
    from mjbench.releases.installs import parse_release

    names = [old, *release_names] if old else list(release_names)
    if not names or len(names) + len(news) < 2:
        raise InputError("name an OLD and a NEW release, such as `mjbench versions 3.3.0 4.0.0`")
    return [parse_release(name) for name in (names[0], *news, *names[1:])]


def _compare_instructions(
    comparison: "InstructionComparison",
    plan: "VerdictPlan",
    fail_on: FailOn,
    output: OutputOptions,
) -> ExitCode:
    """Compare instruction counts, print and store the verdicts; return the exit code."""
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.paired import records

    builds = [comparison.baseline, *comparison.candidates]
    arguments = {
        **asdict(plan),
        "metric": Metric.INSTRUCTIONS,
        "releases": [release.key for release in builds],
        "models": [source.name for source in comparison.sources],
    }
    storage = Storage(output.results, arguments, output.resume, records.finished)
    files = [source.path for source in comparison.sources]
    files += [wheel for release in builds for wheel in release.wheels]
    files += plan.sizes.starts.files
    rows: list[VerdictRow] = []
    with RunContext("versions", output.json_file, files, storage, output.wait) as run:
        try:
            with InstructionCounter(plan.sizes) as counter:
                rows.extend(_verdict_rows(comparison, run, counter))
        except KeyboardInterrupt:
            run.interrupt()
        paired_options.report(run, rows, plan.confidence)
    if run.interrupted:
        return ExitCode.INTERRUPTED
    return fail_on.exit_code(rows, plan.confidence)


def _verdict_rows(
    comparison: "InstructionComparison", run: RunContext, counter: "InstructionCounter"
) -> Iterator["VerdictRow"]:
    """Yield the verdict on each model in each new release; store it, unless it was stored."""
    from mjbench.counts import explain
    from mjbench.paired import records

    with run.progress(len(comparison.candidates)) as advance:

        def on_candidate(number: int) -> None:
            advance(number, f"MuJoCo {comparison.candidates[number].version}", 0.0)

        stored = records.finished(run.resumed_records)
        for record in explain.verdicts(comparison, counter, stored, on_candidate, run.record):
            yield record.row()
