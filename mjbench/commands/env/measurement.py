"""Measure an environment: the parent's side, which imports nothing of the environment's.

Two child processes: one for the environment, its layers and the same physics by other paths, one
for its vectorised forms. The record also holds what a child sent before it failed.
"""

import dataclasses
from collections.abc import Sequence

from mjbench import paths
from mjbench.commands.env import vectors
from mjbench.commands.env.child_process import (
    EnvironmentPlan,
    EnvironmentRequest,
    EnvironmentRound,
    measure_in_child,
)
from mjbench.commands.env.layer_shares import LayerSamples
from mjbench.commands.env.physics_comparison import CHOICES, PATHS
from mjbench.commands.env.result import EnvironmentRecord, PathSamples
from mjbench.commands.env.source import EnvironmentSource
from mjbench.host import isolate
from mjbench.host.isolate import Ended
from mjbench.status import Status
from mjbench.verification import selection
from mjbench.verification.path_verification import AgreementReport
from mjbench.verification.plan import Variant


def measure(source: EnvironmentSource, plan: EnvironmentPlan) -> EnvironmentRecord:
    """Return what was measured of an environment; after Ctrl-C, what was until then."""
    variants = selection.variants(PATHS, plan.threads, CHOICES)
    messages: list[object] = []
    try:
        ended = isolate.run(
            measure_in_child,
            (EnvironmentRequest(source, plan, variants),),
            messages.append,
            plan.limit_s,
        )
    except KeyboardInterrupt:
        return _record(source, variants, messages, None)
    record = _record(source, variants, messages, ended)
    if record.status != Status.OK or not plan.nenv:
        return record
    return vectors.added(record, source, plan)


def _record(
    source: EnvironmentSource,
    variants: Sequence[Variant],
    messages: Sequence[object],
    ended: Ended | None,
) -> EnvironmentRecord:
    rounds = [each for each in messages if isinstance(each, EnvironmentRound)]
    untimed = next(
        (each for each in messages if isinstance(each, EnvironmentRecord)),
        EnvironmentRecord(environment=source.name),
    )
    record = dataclasses.replace(
        untimed,
        status=ended.status if ended else Status.INTERRUPTED,
        detail=ended.detail if ended else f"after {len(rounds)} rounds",
    )
    if record.facts is None:
        return record
    reports = {each.position: each for each in messages if isinstance(each, AgreementReport)}
    return dataclasses.replace(
        record,
        step_ns=[each.step_ns for each in rounds],
        compared_ns=[each.compared_ns for each in rounds if each.compared_ns is not None],
        reset_ns=[each.reset_ns for each in rounds],
        layered_ns=[each.layered_ns for each in rounds],
        timer_ns=[each.timer_ns for each in rounds],
        layers=_layers(rounds, record.facts.nstep),
        paths=[_path(variants[position], report, rounds) for position, report in reports.items()],
        cores=[each.cores for each in rounds],
    )


def _layers(rounds: Sequence[EnvironmentRound], nstep: int) -> list[LayerSamples]:
    by_round = [{(layer.layer, layer.name): layer for layer in each.layers} for each in rounds]
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


def _path(
    variant: Variant, report: AgreementReport, rounds: Sequence[EnvironmentRound]
) -> PathSamples:
    position, is_ok = report.position, report.status == Status.OK
    return PathSamples(
        path=variant.path,
        options=variant.options,
        closed_loop=paths.find(variant.path).closed_loop,
        status=report.status,
        detail=report.detail,
        ns=[each.path_ns[position] for each in rounds if position in each.path_ns] if is_ok else (),
    )
