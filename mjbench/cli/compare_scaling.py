"""`mjbench compare --scaling`: how many threads, which chunk size, how many simulations."""

import contextlib
import dataclasses
import functools
from typing import TYPE_CHECKING

from mjbench.cli.context import OutputOptions, RunContext, Storage
from mjbench.status import FINISHED, Status

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjbench.api.confirmation import Confirmation
    from mjbench.comparison.scaling import ScalingRecord, ScalingRequest, ScalingRun
    from mjbench.instrument.progress import Progress
    from mjbench.instrument.runs import Record
    from mjbench.report.thread_advice import ScalingResults
    from mjbench.simulation.models import ModelSource


def search_models(
    sources: "Sequence[ModelSource]",
    request: "ScalingRequest",
    output: OutputOptions,
    confirm: bool,
    code: bool,
) -> None:
    """Search each model, and end the process with the exit code of all runs.

    Args:
      confirm: whether to compare what is advised again in fresh processes.
      code: whether to print the Python of what is advised.
    """
    from mjbench.api.confirmation import Confirmation
    from mjbench.instrument.runs import to_json
    from mjbench.paths import user_module_files
    from mjbench.report import scaling as report
    from mjbench.report.documents import CompareDocument

    arguments = {**to_json(request), "models": [source.name for source in sources]}
    storage = Storage(output.results, arguments, output.resume, _finished)
    files = [source.path for source in sources]
    files += user_module_files(request.path_names)
    files += request.plan.starts.files
    models: list[ScalingResults] = []
    with RunContext("compare", output.json_file, files, storage, output.wait) as run:
        with run.progress(len(sources)) as advance, contextlib.ExitStack() as closing:
            confirmation = Confirmation(run.record, closing)
            for number, source in enumerate(sources):
                on_progress = functools.partial(advance, number)
                search = _ModelSearch(run, source, request, on_progress, confirmation)
                models.append(search.results(confirm))
                report.print_results(run.out, models[-1], code)
                if run.interrupted:
                    break
        run.write(CompareDocument.of_scaling(run.machine, models))
    run.exit(_statuses(models))


def _finished(records: "Sequence[Record]") -> "list[Record]":
    """Return the records that need not be measured again: of runs and of confirmations."""
    from mjbench.comparison.scaling import ScalingRecord
    from mjbench.paired.confirmation import ConfirmationRecord

    return [
        record
        for record in records
        if (isinstance(record, ScalingRecord) and record.is_finished)
        or (isinstance(record, ConfirmationRecord) and record.status in FINISHED)
    ]


def _statuses(models: "Sequence[ScalingResults]") -> list[Status]:
    records = [record for results in models for record in results.records]
    return [
        status
        for record in records
        for status in (record.model.status, *(m.status for m in record.measurements))
    ]


class _ModelSearch:
    """The search on one model: what is in the run file already is not measured again."""

    def __init__(
        self,
        run: RunContext,
        source: "ModelSource",
        request: "ScalingRequest",
        on_progress: "Progress",
        confirmation: "Confirmation",
    ):
        self._run, self._source, self._request = run, source, request
        self._on_progress, self._confirmation = on_progress, confirmation

    def results(self, confirm: bool) -> "ScalingResults":
        """Return the results; `confirm`: whether to compare again what is advised."""
        from mjbench.comparison import scaling_search
        from mjbench.paired.confirmation import ConfirmationRecord
        from mjbench.report.thread_advice import ScalingResults

        records: list[ScalingRecord] = []
        search = scaling_search.search(self._request)
        wanted = next(search, None)
        while wanted is not None and not self._run.interrupted:
            records.append(self._stored(wanted) or self._measure(wanted, len(records)))
            try:
                wanted = search.send(records[-1])
            except StopIteration:
                wanted = None
        stored = [
            record
            for record in self._run.resumed_records
            if isinstance(record, ConfirmationRecord) and record.model == self._source.name
        ]
        results = ScalingResults(tuple(records), tuple(stored))
        if confirm and results.points and not self._run.interrupted:
            results = self._confirmed(results)
        return results

    def _stored(self, wanted: "ScalingRun") -> "ScalingRecord | None":
        from mjbench.comparison.scaling import ScalingRecord

        for record in self._run.resumed_records:
            if isinstance(record, ScalingRecord) and wanted.is_of(record, self._source.name):
                return record
        return None

    def _measure(self, wanted: "ScalingRun", completed: int) -> "ScalingRecord":
        from mjbench.comparison import compare
        from mjbench.comparison.scaling import ScalingRecord
        from mjbench.comparison.scaling_search import share_done

        def on_progress(name: str, share: float) -> None:
            done = share_done(completed, share)
            self._on_progress(f"{name}: {wanted.stage}", done)

        records = compare.compare_model(self._source, wanted.plan, on_progress)
        record = ScalingRecord(
            stage=wanted.stage,
            topology=self._request.topology,
            model=records.model,
            measurements=records.measurements,
        )
        self._run.record(record)
        if records.interrupted:
            self._run.interrupt()
        return record

    def _confirmed(self, results: "ScalingResults") -> "ScalingResults":
        """Return the results with the comparisons in fresh processes that advice needs."""
        from mjbench.instrument.progress import part_of

        plan = dataclasses.replace(self._request.plan, nbatch=self._request.first_nbatch)
        while pairing := results.next_pairing():
            on_progress = part_of(self._on_progress, 1.0, 1.0)  # the bar is full
            record = self._confirmation.compare(
                self._source, plan, pairing, results.compared_sizes, on_progress
            )
            confirmations = (*results.confirmations, record)
            results = dataclasses.replace(results, confirmations=confirmations)
            if self._confirmation.is_interrupted:
                self._run.interrupt()
                break
        return results
