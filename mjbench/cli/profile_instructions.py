"""`mjbench profile --instructions`: instructions per step, counted by Callgrind."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, COUNTS_OUTPUT, SIZES, models_argument, seconds, with_options
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Observer
    from mjbench.paired.run_sizes import Sizes
    from mjbench.store.runs import Record


@cli.command("profile --instructions")
@models_argument()
@click.option(
    "--release",
    "releases",
    multiple=True,
    metavar="RELEASE",
    help="Release to count in; may be given several times.  [default: installed]",
)
@click.option("--top", type=COUNT, default=15, show_default=True, help="List this many functions.")
@click.option(
    "--time-limit",
    "limit_s",
    type=seconds(),
    default="600s",
    show_default=True,
    help="Kill a release's process that finishes no model for this long.",
)
@with_options(SIZES, COUNTS_OUTPUT)
def profile_instructions(
    sources: list[ModelSource],
    releases: tuple[str, ...],
    top: int,
    limit_s: float,
    sizes: "Sizes",
    output: OutputOptions,
) -> None:
    """Count instructions per step, by function and stage; within 0.1 % the same on a busy machine.

    Needs valgrind. The first RELEASE draws start states and controls; every other one does the same
    work. Without a MODEL: all shipped models.

    \b
    Example:
      mjbench profile --instructions humanoid --release 3.3.0 --release 4.0.0
    """
    from mjbench.api.session import Item, Measurement, input_files
    from mjbench.counts.instructions import InstructionCounter
    from mjbench.counts.records import InstructionsRecord, counted
    from mjbench.releases import installs
    from mjbench.report import counts

    specs = [installs.parse_release(name) for name in releases or (installs.INSTALLED,)]

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        known = {(record.build, record.model) for record in counted(earlier)}
        remaining = {(spec.key, source.name) for spec in specs for source in sources} - known
        for number, spec in enumerate(specs):
            names = {model for build, model in remaining if number == 0 or build == spec.key}
            to_count = [source for source in sources if source.name in names]
            for position, count in enumerate(counter.count(spec, to_count, limit_s), 1):
                share = (number + position / len(to_count)) / len(specs)
                observer(f"{count.model}, MuJoCo {spec.version}", share)
                # the first release draws the work of models that remain for others, too
                if (spec.key, count.model) in remaining:
                    yield Item([count.record()])

    arguments = {
        "sizes": sizes,
        "releases": [spec.key for spec in specs],
        "models": [source.name for source in sources],
    }
    files = input_files(sources, specs, sizes.starts)
    measurement = Measurement("instructions", arguments, files, items, counted)
    with InstructionCounter(sizes) as counter:
        run = measure_and_print(
            measurement,
            output,
            summary=lambda run: counts.sections(run.of_type(InstructionsRecord), top),
        )
    run.exit()
