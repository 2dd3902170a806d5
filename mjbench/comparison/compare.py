"""Compare the ways of stepping: one child process a model, one record a variant.

The parent never loads a model. It starts `measure` in a child, gathers the child's messages, and
returns each model's records when the model ends, however it ends. A path that kills the child
loses its own row; the child is started again without it. Accelerated paths, which compile first,
have a child each, after all others and alone (see `accelerated_run`).
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mjbench import paths
from mjbench.comparison import accelerated_run
from mjbench.comparison.messages import (
    AgreementReport,
    BlockDisagreed,
    BlockTime,
    CachedCompile,
    ClockRoundTimed,
    CompileReport,
    MeasureRequest,
    ModelReady,
    PeakMemory,
    RoundTimed,
)
from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.records import MeasurementRecord, ModelRecord, of_model
from mjbench.errors import failure_of
from mjbench.instrument import isolate, machine, scratch
from mjbench.instrument.progress import Progress
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# Share of a model's progress that verification stands for; timing is the rest.
VERIFICATION_SHARE = 0.3


@dataclass(frozen=True)
class ModelRecords:
    """What came of one model.

    Attributes:
      model: its own record.
      measurements: one a variant, in the plan's order.
      interrupted: whether the user stopped it before it was done.
    """

    model: ModelRecord
    measurements: tuple[MeasurementRecord, ...]
    interrupted: bool = False

    @property
    def all(self) -> list[ModelRecord | MeasurementRecord]:
        """The records in the order they are stored."""
        return [self.model, *self.measurements]


def compare_model(source: ModelSource, plan: ComparisonPlan, progress: Progress) -> ModelRecords:
    """Measure one model and return its records, also when the user interrupts (Ctrl-C)."""
    measurement = _ModelMeasurement(source, plan)
    try:
        ended = measurement.run(progress)
    except KeyboardInterrupt:
        return measurement.records(None)
    return measurement.records(ended)


def stored(
    source: ModelSource, plan: ComparisonPlan, records: Sequence[object]
) -> ModelRecords | None:
    """Return the records of a model at the plan's size from those of a run; None without any."""
    for record in records:
        if not isinstance(record, ModelRecord):
            continue
        if (record.model, record.nbatch_asked) == (source.name, plan.nbatch):
            return ModelRecords(record, tuple(of_model(record, records)))
    return None


@dataclass
class _VariantState:
    """What is known of one variant so far."""

    report: AgreementReport | None = None
    samples_s: list[float] = field(default_factory=list)
    with_clock_s: list[float] = field(default_factory=list)
    without_clock_s: list[float] = field(default_factory=list)
    compile_report: CompileReport | None = None
    cached_compile: CachedCompile | None = None
    memory: PeakMemory | None = None
    is_finished: bool = False  # it was timed to the end


@dataclass
class _ModelMeasurement:
    """The measurement of one model, and what is known so far."""

    source: ModelSource
    plan: ComparisonPlan
    ready: ModelReady | None = None
    cores: list[float] = field(default_factory=list)
    timed_s: float = 0.0
    variants: dict[int, _VariantState] = field(init=False)

    def __post_init__(self) -> None:
        self.variants = {i: _VariantState() for i in range(len(self.plan.variants))}

    def run(self, progress: Progress) -> isolate.Ended:
        """Measure the C paths together, then each accelerated path alone."""
        accelerated = [
            i for i, variant in enumerate(self.plan.variants) if paths.find(variant.path).compiles
        ]

        def receive(message: object) -> None:
            self._receive(message)
            progress(self.source.name, self._share_done())

        with scratch.folder() as folder:
            workload_file = folder / "workload.pickle" if accelerated else None
            ended = self._run_c_paths(accelerated, workload_file, receive)
            if ended.status != Status.OK:
                return ended
            for index in self.variants:
                self.variants[index].is_finished = index not in accelerated
            if workload_file is not None:
                for index in accelerated:
                    self._run_accelerated(index, workload_file)
        return ended

    def _run_c_paths(
        self,
        accelerated: list[int],
        workload_file: Path | None,
        receive: Callable[[object], None],
    ) -> isolate.Ended:
        """Measure all paths that run C; start again without a path that ended the child."""
        # the child works in a folder of its own
        source = ModelSource(self.source.name, self.source.path.resolve())
        fatal: dict[int, AgreementReport] = {}
        while True:
            exclude = frozenset([*fatal, *accelerated])
            ended = isolate.run(
                "mjbench.comparison.measure:measure_in_child",
                MeasureRequest(source, self.plan, exclude, workload_file),
                receive,
                self.plan.limit_s,
                self.plan.import_from,
            )
            culprit = self._culprit(ended)
            if culprit is None:
                return ended
            fatal[culprit] = AgreementReport(culprit, ended.status, ended.detail)
            self._forget_all_but(fatal)

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

    def _forget_all_but(self, fatal: dict[int, AgreementReport]) -> None:
        """Drop what is about to be measured again; keep the reports of fatal variants."""
        self.variants = {i: _VariantState(fatal.get(i)) for i in self.variants}
        self.cores, self.timed_s = [], 0.0

    def _receive(self, message: object) -> None:
        """Store one message of the child that measures the C paths."""
        match message:
            case ModelReady():
                self.ready = message
            case AgreementReport():
                self.variants[message.index].report = message
            case RoundTimed():
                self.cores.append(message.cores)
                for index, seconds in message.seconds.items():
                    self.variants[index].samples_s.append(seconds)
                    self.timed_s += seconds
            case ClockRoundTimed():
                for index, seconds in message.with_clock_s.items():
                    self.variants[index].with_clock_s.append(seconds)
                    self.variants[index].without_clock_s.append(message.without_clock_s[index])
            case BlockDisagreed(index, detail):
                self._revise(index, Status.DISAGREES, detail)
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

    def _revise(self, index: int, status: Status, detail: str) -> None:
        """Change a variant's report after the fact; its snippet and check stay."""
        report = self.variants[index].report or AgreementReport(index, status)
        if status == Status.DISAGREES:
            report = dataclasses.replace(report, agrees=False, agreement=detail)
        self.variants[index].report = dataclasses.replace(report, status=status, detail=detail)

    def _run_accelerated(self, index: int, workload_file: Path) -> None:
        """Measure one accelerated path alone; whatever becomes of it costs its own row."""
        variant, state = self.plan.variants[index], self.variants[index]
        try:
            ended = accelerated_run.run(
                self.source,
                variant,
                workload_file,
                lambda message: self._receive_accelerated(index, message),
                is_named=variant.path in self.plan.named,
                limit_s=self.plan.limit_s,
                import_from=self.plan.import_from,
            )
        except Exception as error:  # a path's own `environment` may raise anything
            failure = failure_of(error)
            ended = isolate.Ended(failure.status, failure.detail)
        state.is_finished = True
        assert self.ready is not None
        digest = self.ready.workload_digest
        if ended.status != Status.OK:
            self._revise(index, ended.status, ended.detail)
        elif state.compile_report and state.compile_report.workload_digest != digest:
            self.variants[index].report = AgreementReport(
                index, Status.FAILED, "it did not receive the workload of the paths before"
            )

    def _share_done(self) -> float:
        """Return the share of this model's work that is done, roughly, from 0 to 1."""
        verified = sum(state.report is not None for state in self.variants.values())
        timed = min(1.0, self.timed_s / max(self.plan.budget_s, 1e-9))
        share = VERIFICATION_SHARE * verified / len(self.variants)
        return share + (1 - VERIFICATION_SHARE) * timed

    def records(self, ended: isolate.Ended | None) -> ModelRecords:
        """Return the records of this model; `ended` is None when the user interrupted it."""
        model = ModelRecord(
            model=self.source.name,
            status=ended.status if ended else Status.INTERRUPTED,
            detail=ended.detail if ended else "",
            **(vars(self.ready) if self.ready else {}),
            nbatch_asked=self.plan.nbatch,
            usable_cores=machine.usable_cores(),
            cores_had=self.cores,
            total_steps=self.plan.total_steps,
        )
        measurements = tuple(self._measurement(index, model, ended) for index in self.variants)
        return ModelRecords(model, measurements, interrupted=ended is None)

    def _measurement(
        self, index: int, model: ModelRecord, ended: isolate.Ended | None
    ) -> MeasurementRecord:
        variant, state = self.plan.variants[index], self.variants[index]
        path = paths.find(variant.path)
        status, detail = self._outcome(state, ended)
        report = state.report or AgreementReport(index, status)
        record = MeasurementRecord(
            model=model.model,
            path=variant.path,
            options=variant.options,
            status=status,
            detail=detail,
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
            with_clock_s=state.with_clock_s,
            without_clock_s=state.without_clock_s,
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

    def _outcome(self, state: _VariantState, ended: isolate.Ended | None) -> tuple[Status, str]:
        """Return status and detail of one variant."""
        report = state.report
        if report is not None and report.status != Status.OK:
            return report.status, report.detail
        if state.samples_s and report is not None:
            if ended is None and not state.is_finished:
                return Status.OK, f"interrupted after {len(state.samples_s)} rounds"
            return Status.OK, report.detail
        if ended is None:
            return Status.INTERRUPTED, "stopped before it was timed"
        if ended.status == Status.OK:
            return Status.FAILED, "it was not timed"
        return ended.status, ended.detail
