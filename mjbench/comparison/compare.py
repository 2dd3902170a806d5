"""Verify the ways of stepping a model, and measure those that compile; one record a variant.

The parent never loads a model. It starts `measure` in a child, gathers the child's messages, and
returns each model's records when the model ends, however it ends. A path that kills the child
loses its own row; the child is started again without it. Accelerated paths, which compile first,
have a child each, alone (see `accelerated_run`).
"""

import dataclasses
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from mjbench import paths
from mjbench.comparison import accelerated_run
from mjbench.comparison.messages import (
    AgreementReport,
    BlockTime,
    CachedCompile,
    CompileReport,
    MeasureRequest,
    ModelFiles,
    PeakMemory,
)
from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.errors import Failure, failure_of
from mjbench.host import isolate, machine, scratch
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.simulation.models import ModelSource
from mjbench.status import Status


@dataclass
class _VariantState:
    """What is known of one variant so far."""

    report: AgreementReport | None = None
    samples_s: list[float] = field(default_factory=list)
    compile_report: CompileReport | None = None
    cached_compile: CachedCompile | None = None
    memory: PeakMemory | None = None


@dataclass(frozen=True)
class VerifiedModel:
    """Whether paths agree on one model.

    Attributes:
      measurements: one a variant, without times.
    """

    model: ModelRecord
    measurements: tuple[MeasurementRecord, ...]


def verify_model(source: ModelSource, plan: ComparisonPlan) -> VerifiedModel:
    """Verify the paths of a plan that run C, and time nothing."""
    with scratch.folder() as folder:
        children = ModelChildren(source, plan, ModelFiles.in_folder(folder))
        children.verify(lambda: None)
        measurements = children.measurements(children.agreeing, is_over=True)
        return VerifiedModel(children.model_record(), measurements)


@dataclass
class ModelChildren:
    """The children of one model's comparison, and what they have said so far.

    Attributes:
      files: that the child writes.
      reference: what the child said of the model and its reference run; None before.
      ended: how the last child ended that every path needs; None before, and where the user
        interrupted.
    """

    source: ModelSource
    plan: ComparisonPlan
    files: ModelFiles
    reference: ModelRecord | None = None
    ended: isolate.Ended | None = None
    variants: dict[int, _VariantState] = field(init=False)

    def __post_init__(self) -> None:
        self.variants = {i: _VariantState() for i in range(len(self.plan.variants))}

    @property
    def agreeing(self) -> list[int]:
        """The variants that run C and agree."""
        agreeing = []
        for index, state in self.variants.items():
            report = state.report
            if report and report.status == Status.OK and index not in self.plan.accelerated:
                agreeing.append(index)
        return agreeing

    @property
    def share_verified(self) -> float:
        """The share of the variants that have a report."""
        verified = sum(state.report is not None for state in self.variants.values())
        return verified / len(self.variants)

    def verify(self, on_message: Callable[[], None]) -> isolate.Ended:
        """Verify all paths that run C; start again without a path that ended the child.

        Args:
          on_message: called after each message of the child.
        """

        def receive(message: object) -> None:
            self._receive(message)
            on_message()

        # the child works in a folder of its own
        source = ModelSource(self.source.name, self.source.path.resolve())
        fatal: dict[int, AgreementReport] = {}
        while True:
            request = MeasureRequest(
                source,
                self.plan,
                frozenset([*fatal, *self.plan.accelerated]),
                self.files,
            )
            ended = isolate.run(
                "mjbench.comparison.measure:measure_in_child",
                request,
                receive,
                self.plan.limit_s,
                self.plan.import_from,
            )
            culprit = self._culprit(ended)
            if culprit is None:
                self.ended = ended
                return ended
            fatal[culprit] = AgreementReport(culprit, ended.status, ended.detail)
            self.variants = {i: _VariantState(fatal.get(i)) for i in self.variants}

    def _culprit(self, ended: isolate.Ended) -> int | None:
        """Return the variant that ended the child, if one did and the others can go on."""
        fatal = (Status.CRASHED, Status.TIMEOUT, Status.FAILED)
        if ended.status not in fatal or ended.activity is None:
            return None
        index = ended.activity.index
        if index is None or self.plan.variants[index].path == paths.BASE:
            return None
        report = self.variants[index].report
        # a variant that was already refused is not timed, so another one ended the child
        return index if report is None or report.status == Status.OK else None

    def _receive(self, message: object) -> None:
        """Store one message of the child that verifies the C paths."""
        match message:
            case ModelRecord():
                self.reference = message
            case AgreementReport():
                self.variants[message.index].report = message
            case _:
                raise TypeError(f"unexpected message {message!r}")

    def _receive_accelerated(self, index: int, message: object) -> None:
        """Store one message of the child of one accelerated path."""
        state = self.variants[index]
        match message:
            case AgreementReport():
                state.report = message
            case CompileReport():
                state.compile_report = message
            case BlockTime():
                state.samples_s.append(message.seconds)
            case CachedCompile():
                state.cached_compile = message
            case PeakMemory():
                state.memory = message
            case _:
                raise TypeError(f"unexpected message {message!r}")

    def revise(self, index: int, status: Status, detail: str) -> None:
        """Change a variant's report after the fact; its snippet and check stay."""
        report = self.variants[index].report or AgreementReport(index, status)
        if status == Status.DISAGREES:
            report = dataclasses.replace(report, agrees=False, agreement=detail)
        self.variants[index].report = dataclasses.replace(report, status=status, detail=detail)

    def run_accelerated(self, index: int) -> None:
        """Measure one accelerated path alone; whatever becomes of it costs its own row."""
        variant, state = self.plan.variants[index], self.variants[index]
        try:
            ended = accelerated_run.run(
                self.source,
                variant,
                self.files.accelerated,
                lambda message: self._receive_accelerated(index, message),
                is_named=variant.path in self.plan.named,
                limit_s=self.plan.limit_s,
                import_from=self.plan.import_from,
            )
        except Exception as error:  # a path's own `environment` may raise anything
            failure = failure_of(error)
            ended = isolate.Ended(failure.status, failure.detail)
        assert self.reference is not None
        digest = self.reference.workload_digest
        if ended.status != Status.OK:
            self.revise(index, ended.status, ended.detail)
        elif state.compile_report and state.compile_report.workload_digest != digest:
            self.variants[index].report = AgreementReport(
                index, Status.FAILED, "it did not receive the workload of the paths before"
            )

    def model_record(self) -> ModelRecord:
        """Return the record of the model as far as it is known."""
        ended = self.ended or Failure(Status.INTERRUPTED, "")
        return dataclasses.replace(
            self.reference or ModelRecord(model=self.source.name, status=ended.status),
            status=ended.status,
            detail=ended.detail,
            nbatch_asked=self.plan.nbatch,
            usable_cores=machine.usable_cores(),
            total_steps=self.plan.total_steps,
        )

    def measurements(self, timed: Collection[int], is_over: bool) -> tuple[MeasurementRecord, ...]:
        """Return the records of all variants as far as they are known, in the plan's order.

        Args:
          timed: variants that a race timed.
          is_over: whether nothing more is measured.
        """
        model = self.model_record()
        return tuple(
            self._measurement(model, index, self._outcome(state, index in timed, is_over))
            for index, state in self.variants.items()
        )

    def _measurement(self, model: ModelRecord, index: int, outcome: Failure) -> MeasurementRecord:
        variant, state = self.plan.variants[index], self.variants[index]
        path = paths.find(variant.path)
        report = state.report or AgreementReport(index, outcome.status)
        record = MeasurementRecord(
            model=model.model,
            path=variant.path,
            options=variant.options,
            status=outcome.status,
            detail=outcome.detail,
            agrees=report.agrees,
            agreement=report.agreement,
            closed_loop=path.closed_loop,
            snippet=report.snippet,
            nbatch=model.nbatch,
            nstep=model.nstep,
            hold=model.hold,
            returns=model.returns,
            seed=model.seed,
            diverged=model.diverged,
            warnings=model.warnings,
            workload_digest=model.workload_digest,
            state_digest=model.state_digest,
            work=model.work,
            nbatch_asked=model.nbatch_asked,
            samples_s=state.samples_s,
        )
        if not isinstance(path, AcceleratedPath):
            return record
        compiling, memory = state.compile_report, state.memory
        return dataclasses.replace(
            record,
            precision=path.precision,
            device=compiling.device if compiling else None,
            trace_s=compiling.trace_s if compiling else None,
            compile_s=compiling.compile_s if compiling else None,
            cached_compile_s=state.cached_compile.seconds if state.cached_compile else None,
            buffer_sizes=compiling.buffer_sizes if compiling else None,
            memory_bytes=memory.memory_bytes if memory else None,
            gpu_memory_bytes=memory.gpu_memory_bytes if memory else None,
            check=report.check,
        )

    def _outcome(self, state: _VariantState, is_timed: bool, is_over: bool) -> Failure:
        """Return status and detail of one variant."""
        report = state.report
        if report is not None and (report.status != Status.OK or is_timed or state.samples_s):
            return Failure(report.status, report.detail)
        if self.ended is None or not is_over:
            return Failure(Status.INTERRUPTED, "stopped before it was timed")
        if self.ended.status == Status.OK:
            return Failure(Status.FAILED, "it was not timed")
        return Failure(self.ended.status, self.ended.detail)
