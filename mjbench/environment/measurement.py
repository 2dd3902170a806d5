"""Measure an environment: the parent's side, which imports nothing of the environment's.

Two child processes: one for the environment, its layers and the same physics by other paths, one
for its vectorised forms. The record also holds what a child sent before it failed.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench import paths
from mjbench.comparison import selection
from mjbench.comparison.messages import AgreementReport
from mjbench.comparison.plan import Variant
from mjbench.environment import vectors
from mjbench.environment.layer_shares import LayerSamples
from mjbench.environment.physics_comparison import CHOICES, PATHS
from mjbench.environment.records import EnvironmentRecord, PathSamples
from mjbench.environment.run import (
    EnvironmentReady,
    EnvironmentRequest,
    EnvironmentRound,
    PathDisagreed,
)
from mjbench.environment.source import EnvironmentSource
from mjbench.environment.vector_run import VectorPlan
from mjbench.instrument import isolate
from mjbench.instrument.isolate import Ended
from mjbench.status import Status


@dataclass(frozen=True)
class EnvironmentPlan:
    """What is measured of an environment.

    Attributes:
      nstep: steps of it in a pass; None to choose them.
      threads: of paths that have threads.
      nenv: numbers of environments in vectorised forms; none for no such forms.
      budget_s: seconds for all rounds of the environment, and again for those of vectorised forms.
      limit_s: a child that is silent for longer is killed.
    """

    nstep: int | None
    seed: int
    threads: tuple[int, ...]
    nenv: tuple[int, ...]
    budget_s: float
    limit_s: float


def measure(source: EnvironmentSource, plan: EnvironmentPlan) -> EnvironmentRecord:
    """Return what was measured of an environment.

    After Ctrl-C, the record holds what was measured before.

    Raises:
      MachineError: no process can be started.
    """
    variants = selection.variants(PATHS, plan.threads, CHOICES)
    measurement = _Measurement(source, variants)
    try:
        ended = isolate.run(
            "mjbench.environment.run:measure_in_child",
            EnvironmentRequest(source, plan.seed, plan.nstep, variants, plan.budget_s),
            measurement.receive,
            plan.limit_s,
        )
    except KeyboardInterrupt:
        return measurement.record(None)
    record = measurement.record(ended)
    if record.status != Status.OK or not plan.nenv:
        return record
    vector_plan = VectorPlan(plan.seed, plan.nenv, plan.budget_s, plan.limit_s)
    return vectors.added(record, source, vector_plan)


class _Measurement:
    """What is known of an environment so far."""

    def __init__(self, source: EnvironmentSource, variants: Sequence[Variant]):
        self._source, self._variants = source, variants
        self._ready: EnvironmentReady | None = None
        self._reports: dict[int, AgreementReport] = {}
        self._rounds: list[EnvironmentRound] = []

    def receive(self, message: object) -> None:
        """Store a message of the child."""
        match message:
            case EnvironmentReady():
                self._ready = message
            case AgreementReport():
                self._reports[message.index] = message
            case EnvironmentRound():
                self._rounds.append(message)
            case PathDisagreed(index, detail):
                self._reports[index] = AgreementReport(index, Status.DISAGREES, detail, False)
            case _:
                raise TypeError(f"unexpected message {message!r}")

    def record(self, ended: Ended | None) -> EnvironmentRecord:
        """Return the record; `ended` is None where the user interrupted."""
        status = ended.status if ended else Status.INTERRUPTED
        record = EnvironmentRecord(
            environment=self._source.name,
            status=status,
            detail=ended.detail if ended else f"after {len(self._rounds)} rounds",
        )
        ready, rounds = self._ready, self._rounds
        if ready is None:
            return record
        return dataclasses.replace(
            record,
            facts=ready.facts,
            check=ready.check,
            changes=ready.changes,
            step_ns=[each.step_ns for each in rounds],
            compared_ns=[each.compared_ns for each in rounds if each.compared_ns is not None],
            reset_ns=[each.reset_ns for each in rounds],
            layered_ns=[each.layered_ns for each in rounds],
            timer_ns=[each.timer_ns for each in rounds],
            timer_cost=ready.timer_cost,
            layers=self._layers(ready.facts.nstep),
            paths=[self._path(i) for i in self._reports],
            cores=[each.cores for each in rounds],
        )

    def _layers(self, nstep: int) -> list[LayerSamples]:
        """Return the samples of every function that was timed in all rounds."""
        by_round = [
            {(layer.layer, layer.name): layer for layer in each.layers} for each in self._rounds
        ]
        first = by_round[0] if by_round else {}
        return [
            LayerSamples(
                *key,
                counted.calls / nstep,
                counted.timed_calls / nstep,
                counted.inner_calls / nstep,
                [each[key].ns / nstep for each in by_round],
            )
            for key, counted in first.items()
            if all(key in each for each in by_round)
        ]

    def _path(self, index: int) -> PathSamples:
        variant, report = self._variants[index], self._reports[index]
        return PathSamples(
            path=variant.path,
            options=variant.options,
            closed_loop=paths.find(variant.path).closed_loop,
            status=report.status,
            detail=report.detail,
            ns=[each.path_ns[index] for each in self._rounds if index in each.path_ns]
            if report.status == Status.OK
            else (),
        )
