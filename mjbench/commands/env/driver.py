"""What `mjbench env` measures: the parent's side, which imports nothing of the environments'.

Two child processes: one for the environment, its layers and the same physics by other paths, one
for its vectorised forms. The record also holds what a child sent before it failed.
"""

import functools
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mjbench.commands.env import vectors
from mjbench.commands.env.child_process import EnvironmentPlan, EnvironmentRequest, measure_in_child
from mjbench.commands.env.options import EnvironmentOptions
from mjbench.commands.env.physics_comparison import CHOICES, PATHS
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.env.source import EnvironmentSource, resolve
from mjbench.errors import Failure, InputError, MjbenchError, failure_of
from mjbench.host import isolate, machine
from mjbench.measuring.timing import Progress
from mjbench.session import Item, Measurement, finished, in_turn
from mjbench.status import Status
from mjbench.verification import selection


def measurement(names: Sequence[str], options: EnvironmentOptions) -> Measurement:
    """Return the measurement of environments; without numbers, of powers of two and all cores."""
    if options.skip and options.nbatch:
        raise InputError("give --nbatch or --skip vectors, not both")
    sources = [resolve(name, Path.cwd()) for name in names]
    cores = machine.usable_cores()
    counts = options.nbatch or sorted({cores, *(2**i for i in range(cores.bit_length()))})
    plan = EnvironmentPlan(
        options.nstep,
        options.seed,
        tuple(options.threads or sorted({1, cores})),
        tuple([] if options.skip else counts),
        options.budget.each_s,
        options.time_limit_s,
        must_end=options.budget_s is not None,
    )

    def item(source: EnvironmentSource, budget_s: float, _: Progress) -> Item:
        try:
            record = measure(source, replace(plan, budget_s=budget_s))
        except MjbenchError as error:
            record = EnvironmentRecord.failed(source.name, failure_of(error))
        if record.facts is None and record.status != Status.INTERRUPTED:
            return Item([record], Failure(record.status, f"{source.name}: {record.detail}"))
        return Item([record])

    items = functools.partial(in_turn, sources, item, options.budget, attribute="environment")
    arguments = {"environments": list(names), "plan": plan, "budget_s": options.budget_s}
    return Measurement("env", arguments, [], items, finished)


def measure(source: EnvironmentSource, plan: EnvironmentPlan) -> EnvironmentRecord:
    """Return what was measured of an environment; after Ctrl-C, what was until then."""
    request = EnvironmentRequest(source, plan, selection.variants(PATHS, plan.threads, CHOICES))
    begin_s = time.monotonic()
    records: list[Any] = [EnvironmentRecord(environment=source.name)]
    try:
        ended = isolate.run(measure_in_child, (request,), records.append, plan.limit_s)
        status, detail = ended.status, ended.detail
    except KeyboardInterrupt:
        status, detail = Status.INTERRUPTED, f"after {len(records[-1].step_ns)} rounds"
    record: EnvironmentRecord = replace(records[-1], status=status, detail=detail)
    if record.status != Status.OK or not plan.nenv:
        return record
    left_s = plan.budget_s - (time.monotonic() - begin_s)
    return vectors.added(record, source, replace(plan, budget_s=left_s))
