"""Measure one accelerated path on one model, in a child process of its own (see `isolate`).

The child loads the workload that `verify_in_child` saved, compiles, takes single steps from states
of the reference run, checks them against C, and only then times the steady program.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench import paths
from mjbench.commands.compare.accelerated_agreement import (
    CheckedRun,
    Programs,
    SteppingProgram,
    check_run,
    probe_workload,
    reordered_end_problem,
    timed_end_problem,
)
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.limits import TIME_LIMIT_S
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
from mjbench.paths.warp_buffers import OverflowedError
from mjbench.simulation import models
from mjbench.simulation.accelerated_judgement import (
    EngineAnswer,
    EngineJudgement,
    JudgedPart,
    PartName,
)
from mjbench.simulation.constraint_problem import converging, without_constraints
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.verification import selection
from mjbench.verification.plan import Variant
from mjbench.verification.records import MeasurementRecord

# Timed blocks: for this many seconds, no fewer and no more than these.
STEADY_S, MIN_BLOCKS, MAX_BLOCKS = 2.0, 7, 100
# Share of the available memory that the child of one path may take.
CHILD_MEMORY_SHARE = 0.8
# A compiler may be silent for this many times the limit of anything else.
COMPILER_PATIENCE = 5


@dataclass(frozen=True)
class AcceleratedRequest:
    """One model and one path that compiles, to be measured alone.

    Attributes:
      is_named: whether the user asked for this path; others are not tried where they are slow.
      limit_s: seconds of silence after which the child is killed; its compiler gets more.
    """

    source: ModelSource
    variant: Variant
    workload_file: Path
    is_named: bool = True
    limit_s: float = TIME_LIMIT_S


def run(
    request: AcceleratedRequest,
    on_record: Callable[[MeasurementRecord], None],
    import_from: str | None = None,
) -> isolate.Ended:
    """Measure one path in a child that may crash; InputError where it does not compile."""
    source = ModelSource(request.source.name, request.source.path.resolve())
    return isolate.run(
        measure_in_child,
        (dataclasses.replace(request, source=source),),
        on_record,
        request.limit_s,
        import_from,
        accelerated_path(request.variant.path).environment(),
        memory_bytes=int(CHILD_MEMORY_SHARE * machine.available_memory_bytes()),
    )


def measure_in_child(request: AcceleratedRequest, channel: Channel) -> None:
    """Measure one path on one model; runs in the child.

    Messages: its `MeasurementRecord` as far as it is known, again after each stage and each timed
    block, so that an interrupt leaves what was timed; the last one counts. The path disagrees where
    single steps do, the run, or the end of the timed blocks.
    """
    name, variant = request.source.name, request.variant
    path = accelerated_path(variant.path)
    channel.doing(f"loading {name}")
    model = models.load(request.source)
    workload, resources = load_workload(model, request.workload_file)
    channel.doing(f"preparing {path.name} on {name}")
    channel.allow_silence(COMPILER_PATIENCE * request.limit_s)
    record = MeasurementRecord.of(name, variant)
    reason = _reason_not_to_run(path, workload, resources, request)
    if reason:
        channel.send(dataclasses.replace(record, status=Status.UNAVAILABLE, detail=reason))
        return
    channel.doing(f"compiling {path.name} for {name}")
    compiled = path.prepare(workload, variant.options, resources)
    record = dataclasses.replace(
        record,
        snippet=path.snippet(workload, {**variant.options, **compiled.buffer_sizes}),
        device=compiled.device,
        trace_s=compiled.trace_s,
        compile_s=compiled.compile_s,
        buffer_sizes=dict(compiled.buffer_sizes),
        versions=machine.package_versions(path.distributions),
    )
    channel.send(record)
    case = _Case(path, workload, resources, compiled, request, channel)
    record = _judged_and_timed(case, record)
    record = dataclasses.replace(
        record,
        memory_bytes=machine.peak_memory_bytes(),
        gpu_memory_bytes=compiled.gpu_memory_bytes(),
    )
    channel.send(record)
    if record.agrees and request.is_named:
        channel.doing(f"compiling {path.name} again, with its cache")
        channel.allow_silence(COMPILER_PATIENCE * request.limit_s)
        channel.send(dataclasses.replace(record, cached_compile_s=compiled.cached_compile_s()))
    resources.close()


@dataclass(frozen=True, eq=False)
class _Case:
    path: AcceleratedPath
    workload: Workload
    resources: paths.Resources
    compiled: Compiled
    request: AcceleratedRequest
    channel: Channel

    def programs(self) -> Programs:
        return Programs(
            self._program(self.workload, self.compiled),
            self._compiled(without_constraints(self.workload.model), "smooth dynamics"),
            self._compiled(converging(self.workload.model), "the constraint problem"),
            self.compiled.is_deterministic,
        )

    def allow_silence(self) -> None:
        self.channel.allow_silence(self.request.limit_s)

    def _compiled(self, model: mujoco.MjModel, name: str) -> SteppingProgram:
        variant, peaks = self.request.variant, reference_peaks(self.workload, self.resources)
        self.channel.doing(f"compiling {variant.path} for {name}")
        self.channel.allow_silence(COMPILER_PATIENCE * self.request.limit_s)
        steps = probe_workload(model, self.workload)
        return self._program(steps, self.path.compile(steps, variant.options, peaks))

    def _program(self, workload: Workload, compiled: Compiled) -> SteppingProgram:
        def advance(
            fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
        ) -> StepOutcome:
            # each call has the limit to itself, so that a program that hangs is killed soon
            self.allow_silence()
            return compiled.advance(fields, control, nstep)

        return SteppingProgram(advance, workload)


def _judged_and_timed(case: _Case, record: MeasurementRecord) -> MeasurementRecord:
    try:
        programs = case.programs()
        case.channel.doing(f"judging {case.request.variant.path} on {record.model}")
        checked = check_run(case.workload, programs, case.path.precision, case.allow_silence)
        record = _judged(record, checked.judgement)
        if not record.agrees:
            return record
        case.channel.send(record)
        return _timed(case, record, checked)
    except OverflowedError as error:
        part = JudgedPart(PartName.BUFFERS, EngineAnswer.NO, reason=str(error))
        return _judged(record, EngineJudgement.of(case.path.precision, [part]))


def _timed(case: _Case, record: MeasurementRecord, checked: CheckedRun) -> MeasurementRecord:
    variant = case.request.variant
    case.channel.doing(f"timing {variant}")
    case.channel.allow_silence(2 * case.request.limit_s)
    for samples_s in _steady_s(case.compiled):
        record = dataclasses.replace(record, samples_s=samples_s)
        case.channel.send(record)  # a sign of life, too: each block has the limit to itself
    problem = timed_end_problem(case.workload, case.compiled, checked)
    if not problem:
        case.channel.doing(f"reordering the simulations of {variant}")
        problem = reordered_end_problem(case.workload, case.compiled, checked)
    if not problem:
        return record
    return _judged(record, checked.judgement.with_failed_run(problem))


def _judged(record: MeasurementRecord, judged: EngineJudgement) -> MeasurementRecord:
    is_wrong = judged.answer == EngineAnswer.NO
    return dataclasses.replace(
        record,
        status=Status.DISAGREES if is_wrong else record.status,
        detail=judged.reason if is_wrong else record.detail,
        agrees=judged.agrees,
        agreement=judged.summary,
        judgement=judged,
    )


def _steady_s(compiled: Compiled) -> Iterator[tuple[float, ...]]:
    """Yield the seconds of all steady blocks so far, after each; one before them warms up."""
    contender = timing.Contender(compiled.run, before=compiled.clear)
    timing.block_s(contender)
    end = time.perf_counter() + STEADY_S
    samples_s: tuple[float, ...] = ()
    while len(samples_s) < MIN_BLOCKS or (
        time.perf_counter() <= end and len(samples_s) < MAX_BLOCKS
    ):
        samples_s = (*samples_s, timing.block_s(contender))
        yield samples_s


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
    device_kind = path.device_kind()  # before `unsuited`: it says where there is no device
    reason = path.unsuited(workload, request.variant.options)
    if reason or request.is_named or device_kind != CPU:
        return reason
    return selection.why_left_out_on_a_cpu(workload, resources)


def not_compiled(limit_s: float) -> str:
    """Return why a path that has not compiled in time has no speed, and what helps."""
    return (
        f"not compiled within {COMPILER_PATIENCE * limit_s:g} s, and killed: its"
        " first step comes later than that, and no speed of its is known. Paths of C need no"
        f" compiler; --time-limit {2 * limit_s:g} gives this one twice the time"
    )
