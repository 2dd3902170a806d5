"""Verify every path on one model; runs in a child process (see `isolate`).

The order is: load, choose sizes, reference run, then prepare and verify each variant. The workload
goes to files, so that what is timed in other processes is what was verified here.
"""

import dataclasses
import functools
import pickle
from collections.abc import Collection

from mjbench.comparison import step_costs
from mjbench.comparison.messages import ModelFiles
from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.records import ModelRecord
from mjbench.comparison.sizes import BlockSizes, check_memory, choose_sizes
from mjbench.comparison.verification import FurtherCases, ReferenceCase, verify
from mjbench.host.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import agreement, models, sampling, starts, work, workload
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.simulation.sampling import Sample, SampleRequest
from mjbench.simulation.workload import Workload
from mjbench.status import Status

# A child may be silent for this many times as long as its work should take.
PATIENCE = 100


def measure_in_child(
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
        model_digest(model), functools.partial(sampling.settled_step_s, model)
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
    patience_per_step_s = PATIENCE * work.step_s(model)
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
    sample = sampling.draw(model, request)
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
        facts=work.describe(own.model),
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
