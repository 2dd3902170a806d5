"""The same physics by other paths: verified against the environment, and ready to be timed.

The plain loop is first compared with the environment itself, which reached the states that were
recorded; then every path is compared with the plain loop, as in `mjbench compare`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.comparison.messages import AgreementReport
from mjbench.comparison.plan import Variant
from mjbench.comparison.verification import FurtherCases, ReferenceCase, verify
from mjbench.environment.workload import PhysicsAlone
from mjbench.errors import MachineError
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.simulation import agreement, compat, work
from mjbench.simulation.agreement import Difference
from mjbench.simulation.model_guard import ModelGuard
from mjbench.status import Status

# Paths that are compared with an environment: a policy needs the closed loop, but a planner or the
# evaluation of recorded actions does not.
PATHS = ("python_loop", "python_loop_hold", "rollout", "batch_step", "batch_rollout")
# Their options: `mjbench compare` tries the others.
CHOICES: Mapping[str, Sequence[Any]] = {"pool": ("kept",), "data": ("shared",)}
# Only where a control is held: one call then takes all steps of it.
_ONE_CALL = "python_loop_hold"


@dataclass
class PhysicsComparison:
    """The paths that do the physics of an environment, to be timed.

    Attributes:
      prepared: the paths that agree, by the index of the variant.
      differences: the first one of each path whose timed block was wrong, by the same index.
    """

    physics: PhysicsAlone
    variants: Sequence[Variant]
    case: ReferenceCase
    guard: ModelGuard
    prepared: Mapping[int, paths.Prepared]
    differences: dict[int, Difference] = field(default_factory=dict)

    def block_s(self, index: int) -> float:
        """Time one block of a path, compare its final states, and return its seconds."""
        prepared = self.prepared[index]
        seconds = timing.block_s(timing.Contender(prepared.run, before=prepared.clear))
        self.guard.check(f"{self.variants[index]} ")
        difference = self.case.difference(prepared.final_states(), prepared)
        if difference:
            self.differences.setdefault(index, difference)
        return seconds

    def reorder(self, rng: np.random.Generator) -> None:
        """Reorder the simulations, so that the output of an earlier block is wrong."""
        if self.physics.workload.nbatch > 1:
            self.case.reorder(rng)

    def close(self) -> None:
        """Stop workers and pools."""
        self.case.resources.close()


def difference_from(physics: PhysicsAlone) -> str:
    """Return where a plain loop first differs from the environment at the ends of runs; or empty.

    The loop takes the steps of each run from its start; nothing of the environment is in it.
    """
    observation = work.observe(physics.workload)
    columns = compat.state_columns(physics.workload.model)
    difference = agreement.first_differing_entry(
        physics.final_state, observation.final_state, columns
    )
    if difference is None:
        return ""
    number = physics.numbers[(difference.simulation + 1) * physics.run - 1]
    return described(int(number), difference)


def described(number: int, difference: Difference) -> str:
    """Return a difference between the environment and a plain loop as a sentence.

    Args:
      number: of the environment's step after which it shows.
    """
    return (
        f"{difference.field}[{difference.index}] is {difference.got!r} in the environment and"
        f" {difference.expected!r} in a plain loop, after step {number + 1} of the environment"
    )


def prepare(
    physics: PhysicsAlone, variants: Sequence[Variant], channel: Channel
) -> PhysicsComparison:
    """Verify every path, and send an `AgreementReport` for each.

    Args:
      variants: the paths, the plain loop first.
    """
    workload, observation = work.observe_healthy(physics.workload)
    if workload.nbatch < physics.workload.nbatch:
        raise MachineError(f"the physics diverges ({observation.diagnosis()})")
    workload = dataclasses.replace(
        workload, initial_state=workload.initial_state.copy(), control=workload.control.copy()
    )
    case = ReferenceCase.create(workload, observation)
    further = FurtherCases.create(case, work.step_s(workload.model, workload.initial_state[0]))
    guard = ModelGuard(workload.model)
    prepared_by_index: dict[int, paths.Prepared] = {}
    for index, variant in enumerate(variants):
        channel.doing(f"preparing {variant}", index)
        channel.allow_silence(0.0)
        if variant.path == _ONE_CALL and not physics.holds:
            detail = "the environment sets another control for each step of the engine"
            channel.send(AgreementReport(index, Status.UNAVAILABLE, detail))
            continue
        report, prepared = verify(index, variant, case, further)
        guard.check(f"{variant} ")
        channel.send(report)
        if prepared is not None:
            prepared_by_index[index] = prepared
    further.close()
    return PhysicsComparison(physics, variants, case, guard, prepared_by_index)
