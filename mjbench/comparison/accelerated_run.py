"""Measure one accelerated path on one model, in a child process of its own (see `isolate`).

The child loads the workload that `measure` saved, compiles, takes single steps from states of the
reference run, checks them against C, and only then times the steady program.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.comparison.accelerated_check import (
    check_run,
    reordered_end_problem,
    timed_end_problem,
)
from mjbench.comparison.messages import (
    AcceleratedRequest,
    AgreementReport,
    BlockTime,
    CachedCompile,
    CompileReport,
    PeakMemory,
)
from mjbench.comparison.plan import LIMIT_S, Variant
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.paths.accelerated import (
    CPU,
    AcceleratedPath,
    Compiled,
    StepOutcome,
    accelerated_path,
    load_workload,
    reference_peaks,
)
from mjbench.simulation import accelerated_limits, models, work
from mjbench.simulation.workload import Workload
from mjbench.status import Status

# Timed blocks: for this many seconds, no fewer and no more than these.
STEADY_S, MIN_BLOCKS, MAX_BLOCKS = 2.0, 7, 100
# Share of the available memory that the child of one path may take.
CHILD_MEMORY_SHARE = 0.8
# A compiler may be silent for this many times the limit of anything else.
COMPILER_PATIENCE = 5
# On a CPU, MJX is slow on a model that makes contact (docs/method/accelerated.md gives figures),
# and takes minutes to compile RK4, which has four of everything: not tried unless named.
CONTACT_REASON = "makes contact, where it is slow on a CPU; name it with --paths to try it"
RK4_REASON = "is integrated by RK4, which compiles for minutes; name it with --paths to try it"


def run(
    source: models.ModelSource,
    variant: Variant,
    workload_file: Path,
    on_message: Callable[[Any], None],
    is_named: bool = True,
    limit_s: float = LIMIT_S,
    import_from: str | None = None,
) -> isolate.Ended:
    """Measure one path on one model in a child; whatever becomes of it, this process goes on.

    Args:
      workload_file: that `paths.accelerated.save_workload` wrote.
      on_message: called with the child's messages (see `measure_in_child`).
      is_named: whether the user asked for this path; others are not tried where they are slow.
      limit_s: seconds of silence after which the child is killed; its compiler gets more.
      import_from: a folder that a path of the user's own may be imported from.

    Raises:
      InputError: the path does not compile.
    """
    source = models.ModelSource(source.name, source.path.resolve())
    return isolate.run(
        "mjbench.comparison.accelerated_run:measure_in_child",
        AcceleratedRequest(source, variant, workload_file, is_named, limit_s),
        on_message,
        limit_s,
        import_from,
        accelerated_path(variant.path).environment(),
        memory_bytes=int(CHILD_MEMORY_SHARE * machine.available_memory_bytes()),
    )


def measure_in_child(request: AcceleratedRequest, channel: Channel) -> None:
    """Measure one path on one model; runs in the child.

    Messages: an `AgreementReport`; before it a `CompileReport`, after it a `BlockTime` for each
    block and a `PeakMemory`, where it comes to that, and a `CachedCompile` where the user asked for
    this path. A second `AgreementReport` revises the first where the timed blocks end elsewhere.
    """
    name, options = request.source.name, request.variant.options
    path = accelerated_path(request.variant.path)
    channel.doing(f"loading {name}")
    model = models.load(request.source)
    workload, resources = load_workload(model, request.workload_file)
    channel.doing(f"preparing {path.name} on {name}")
    channel.allow_silence(COMPILER_PATIENCE * request.limit_s)
    reason = _reason_not_to_run(path, workload, resources, request)
    if reason:
        channel.send(AgreementReport(0, Status.UNAVAILABLE, reason))
        return
    channel.doing(f"compiling {path.name} for {name}")
    compiled = path.prepare(workload, options, resources)
    digest = workload.digest()
    channel.send(
        CompileReport(
            compiled.device,
            compiled.trace_s,
            compiled.compile_s,
            digest,
            dict(compiled.buffer_sizes),
        )
    )
    channel.doing(f"checking {path.name} on {name}")
    snippet = path.snippet(workload, {**options, **compiled.buffer_sizes})
    agrees = _check_and_time(_Case(workload, compiled, path, snippet, request), channel)
    channel.send(PeakMemory(machine.peak_memory_bytes(), compiled.gpu_memory_bytes()))
    if agrees and request.is_named:
        channel.doing(f"compiling {path.name} again, with its cache")
        channel.allow_silence(COMPILER_PATIENCE * request.limit_s)
        channel.send(CachedCompile(compiled.cached_compile_s()))
    resources.close()


@dataclass(frozen=True)
class _Case:
    """A compiled path with what it runs."""

    workload: Workload
    compiled: Compiled
    path: AcceleratedPath
    snippet: str
    request: AcceleratedRequest


def _check_and_time(case: _Case, channel: Channel) -> bool:
    """Check the compiled run; where it agrees, time it and compare the timed blocks' end.

    Returns:
      Whether it agrees.
    """
    limit_s = case.request.limit_s

    def advance(fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int) -> StepOutcome:
        # each call has the limit to itself, so that a program that hangs is killed soon
        channel.allow_silence(limit_s)
        return case.compiled.advance(fields, control, nstep)

    checked = check_run(case.workload, advance, case.path.precision)
    failures = accelerated_limits.failures(checked.check)
    agrees = not failures
    report = AgreementReport(
        0,
        Status.OK if agrees else Status.DISAGREES,
        "; ".join(failures),
        agrees,
        accelerated_limits.summary(checked.check),
        case.snippet,
        checked.check,
    )
    channel.send(report)
    if not agrees:
        return False
    channel.doing(f"timing {case.request.variant}")
    _time(case.compiled, channel, limit_s)
    problem = timed_end_problem(case.workload, case.compiled, checked)
    if not problem:
        channel.doing(f"reordering the simulations of {case.request.variant}")
        problem = reordered_end_problem(case.workload, case.compiled, checked)
    if problem:
        channel.send(
            dataclasses.replace(
                report,
                status=Status.DISAGREES,
                detail=problem,
                agrees=False,
                agreement=problem,
            )
        )
    return not problem


def _time(compiled: Compiled, channel: Channel, limit_s: float) -> None:
    """Send the seconds of steady blocks, after one that warms up."""
    channel.allow_silence(2 * limit_s)
    contender = timing.Contender(compiled.run, before=compiled.clear)
    timing.block_s(contender)
    end = time.perf_counter() + STEADY_S
    for count in range(1, MAX_BLOCKS + 1):
        channel.send(BlockTime(timing.block_s(contender)))
        if time.perf_counter() > end and count >= MIN_BLOCKS:
            break


def _reason_not_to_run(
    path: AcceleratedPath,
    workload: Workload,
    resources: paths.Resources,
    request: AcceleratedRequest,
) -> str | None:
    """Return why the path cannot run the workload, or is not worth trying unasked; else None."""
    reason = path.unavailable() or path.cannot_return(workload.returns)
    if reason:
        return reason
    device_kind = path.device_kind()
    reason = path.unsuited(workload, request.variant.options)
    if reason or request.is_named or device_kind != CPU:
        return reason
    if work.describe(workload.model).integrator == "rk4":
        return RK4_REASON
    return CONTACT_REASON if reference_peaks(workload, resources).contacts else None
