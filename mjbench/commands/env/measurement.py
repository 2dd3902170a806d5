"""Measure an environment: the parent's side, which imports nothing of the environment's.

Two child processes: one for the environment, its layers and the same physics by other paths, one
for its vectorised forms. The record also holds what a child sent before it failed.
"""

import dataclasses
import time
from typing import Any

from mjbench.commands.env import vectors
from mjbench.commands.env.child_process import EnvironmentPlan, EnvironmentRequest, measure_in_child
from mjbench.commands.env.physics_comparison import CHOICES, PATHS
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.env.source import EnvironmentSource
from mjbench.host import isolate
from mjbench.status import Status
from mjbench.verification import selection


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
    record: EnvironmentRecord = dataclasses.replace(records[-1], status=status, detail=detail)
    if record.status != Status.OK or not plan.nenv:
        return record
    left_s = plan.budget_s - (time.monotonic() - begin_s)
    return vectors.added(record, source, dataclasses.replace(plan, budget_s=left_s))
