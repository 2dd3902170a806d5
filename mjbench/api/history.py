"""What `mjbench history` measures: times and instructions of one release after the other."""

from collections.abc import Sequence

from mjbench.api.session import Item, Items, Measurement, Observer, input_files, pinning_notes
from mjbench.counts import explain, records
from mjbench.errors import InputError
from mjbench.paired import history_measurement
from mjbench.paired.history_tasks import Selection
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_ratios
from mjbench.simulation.starts import DEFAULT_STARTS
from mjbench.store.runs import Record


def ratios(selection: Selection) -> Measurement:
    """Return the measurement of times over those of the reference, `mjbench history measure`."""

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        with WorkerPool() as pool:
            for measured in history_measurement.measure_rest(pool, selection, earlier, observer):
                yield Item(measured)

    return Measurement(
        "history",
        selection.arguments,
        input_files(selection.sources, selection.releases, DEFAULT_STARTS),
        measure,
        release_ratios.finished,
        pinning_notes(),
    )


def changes(selection: Selection) -> Measurement:
    """Return the count of instructions from release to release, `mjbench history explain`."""
    if len(selection.releases) < 2:
        raise InputError("give two releases or more")

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        for counted in explain.count_rest(selection, earlier, observer):
            yield Item(counted)

    files = [source.path for source in selection.sources]
    return Measurement("history-explain", selection.arguments, files, measure, records.finished)
