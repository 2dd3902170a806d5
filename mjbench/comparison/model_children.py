"""The children of one model's comparison: one verifies its paths, and each that compiles has one.

The parent never loads a model. It starts `verify_in_child` in a child, gathers the child's
messages, and has the model's records when the child ends, however it ends. A path that kills the
child loses its own row; the child is started again without it. Accelerated paths, which compile
first, are measured alone (see `accelerated_measurement`).

The child loads the model, chooses sizes, does the reference run, then prepares and verifies each
variant. The workload goes to files, so that what is timed in other processes is what was verified.
"""

import dataclasses
import functools
import pickle
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from mjbench import paths
from mjbench.comparison import accelerated_measurement, step_costs
from mjbench.comparison.accelerated_measurement import AcceleratedRequest
from mjbench.comparison.messages import AgreementReport, ModelFiles
from mjbench.comparison.plan import BlockSizes, ComparisonPlan, check_memory, choose_sizes
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.comparison.verification import FurtherCases, ReferenceCase, verify
from mjbench.errors import Failure, failure_of
from mjbench.host import isolate, machine
from mjbench.host.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import agreement, models, reference_run, starts, workload, workload_sampling
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload
from mjbench.simulation.workload_sampling import Sample, SampleRequest
from mjbench.status import Status

# A child may be silent for this many times as long as its work should take.
PATIENCE = 100


@dataclass
class ModelChildren:
    """The children of one model's comparison, and what they have said so far.

    Attributes:
      ended: how the last child ended that every path needs; None before, and after Ctrl-C.
      measured: of variants, by their positions in the plan.
    """

    source: ModelSource
    plan: ComparisonPlan
    files: ModelFiles
    reference: ModelRecord | None = None
    ended: isolate.Ended | None = None
    measured: dict[int, MeasurementRecord] = field(default_factory=dict)

    @property
    def agreeing(self) -> list[int]:
        return [
            position
            for position, record in sorted(self.measured.items())
            if record.status == Status.OK and not record.is_accelerated
        ]

    @property
    def share_verified(self) -> float:
        return len(self.measured) / len(self.plan.variants)

    def verify(self, on_message: Callable[[], None] = lambda: None) -> isolate.Ended:
        """Verify all paths that run C; start again without a path that ended the child."""

        def receive(message: ModelRecord | AgreementReport) -> None:
            if isinstance(message, ModelRecord):
                self.reference = message
            else:
                self.measured[message.position] = dataclasses.replace(
                    self._blank(message.position, message.status, message.detail),
                    agrees=message.agrees,
                    agreement=message.agreement,
                    snippet=message.snippet,
                )
            on_message()

        # the child works in a folder of its own
        source = ModelSource(self.source.name, self.source.path.resolve())
        fatal: dict[int, MeasurementRecord] = {}
        while True:
            excluded = frozenset([*fatal, *self.plan.accelerated])
            ended = isolate.run(
                verify_in_child,
                (source, self.plan, excluded, self.files),
                receive,
                self.plan.limit_s,
                self.plan.import_from,
            )
            culprit = self._culprit(ended)
            if culprit is None:
                self.ended = ended
                return ended
            fatal[culprit] = self._blank(culprit, ended.status, ended.detail)
            self.measured = dict(fatal)

    def _culprit(self, ended: isolate.Ended) -> int | None:
        """Return the variant that ended the child, if one did and the others can go on."""
        position = ended.position
        if position is None or self.plan.variants[position].path == paths.BASE:
            return None
        record = self.measured.get(position)
        # a variant that was already refused is not timed, so another one ended the child
        return position if record is None or record.status == Status.OK else None

    def _blank(self, position: int, status: Status, detail: str) -> MeasurementRecord:
        return MeasurementRecord.of(self.source.name, self.plan.variants[position], status, detail)

    def revise(self, position: int, status: Status, detail: str) -> None:
        """Change what became of a variant after the fact; its snippet and check stay."""
        record = self.measured.get(position) or self._blank(position, status, detail)
        if status == Status.DISAGREES:
            record = dataclasses.replace(record, agrees=False, agreement=detail)
        self.measured[position] = dataclasses.replace(record, status=status, detail=detail)

    def run_accelerated(self, position: int) -> None:
        """Measure one accelerated path alone; whatever becomes of it costs its own row."""
        variant = self.plan.variants[position]

        def receive(record: MeasurementRecord) -> None:
            self.measured[position] = record

        request = AcceleratedRequest(
            self.source,
            variant,
            self.files.accelerated,
            is_named=variant.path in self.plan.named,
            limit_s=self.plan.limit_s,
        )
        try:
            ended = accelerated_measurement.run(request, receive, self.plan.import_from)
        except Exception as error:  # a path's own `environment` may raise anything
            failure = failure_of(error)
            ended = isolate.Ended(failure.status, failure.detail)
        if ended.status != Status.OK:
            compiled = self.measured.get(position)
            is_silent = ended.status == Status.TIMEOUT
            if is_silent and (compiled is None or compiled.compile_s is None):
                ended = dataclasses.replace(
                    ended, detail=accelerated_measurement.not_compiled(self.plan.limit_s)
                )
            self.revise(position, ended.status, ended.detail)
            return
        assert self.reference is not None
        digest = self.measured[position].workload_digest
        if digest not in (None, self.reference.workload_digest):
            detail = "it did not receive the workload of the paths before"
            self.measured[position] = self._blank(position, Status.FAILED, detail)

    def model_record(self) -> ModelRecord:
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
        """Return the records of all variants, in the plan's order; a race has timed some."""
        model, untimed = self.model_record(), self._untimed(is_over)
        records = []
        for position in range(len(self.plan.variants)):
            record = self.measured.get(position)
            if record is None:
                record = self._blank(position, untimed.status, untimed.detail)
            elif record.status == Status.OK and position not in timed and not record.samples_s:
                record = dataclasses.replace(record, status=untimed.status, detail=untimed.detail)
            records.append(record.with_model(model))
        return tuple(records)

    def _untimed(self, is_over: bool) -> Failure:
        """Return what became of variants that nothing has timed or refused."""
        if self.ended is None or not is_over:
            return Failure(Status.INTERRUPTED, "stopped before it was timed")
        if self.ended.status == Status.OK:
            return Failure(Status.FAILED, "it was not timed")
        return Failure(self.ended.status, self.ended.detail)


def verify_in_child(
    source: ModelSource,
    plan: ComparisonPlan,
    excluded: Collection[int],
    files: ModelFiles,
    channel: Channel,
) -> None:
    """Verify the variants of a plan, and write the files of the model.

    Messages: a `ModelRecord` of the reference run, and an `AgreementReport` per variant.

    Args:
      excluded: variants not to touch: those that killed a child before, and accelerated ones.
    """
    name = source.name
    channel.doing(f"loading {name}")
    model = models.load(source)
    channel.doing(f"stepping {name}")
    cost_s = step_costs.step_cost_s(
        model_digest(model), functools.partial(workload_sampling.settled_step_s, model)
    )
    sizes = choose_sizes(
        cost_s,
        nbatch=plan.nbatch,
        nstep=plan.nstep,
        hold=plan.hold,
        nthread=plan.most_threads,
        has_accelerated=bool(plan.accelerated),
    )
    check_memory(model, sizes.nbatch, sizes.nstep, plan.most_threads, plan.returns)
    max_nstep = starts.max_settling_nstep(cost_s)
    settling_nstep = min(starts.settling_nstep(model, plan.starts), max_nstep)
    patience_per_step_s = PATIENCE * reference_run.step_s(model)
    patience_s = patience_per_step_s * sizes.nbatch * sizes.nstep
    channel.allow_silence(patience_s + patience_per_step_s * settling_nstep)
    request = SampleRequest(
        sizes.nbatch,
        sizes.nstep,
        plan.hold,
        plan.seed,
        plan.starts,
        max_nstep,
        may_shorten=plan.nstep is None,
    )
    sample = workload_sampling.draw(model, request)
    own = sample.workload.returning(plan.returns)
    _save(own, sample, files, bool(plan.accelerated))
    case = ReferenceCase.create(own, sample.observation)
    channel.send(_model_record(name, own, sizes, sample))
    further = FurtherCases.create(case, cost_s)
    guard = ModelGuard(model)
    for position, variant in enumerate(plan.variants):
        if position in excluded:
            continue
        channel.doing(f"preparing {variant} on {name}", position)
        channel.allow_silence(patience_s)
        report, _ = verify(position, variant, case, further)
        guard.check()
        channel.send(report)
    further.close()
    case.resources.close()


def _save(own: Workload, sample: Sample, files: ModelFiles, has_accelerated: bool) -> None:
    models.save(own.model, files.model)
    final_state = sample.observation.final_state
    portable = dataclasses.replace(workload.portable(own), final_state=final_state.copy())
    files.workload.write_bytes(pickle.dumps(portable))
    if has_accelerated:
        save_workload(own, sample.observation.peaks, files.accelerated)


def _model_record(name: str, own: Workload, sizes: BlockSizes, sample: Sample) -> ModelRecord:
    observation = sample.observation
    return ModelRecord(
        model=name,
        status=Status.OK,
        facts=reference_run.describe(own.model),
        nbatch=own.nbatch,
        nstep=own.nstep,
        hold=own.hold,
        returns=own.returns,
        seed=own.seed,
        reduced=sizes.reduced,
        diverged=sizes.nbatch - own.nbatch,
        divergence=observation.diagnosis(),
        warnings=observation.other_warnings(),
        spread=sample.spread,
        starts=sample.starts,
        workload_digest=own.digest(),
        state_digest=agreement.digest(observation.final_state),
        start_contacts=observation.start_contacts,
        work=observation.work,
    )
