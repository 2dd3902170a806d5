"""Does a path reach the reference run's final states, and if not, after which step does it show?"""

from dataclasses import dataclass

from mjbench import paths
from mjbench.comparison.messages import AgreementReport
from mjbench.comparison.plan import Variant
from mjbench.errors import describe, one_line
from mjbench.simulation import agreement, compat, models, work, workload
from mjbench.simulation.agreement import Difference
from mjbench.simulation.work import Observation
from mjbench.simulation.workload import Workload
from mjbench.status import Status

# The model that a path is verified on, too, where a model starts without contact: a path that loses
# the warm-start differs in contact alone.
CONTACT_MODEL, CONTACT_NBATCH, CONTACT_NSTEP = "cube_table", 4, 20


@dataclass(frozen=True)
class ReferenceCase:
    """A workload, its reference run, and the memory that paths share.

    Attributes:
      workload: without diverged simulations.
      observation: of the reference run.
      resources: MjData, arrays and pools.
      columns: where each MjData field stands in a state.
      label: of the model, where it is not the user's; empty for the user's own.
    """

    workload: Workload
    observation: Observation
    resources: paths.Resources
    columns: dict[str, slice]
    label: str = ""

    @classmethod
    def create(
        cls, workload: Workload, observation: Observation, label: str = ""
    ) -> "ReferenceCase":
        """Return the case of a workload and its reference run."""
        columns = compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
        return cls(workload, observation, paths.Resources(workload), columns, label)

    @classmethod
    def in_contact(cls, hold: int, seed: int) -> "ReferenceCase":
        """Return a small case that starts in contact, for models that do not."""
        model = models.load(models.resolve(CONTACT_MODEL))
        nstep = workload.whole_holds(CONTACT_NSTEP, hold)
        contact_workload = workload.make(model, CONTACT_NBATCH, nstep, hold, seed)
        healthy, observation = work.observe_healthy(contact_workload)
        return cls.create(healthy, observation, CONTACT_MODEL)

    def difference(self, states: paths.States) -> Difference | None:
        """Return where `states` first differ from the reference run's final states, or None."""
        return agreement.first_differing_entry(
            states.values, self.observation.final_state, self.columns, states.mask
        )

    def verify(self, variant: Variant) -> tuple[paths.Prepared, Difference | None]:
        """Prepare a variant and run it once; return the run, and where it first differs."""
        path = paths.find(variant.path)
        prepared = path.prepare(self.workload, variant.options, self.resources)
        difference = self.difference(prepared.verified_states())
        return prepared, self._locate_first_step(variant, difference) if difference else None

    def _locate_first_step(self, variant: Variant, at_end: Difference) -> Difference:
        """Return the difference after the first step at which a shorter run shows one.

        Runs of 1, 2, 4, … controls bracket the control where the difference begins; bisection finds
        it. Where no shorter run shows one (a race), the difference at the end is all there is.
        """

        def difference_after(ncontrol: int) -> Difference | None:
            shorter = ReferenceCase.create(*work.observe_healthy(self.workload.first(ncontrol)))
            try:
                path = paths.find(variant.path)
                prepared = path.prepare(shorter.workload, variant.options, shorter.resources)
                return shorter.difference(prepared.verified_states())
            finally:
                shorter.resources.close()

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


def verify(
    index: int, variant: Variant, case: ReferenceCase, contact_case: ReferenceCase | None
) -> tuple[AgreementReport, paths.Prepared | None]:
    """Compare a variant with the reference run.

    Args:
      index: of the variant.
      variant: to prepare and run.
      case: that it is to be timed on.
      contact_case: that it must agree on as well; None where `case` starts in contact.

    Returns:
      The report, and the prepared run if it may be timed.
    """
    try:
        path = paths.find(variant.path)
        reason = path.unavailable() or path.unsuited(case.workload, variant.options)
        if reason:
            return AgreementReport(index, Status.UNAVAILABLE, one_line(reason)), None
        prepared, difference = case.verify(variant)
        place = ""
        if difference is None and contact_case is not None:
            _, difference = contact_case.verify(variant)
            place = f", on {contact_case.label}"
        snippet = str(path.snippet(case.workload, variant.options))
    except BaseException as error:  # a path's own failure costs its own row; it may be SystemExit
        return AgreementReport(index, Status.FAILED, describe(error)), None
    if difference:
        detail = f"{difference}{place}"
        report = AgreementReport(index, Status.DISAGREES, detail, False, detail, snippet)
        return report, None
    rule = "bit-identical"
    if contact_case is not None:
        rule += f", also in contact ({contact_case.label})"
    return AgreementReport(index, Status.OK, "", True, rule, snippet), prepared
