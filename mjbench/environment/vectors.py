"""Several environments at once, by Gymnasium's SyncVectorEnv and AsyncVectorEnv: the parent's side.

A form that ends its child process loses its own row; the child is started again without it.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from mjbench.environment.records import EnvironmentRecord, VectorForm, VectorSamples
from mjbench.environment.source import EnvironmentSource
from mjbench.environment.vector_run import (
    FormReport,
    NoForms,
    VectorPlan,
    VectorRequest,
    VectorRound,
)
from mjbench.instrument import isolate, machine
from mjbench.status import Status


def added(
    record: EnvironmentRecord, source: EnvironmentSource, plan: VectorPlan
) -> EnvironmentRecord:
    """Return a record with the vectorised forms of its environment, measured in child processes.

    Raises:
      MachineError: no process can be started.
    """
    step_s = float(np.median(record.step_ns)) * 1e-9
    repeats = record.facts is not None and record.facts.repeats
    measurement = _Measurement(plan)
    fatal: dict[int, FormReport] = {}
    while True:
        measurement.forget_all_but(fatal)
        request = VectorRequest(source, plan, step_s, repeats, frozenset(fatal))
        try:
            ended = isolate.run(
                "mjbench.environment.vector_run:measure_in_child",
                request,
                measurement.receive,
                plan.limit_s,
            )
        except KeyboardInterrupt:
            return dataclasses.replace(
                record,
                status=Status.INTERRUPTED,
                detail="in vectorised forms",
                vectors=measurement.samples(Status.INTERRUPTED, "stopped before it was timed"),
            )
        culprit = ended.activity.index if ended.activity else None
        if ended.status == Status.OK or culprit is None or culprit in fatal:
            break
        fatal[culprit] = FormReport(culprit, ended.status, ended.detail)
    if measurement.no_forms or (ended.status == Status.INPUT and not measurement.has_reports):
        return dataclasses.replace(record, no_vectors=measurement.no_forms or ended.detail)
    samples = measurement.samples(ended.status, ended.detail or "it was not timed")
    return dataclasses.replace(record, vectors=samples)


class _Measurement:
    """What is known of vectorised forms so far.

    Attributes:
      no_forms: why there are none; empty where there are.
    """

    def __init__(self, plan: VectorPlan):
        self._forms = plan.forms()
        self.no_forms = ""
        self._reports: dict[int, FormReport] = {}
        self._rounds: list[VectorRound] = []

    @property
    def has_reports(self) -> bool:
        """Whether any form was looked at."""
        return bool(self._reports)

    def forget_all_but(self, fatal: Mapping[int, FormReport]) -> None:
        """Drop what is about to be measured again."""
        self._reports, self._rounds = dict(fatal), []

    def receive(self, message: object) -> None:
        """Store a message of the child."""
        match message:
            case NoForms(reason):
                self.no_forms = reason
            case FormReport():
                self._reports[message.index] = message
            case VectorRound():
                self._rounds.append(message)
            case _:
                raise TypeError(f"unexpected message {message!r}")

    def samples(self, status: Status, detail: str) -> list[VectorSamples]:
        """Return the samples of every form; one that nothing is known of ended as given."""
        return [self._sample(i, FormReport(i, status, detail)) for i in range(len(self._forms))]

    def _sample(self, index: int, unknown: FormReport) -> VectorSamples:
        form, nenv = self._forms[index]
        report = self._reports.get(index, unknown)
        if report.status != Status.OK:
            return VectorSamples(form, nenv, report.status, report.detail)
        rounds = [each for each in self._rounds if index in each.ns]
        if not rounds:
            return VectorSamples(form, nenv, unknown.status, unknown.detail)
        return VectorSamples(
            form,
            nenv,
            report.status,
            report.detail,
            [each.ns[index] for each in rounds],
            [each.single_ns[index] for each in rounds],
            1 if form == VectorForm.SYNC else min(nenv, machine.usable_cores()),
        )
