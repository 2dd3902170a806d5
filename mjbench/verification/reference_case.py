"""A workload with its reference run: does a path return the same, and if not, from which step?"""

import contextlib
import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from mjbench import paths
from mjbench.errors import InputError
from mjbench.simulation import agreement, compat, models, reference_run, workload
from mjbench.simulation.agreement import Difference
from mjbench.simulation.reference_run import Observation
from mjbench.simulation.workload import StepOutputs, Workload
from mjbench.verification.plan import Variant

# The model that a path is verified on, too, where a model starts without contact: a path that loses
# the warm-start differs in contact alone.
CONTACT_MODEL, CONTACT_NBATCH, CONTACT_NSTEP = "cube_table", 4, 20


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
