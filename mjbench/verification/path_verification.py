"""The child that verifies the paths of one model: does each return what the reference run does?

It loads the model, chooses sizes, does the reference run, then prepares and verifies each variant.
The workload goes to files, so that what is timed in other processes is what was verified.
"""

import dataclasses
import functools
import pickle
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjbench import paths
from mjbench.errors import describe, one_line
from mjbench.host.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import (
    input_probe,
    models,
    reference_run,
    reference_trajectory,
    starts,
    workload,
    workload_sampling,
)
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Product, Workload
from mjbench.simulation.workload_sampling import Sample, SampleRequest
from mjbench.status import Status
from mjbench.verification import step_costs
from mjbench.verification.plan import (
    BlockSizes,
    ComparisonPlan,
    Variant,
    check_memory,
    choose_sizes,
)
from mjbench.verification.records import ModelRecord
from mjbench.verification.reference_case import ReferenceCase

# A child may be silent for this many times as long as its work should take.
PATIENCE = 100
# The case in which every input is set: simulations, most steps of each, and about how many seconds
# a run of it takes where a step is slow.
INPUTS_NBATCH, INPUTS_NSTEP, INPUTS_S = 4, 20, 0.02


@dataclass(frozen=True)
class ModelFiles:
    """Where a model and its workload are saved, so that other processes do the same work.

    Attributes:
      workload: a pickled `PortableWorkload`, with its final states, for the launches of a race.
    """

    model: Path
    workload: Path
    accelerated: Path

    @classmethod
    def in_folder(cls, folder: Path) -> "ModelFiles":
        names = ("model.mjb", "workload.pickle", "accelerated.pickle")
        return cls(*(folder / name for name in names))


@dataclass(frozen=True)
class AgreementReport:
    """Whether a variant does what the reference run does, so that it may be timed.

    Attributes:
      agrees: None where it was not compared.
      agreement: the rule that was held, or the first difference.
    """

    position: int
    status: Status
    detail: str = ""
    agrees: bool | None = None
    agreement: str = ""
    snippet: str = ""


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
        start_contacts=observation.start_contacts,
        work=observation.work,
    )


def verify(
    position: int, variant: Variant, case: ReferenceCase, further: "FurtherCases"
) -> tuple[AgreementReport, paths.Prepared | None]:
    """Compare a variant with the reference run; return also the prepared run if it may be timed."""
    try:
        path = paths.find(variant.path)
        reason = _reason_not_to_run(path, variant, case.workload)
        if reason:
            return AgreementReport(position, Status.UNAVAILABLE, one_line(reason)), None
        prepared, difference = case.verify(variant)
        rules, place = ["bit-identical"], ""
        others = further.of(path, variant.options)
        for other in others:
            if difference is None:
                _, difference = other.verify(variant)
                place = f", {other.label}"
                rules.append(f"also {other.label}")
        products = {compared.workload.returns for compared in (case, *others)}
        if case.workload.model.nsensordata and Product.SENSORS not in products:
            rules.append("sensor data not compared")
        snippet = str(path.snippet(case.workload, variant.options))
    except BaseException as error:  # a path's own failure costs its own row; it may be SystemExit
        return AgreementReport(position, Status.FAILED, describe(error)), None
    if difference:
        detail = f"{difference}{place}"
        report = AgreementReport(position, Status.DISAGREES, detail, False, detail, snippet)
        return report, None
    return AgreementReport(position, Status.OK, "", True, ", ".join(rules), snippet), prepared


def _reason_not_to_run(path: paths.SteppingPath, variant: Variant, own: Workload) -> str | None:
    cannot_return = path.cannot_return(own.returns)
    if cannot_return:
        cannot_return += f": --returns {path.products[-1]} compares it"
    return path.unavailable() or cannot_return or path.unsuited(own, variant.options)


@dataclass(frozen=True)
class FurtherCases:
    """Small cases in which a path must agree as well, though it is not timed on them.

    Attributes:
      contact: of a model that starts in contact; None where the user's does.
      inputs: of the user's model with every input set, by what they return; empty if all diverge.
    """

    contact: ReferenceCase | None
    inputs: Mapping[Product, ReferenceCase]

    @classmethod
    def create(cls, case: ReferenceCase, step_s: float) -> "FurtherCases":
        """Return the further cases of the user's own, of which a step takes `step_s`."""
        needs_contact = case.start_contacts == 0
        hold, seed = case.workload.hold, case.workload.seed
        contact = ReferenceCase.in_contact(hold, seed) if needs_contact else None
        return cls(contact, _input_cases(case.workload, step_s))

    def of(self, path: paths.SteppingPath, options: paths.Options) -> list[ReferenceCase]:
        """Return the cases of a path: inputs where it returns as much as it can."""
        chosen = []
        for product in reversed(Product):
            inputs_case = self.inputs.get(product)
            if inputs_case is None or product not in path.products:
                continue
            if path.unsuited(inputs_case.workload, options) is None:
                chosen.append(inputs_case)
                break
        contact = self.contact
        if contact is not None and path.unsuited(contact.workload, options) is None:
            chosen.append(contact)
        return chosen

    def close(self) -> None:
        for case in (*self.inputs.values(), *([self.contact] if self.contact else [])):
            case.resources.close()


def _input_cases(own: Workload, step_s: float) -> dict[Product, ReferenceCase]:
    """Return small cases with every input set, one a product, of simulations without warnings."""
    # where the user's are fewer, some are taken twice: their inputs differ
    rows = np.resize(reference_trajectory.spread_indices(own.nbatch, INPUTS_NBATCH), INPUTS_NBATCH)
    affordable = int(INPUTS_S / (step_s * len(rows)))
    ncontrol = workload.whole_holds(min(INPUTS_NSTEP, affordable), own.hold) // own.hold
    few = dataclasses.replace(
        own, initial_state=own.initial_state[rows], control=own.control[rows, :ncontrol].copy()
    )
    small = input_probe.with_every_input(few, own.seed)
    observed = reference_run.observe(small)
    calm = observed.healthy & ~observed.warnings.any(axis=1)
    if not calm.any():
        return {}
    return {
        product: ReferenceCase.create(
            small.only(calm).returning(product),
            dataclasses.replace(observed, final_state=observed.final_state[calm]),
            "with every input set",
        )
        for product in Product
    }
