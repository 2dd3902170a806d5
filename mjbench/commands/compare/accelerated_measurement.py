"""Measure one accelerated path on one model, in a child process of its own (see `isolate`).

The child loads the workload that `verify_in_child` saved, compiles, takes single steps from states
of the reference run, checks them against C, and only then times the steady program.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.commands.compare.accelerated_agreement import (
    Programs,
    check_run,
    probe_workload,
    reordered_end_problem,
    timed_end_problem,
)
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.limits import TIME_LIMIT_S
from mjbench.paths.accelerated import (
    CPU,
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
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.verification import selection
from mjbench.verification.plan import Variant
from mjbench.verification.records import VariantRecord

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
      end_s: when it is killed, by the monotonic clock.
    """

    source: ModelSource
    variant: Variant
    workload_file: Path
    is_named: bool = True
    limit_s: float = TIME_LIMIT_S
    end_s: float = math.inf


def run(
    request: AcceleratedRequest,
    on_record: Callable[[VariantRecord], None],
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
        end_s=request.end_s,
    )


def measure_in_child(request: AcceleratedRequest, channel: Channel) -> None:
    """Measure one path on one model; runs in the child.

    Messages: its `VariantRecord` as far as it is known, again after each stage and each timed
    block, so that an interrupt leaves what was timed; the last one counts. The path disagrees where
    single steps do, the run, or the end of the timed blocks.
    """
    _Measurement(request, channel).run()


class _Measurement:
    """One path on one model: compiled, judged, warmed up and timed; its record grows meanwhile."""

    def __init__(self, request: AcceleratedRequest, channel: Channel):
        self._request, self._channel, self._variant = request, channel, request.variant
        self._path = accelerated_path(request.variant.path)
        self._record = VariantRecord.of(request.source.name, request.variant)

    def run(self) -> None:
        request, path, options = self._request, self._path, self._variant.options
        self._channel.doing(f"loading {request.source.name}")
        workload, resources = load_workload(models.load(request.source), request.workload_file)
        self._begin(f"preparing {path.name} on {request.source.name}", COMPILER_PATIENCE)
        if reason := self._reason_not_to_run(workload, resources):
            self._send(status=Status.UNAVAILABLE, detail=reason)
            return
        self._channel.doing(f"compiling {path.name} for {request.source.name}")
        compiled = path.prepare(workload, options, resources)
        self._send(
            snippet=path.snippet(workload, {**options, **compiled.buffer_sizes}),
            device=compiled.device,
            trace_s=compiled.trace_s,
            compile_s=compiled.compile_s,
            buffer_sizes=dict(compiled.buffer_sizes),
            versions=machine.package_versions(path.distributions),
        )
        try:
            self._judge_and_time(compiled, reference_peaks(workload, resources))
        except OverflowedError as error:
            part = JudgedPart(PartName.BUFFERS, EngineAnswer.NO, reason=str(error))
            self._record = dataclasses.replace(self._record, samples_s=())
            self._judge(EngineJudgement.of(path.precision, [part]))
        self._send(
            memory_bytes=machine.peak_memory_bytes(), gpu_memory_bytes=compiled.gpu_memory_bytes()
        )
        has_time = compiled.compile_s < request.end_s - time.monotonic()
        if self._record.agrees and request.is_named and has_time:
            self._begin(f"compiling {path.name} again, with its cache", COMPILER_PATIENCE)
            self._send(cached_compile_s=compiled.cached_compile_s())
        resources.close()

    def _reason_not_to_run(self, workload: Workload, resources: paths.Resources) -> str | None:
        """Return why the path cannot run the workload, or is not worth trying unasked."""
        path = self._path
        reason = path.unavailable() or path.cannot_return(workload.returns)
        if reason:
            return reason
        device_kind = path.device_kind()  # before `unsuited`: it says where there is no device
        reason = path.unsuited(workload, self._variant.options)
        if reason or self._request.is_named or device_kind != CPU:
            return reason
        return selection.why_left_out_on_a_cpu(workload, resources)

    def _judge_and_time(self, compiled: Compiled, peaks: Peaks) -> None:
        model = compiled.workload.model
        programs = Programs(
            self._with_a_limit(compiled),
            self._probe(compiled, without_constraints(model), "smooth dynamics", peaks),
            self._probe(compiled, converging(model), "the constraint problem", peaks),
        )
        self._channel.doing(f"judging {self._variant.path} on {self._request.source.name}")
        checked = check_run(programs, self._path.precision, self._allow_silence)
        self._judge(checked.judgement)
        if not self._record.agrees:
            return
        self._send()
        self._begin(f"timing {self._variant}", 2)
        for samples_s in _steady_s(compiled):
            # a sign of life, too: each block has the limit to itself
            self._send(samples_s=samples_s)
        problem = timed_end_problem(compiled, checked)
        if not problem:
            self._channel.doing(f"reordering the simulations of {self._variant}")
            problem = reordered_end_problem(compiled, checked)
        if problem:
            self._judge(checked.judgement.with_failed_run(problem))

    def _probe(
        self, compiled: Compiled, model: mujoco.MjModel, name: str, peaks: Peaks
    ) -> Compiled:
        self._begin(f"compiling {self._variant.path} for {name}", COMPILER_PATIENCE)
        steps = probe_workload(model, compiled.workload)
        return self._with_a_limit(self._path.compile(steps, self._variant.options, peaks))

    def _with_a_limit(self, compiled: Compiled) -> Compiled:
        """Return a program each of whose calls may take the limit, so that a hang ends soon."""

        def advance(
            fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
        ) -> StepOutcome:
            self._allow_silence()
            return compiled.advance(fields, control, nstep)

        return dataclasses.replace(compiled, advance=advance)

    def _judge(self, judgement: EngineJudgement) -> None:
        is_wrong = judgement.answer == EngineAnswer.NO
        self._record = dataclasses.replace(
            self._record,
            status=Status.DISAGREES if is_wrong else self._record.status,
            detail=judgement.reason if is_wrong else self._record.detail,
            agrees=judgement.agrees,
            agreement=judgement.summary,
            judgement=judgement,
        )

    def _begin(self, text: str, limits: float) -> None:
        self._channel.doing(text)
        self._allow_silence(limits)

    def _allow_silence(self, limits: float = 1) -> None:
        self._channel.allow_silence(limits * self._request.limit_s)

    def _send(self, **changes: Any) -> None:
        self._record = dataclasses.replace(self._record, **changes)
        self._channel.send(self._record)


def _steady_s(compiled: Compiled) -> Iterator[tuple[float, ...]]:
    """Yield the seconds of all steady blocks so far, after each; one before them warms up."""
    compiled.block_s()
    end = time.perf_counter() + STEADY_S
    samples_s: tuple[float, ...] = ()
    while len(samples_s) < MIN_BLOCKS or (
        time.perf_counter() <= end and len(samples_s) < MAX_BLOCKS
    ):
        samples_s = (*samples_s, compiled.block_s())
        yield samples_s


def not_compiled(seconds: float, more_time: str) -> str:
    """Return why a path that has not compiled in time has no speed, and what helps.

    Args:
      more_time: what to give for more, such as `--time-limit 120`.
    """
    return (
        f"not compiled after {seconds:.0f} s, and killed, so its speed is not known: give"
        f" {more_time} or more, or a model with fewer bodies and contacts; paths of C need no"
        " compiler"
    )
