"""`mjbench doctor --placement`: how far a step's time depends on where the code lies."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    SIZES_OF_STARTS,
    STORING,
    budget,
    models_argument,
    with_options,
)
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Observer
    from mjbench.measuring.progress import Progress
    from mjbench.paired.run_sizes import Sizes
    from mjbench.store.runs import Record


@cli.command("doctor --placement")
@models_argument("cartpole", "humanoid")
@click.option(
    "--release",
    "release_name",
    default="installed",
    show_default=True,
    metavar="RELEASE",
    help="A version such as 3.5.0, a wheel, a folder of wheels, or `installed`.",
)
@click.option(
    "--launches",
    type=COUNT,
    default=14,
    show_default=True,
    help="Launches for each of the four placements; an interval needs at least 9.",
)
@budget(
    180,
    "Time for each model, once it is loaded; after it, no launch begins.",
    is_renamed=True,
)
@with_options(SIZES_OF_STARTS, STORING)
def doctor_placement(
    sources: list[ModelSource],
    release_name: str,
    launches: int,
    time_limit: float,
    sizes: "Sizes",
    output: OutputOptions,
) -> None:
    """How far does the time of a step depend on where MuJoCo's machine code lies in memory?

    Compares a release as shipped with the same release moved by 0, 16, 32 and 48 bytes within a
    cache line. A benchmark of one build cannot tell smaller differences than these from a change of
    the code. Without a MODEL: cartpole and humanoid.

    \b
    Examples:
      mjbench doctor --placement robot.xml
      mjbench doctor --placement cloth pile --release 3.3.1
    """
    from mjbench.api.session import Item, Measurement, in_turn, pinning_notes
    from mjbench.paired import placement_spread
    from mjbench.paired.placement_spread import SpreadPlan
    from mjbench.paired.targets import Target
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases.installs import parse_release

    release = parse_release(release_name)
    targets = [Target(release, source) for source in sources]
    plan = SpreadPlan(launches, time_limit, sizes)

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        with WorkerPool() as pool:

            def measure(source: ModelSource, on_progress: "Progress") -> Item:
                def on_launch(count: int) -> None:
                    on_progress(source.name, count / plan.most_launches)

                target = Target(release, source)
                return Item([placement_spread.measure(pool, target, plan, on_launch)])

            yield from in_turn(sources, measure, earlier, observer)

    measurement = Measurement(
        "placement",
        {**asdict(plan), "targets": [target.row() for target in targets]},
        [*(file for target in targets for file in target.files), *sizes.starts.files],
        items,
        placement_spread.finished,
        pinning_notes(),
    )
    measure_and_print(measurement, output, at_end=True).exit()
