"""Does a path return what the reference run does, and if not, after which step does it show?"""

import contextlib
import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjbench import paths
from mjbench.comparison.messages import AgreementReport
from mjbench.comparison.plan import Variant
from mjbench.errors import InputError, describe, one_line
from mjbench.simulation import (
    agreement,
    compat,
    input_probe,
    models,
    reference_run,
    reference_trajectory,
    workload,
)
from mjbench.simulation.agreement import Difference
from mjbench.simulation.reference_run import Observation
from mjbench.simulation.workload import Product, StepOutputs, Workload
from mjbench.status import Status

# The model that a path is verified on, too, where a model starts without contact: a path that loses
# the warm-start differs in contact alone.
CONTACT_MODEL, CONTACT_NBATCH, CONTACT_NSTEP = "cube_table", 4, 20
# The case in which every input is set: simulations, most steps of each, and about how many seconds
# a run of it takes where a step is slow.
INPUTS_NBATCH, INPUTS_NSTEP, INPUTS_S = 4, 20, 0.02


@dataclass(frozen=True)
class ReferenceCase:
    """A workload, its reference run, and the memory that paths share.

    Attributes:
      workload: without diverged simulations.
      final_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION after the reference run.
      outputs: of the reference run, of every step, as the workload asks for.
      numbers: (nbatch,) of the simulations, as they were before they were reordered.
      label: how it differs from what the user asked for, such as `with every input set`.
    """

    workload: Workload
    final_state: np.ndarray
    outputs: StepOutputs
    resources: paths.Resources
    numbers: np.ndarray
    label: str = ""
    start_contacts: int = 0

    @classmethod
    def create(
        cls, workload: Workload, observation: Observation, label: str = ""
    ) -> "ReferenceCase":
        case = cls.of_states(workload, observation.final_state)
        return dataclasses.replace(case, label=label, start_contacts=observation.start_contacts)

    @classmethod
    def of_states(cls, workload: Workload, final_state: np.ndarray) -> "ReferenceCase":
        """Return the case of a workload and its final states; what each step returns is stepped."""
        outputs, numbers = reference_run.step_outputs(workload), np.arange(workload.nbatch)
        return cls(workload, final_state, outputs, paths.Resources(workload), numbers)

    @classmethod
    def in_contact(cls, hold: int, seed: int) -> "ReferenceCase":
        model = models.load(models.resolve(CONTACT_MODEL))
        nstep = workload.whole_holds(CONTACT_NSTEP, hold)
        contact_workload = workload.make(model, CONTACT_NBATCH, nstep, hold, seed)
        healthy, observation = reference_run.observe_healthy(contact_workload)
        return cls.create(healthy, observation, f"in contact ({CONTACT_MODEL})")

    def difference(self, states: paths.States, prepared: paths.Prepared) -> Difference | None:
        """Return where a run and its outputs first differ from the reference run, or None."""
        difference = self._output_difference(prepared) or agreement.first_differing_entry(
            states.values, self.final_state, self._state_columns, states.mask
        )
        if difference is None:
            return None
        number = int(self.numbers[difference.simulation])
        return dataclasses.replace(difference, simulation=number)

    def _output_difference(self, prepared: paths.Prepared) -> Difference | None:
        if self.outputs.state is None:
            return None
        outputs = StepOutputs(None, None)
        if prepared.step_outputs is not None:
            outputs = prepared.step_outputs()
        sensors = {"sensordata": slice(0, self.workload.model.nsensordata)}
        compared = (
            ("state", outputs.state, self.outputs.state, self._physics_columns),
            ("sensordata", outputs.sensordata, self.outputs.sensordata, sensors),
        )
        differences = []
        for name, values, expected, columns in compared:
            if expected is None:
                continue
            if values is None:
                raise InputError(f"it returns no {name} of every step, although it says so")
            differences.append(agreement.first_differing_step(values, expected, columns))
        return min(filter(None, differences), key=lambda d: d.step or 0, default=None)

    @functools.cached_property
    def _state_columns(self) -> dict[str, slice]:
        return compat.state_columns(self.workload.model)

    @functools.cached_property
    def _physics_columns(self) -> dict[str, slice]:
        return compat.state_columns(self.workload.model, compat.FULLPHYSICS)

    def reorder(self, rng: np.random.Generator) -> None:
        order = workload.draw_order(self.workload.nbatch, rng)
        self.resources.reorder(order)
        self.final_state[...] = self.final_state[order]
        self.outputs.reorder(order)
        self.numbers[...] = self.numbers[order]

    def verify(self, variant: Variant) -> tuple[paths.Prepared, Difference | None]:
        """Prepare a variant and run it; return the run, and where it first differs."""
        path = paths.find(variant.path)
        prepared = path.prepare(self.workload, variant.options, self.resources)
        difference = self._check(prepared)
        if difference is not None and difference.step is None:
            difference = self._locate_first_step(variant, difference)
        return prepared, difference

    def _check(self, prepared: paths.Prepared) -> Difference | None:
        """Run twice, the second time with reordered simulations; return the first difference."""
        difference = self.difference(prepared.verified_states(), prepared)
        if difference is not None or self.workload.nbatch == 1:
            return difference
        self.reorder(np.random.default_rng(self.workload.seed))
        prepared.clear()
        prepared.run()
        difference = self.difference(prepared.final_states(), prepared)
        return dataclasses.replace(difference, is_reordered=True) if difference else None

    def _locate_first_step(self, variant: Variant, at_end: Difference) -> Difference:
        """Return the difference after the first step at which a shorter run shows one.

        Runs of 1, 2, 4, … controls bracket the control where the difference begins; bisection finds
        it. Where no shorter run shows one (a race), the difference at the end is all there is.
        """

        def difference_after(ncontrol: int) -> Difference | None:
            shorter = ReferenceCase.create(
                *reference_run.observe_healthy(self.workload.first(ncontrol))
            )
            with contextlib.closing(shorter.resources):
                path = paths.find(variant.path)
                return shorter._check(
                    path.prepare(shorter.workload, variant.options, shorter.resources)
                )

        good, bad, earliest = 0, 1, difference_after(1)
        while earliest is None:
            if bad == self.workload.ncontrol:
                return at_end
            good, bad = bad, min(2 * bad, self.workload.ncontrol)
            earliest = difference_after(bad)
        while bad - good > 1:
            middle = (good + bad) // 2
            difference = difference_after(middle)
            if difference is None:
                good = middle
            else:
                bad, earliest = middle, difference
        return earliest.at(bad * self.workload.hold)


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


def verify(
    position: int, variant: Variant, case: ReferenceCase, further: FurtherCases
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
