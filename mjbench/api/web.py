"""What `mjbench web` measures: WebAssembly builds of a release beside C of the same release."""

from collections.abc import Sequence
from pathlib import Path

from mjbench.api.session import Item, Items, Measurement, Observer, finished, in_turn, input_files
from mjbench.host import machine
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_names
from mjbench.simulation.models import ModelSource
from mjbench.store.runs import Record
from mjbench.web import measure as builds
from mjbench.web import node_process, npm_package
from mjbench.web.timed_build import Engine


def measurement(
    sources: Sequence[ModelSource],
    release: str | None,
    package_folder: Path | None,
    node_command: str,
    budget_s: float,
    sizes: Sizes,
    limit_s: float,
) -> Measurement:
    """Return the measurement; without a release, it is that of the npm package."""
    spec = None if release is None else release_names.parse_release(release)
    package = npm_package.find(None if spec is None else spec.version, package_folder)
    node = node_process.find_node(node_command)
    engine = Engine(package, node, limit_s, machine.usable_cores())
    spec = spec or release_names.parse_release(package.version)
    plan = builds.WebPlan(spec, engine, sizes, budget_s)

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        with WorkerPool(limit_s) as pool:
            yield from in_turn(
                sources,
                lambda source, _: Item([builds.measure(pool, source, plan)]),
                earlier,
                observer,
            )

    arguments = {
        "models": [source.name for source in sources],
        "release": spec.key,
        "node": node.version,
        "sizes": sizes,
        "budget_s": budget_s,
    }
    return Measurement("web", arguments, input_files(sources, [], sizes.starts), items, finished)
