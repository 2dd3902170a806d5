"""What the history measures: times and instructions of one release after the other."""

from collections.abc import Mapping, Sequence

from benchmarks.history import counting, release_ratios, timing
from benchmarks.history.tasks import Selection
from mjbench.counts.records import ExplainRecord
from mjbench.errors import InputError
from mjbench.host import platforms
from mjbench.host.disturbance import Disturbance
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, finished, input_files
from mjbench.simulation.starts import DEFAULT_STARTS

# The records of a run file by their `type`.
RECORD_TYPES: Mapping[str, type] = {
    record.record_type: record
    for record in (
        release_ratios.StepRatioRecord,
        release_ratios.OperationRatioRecord,
        ExplainRecord,
        Disturbance,
    )
}


def ratios(selection: Selection) -> Measurement:
    """Return the measurement of times over those of the reference."""

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        with WorkerPool() as pool:
            for measured in timing.measure_rest(pool, selection, earlier, observer):
                yield Item(measured)

    return Measurement(
        "history",
        selection.arguments,
        input_files(selection.sources, selection.releases, DEFAULT_STARTS),
        measure,
        release_ratios.finished,
        platforms.pinning_notes(),
        RECORD_TYPES,
    )


def changes(selection: Selection) -> Measurement:
    """Return the count of instructions from release to release."""
    if len(selection.releases) < 2:
        raise InputError("give two releases or more")

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        for counted in counting.count_rest(selection, earlier, observer):
            yield Item(counted)

    paths = [source.path for source in selection.sources]
    return Measurement(
        "history-explain", selection.arguments, paths, measure, finished, record_types=RECORD_TYPES
    )
