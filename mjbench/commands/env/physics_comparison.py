"""The same physics as an environment's, alone and by other paths: verified, and ready to be timed.

Each simulation is a run of consecutive steps of the environment, begun from the state that the
environment had, with the controls that it set. Where it writes more than controls between two of
its steps (a mocap pose, an applied force), a run ends there, because the next start state holds
what was written.

The plain loop is first compared with the environment itself, which reached the states that were
recorded; then every path is compared with the plain loop, as in `mjbench compare`.
"""

import collections
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mjbench import paths
from mjbench.commands.env.recording import Recording, StepTrace
from mjbench.errors import InputError
from mjbench.formats import listed
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.simulation import agreement, compat, reference_run
from mjbench.simulation.agreement import Difference
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.workload import Workload
from mjbench.status import Status
from mjbench.verification.path_verification import AgreementReport, FurtherCases, verify
from mjbench.verification.plan import Variant
from mjbench.verification.reference_case import ReferenceCase

# Paths that are compared with an environment: a policy needs the closed loop, but a planner or the
# evaluation of recorded actions does not.
PATHS = ("python_loop", "python_loop_hold", "rollout", "batch_step", "batch_rollout")
# Their options: `mjbench compare` tries the others.
CHOICES: Mapping[str, Sequence[Any]] = {"pool": ("kept",), "data": ("shared",)}
# Only where a control is held: one call then takes all steps of it.
_ONE_CALL = "python_loop_hold"
# Steps of the environment in a simulation, at most; and the share of its steps that shorter
# simulations may not exceed in number, before runs are shortened to keep more of them.
MAX_RUN, MIN_SHARE = 20, 0.9
# Simulations that each thread should have.
_PER_THREAD = 4


@dataclass(frozen=True, eq=False)
class PhysicsAlone:
    """The physics of some steps of an environment.

    Attributes:
      workload: its `nbatch` simulations take `run` steps of the environment each.
      final_state: (nbatch, nstate) states that the environment was in at their ends.
      numbers: (nbatch * run,) of the environment's steps that it covers.
      holds: whether a control is held for all steps of the engine in a step of the environment.
    """

    workload: Workload
    final_state: np.ndarray
    numbers: np.ndarray
    run: int
    holds: bool


def physics_of(recording: Recording, seed: int, nthread: int) -> PhysicsAlone | str:
    """Return the physics of a recording; or why a plain loop cannot do it, in one line."""
    if recording.obstacle:
        return f"the environment {recording.obstacle}"
    if recording.difference is not None:
        return "a plain mj_step from the same state does not reach the same state"
    stepped = [trace for trace in recording.steps if trace is not None]
    if not stepped:
        return "the environment never steps the engine"
    written = sorted({name for trace in stepped for name in trace.written})
    if written:
        return f"the environment writes {listed(written)} between steps of the engine"
    counts = collections.Counter(trace.nstep for trace in stepped)
    frame_skip, usual = counts.most_common(1)[0]
    if usual < MIN_SHARE * len(recording.steps):
        least, most = min(counts), max(counts)
        if least == most:
            return f"only {usual} of {len(recording.steps)} of its steps step the engine"
        return f"the environment takes {least} to {most} steps of the engine"
    usable = {
        number: trace
        for number, trace in enumerate(recording.steps)
        if trace is not None
        and trace.nstep == frame_skip
        and trace.version == recording.version
        and trace.is_same_model
    }
    if len(usable) < max(2, _PER_THREAD * nthread // 2):
        fields = ", ".join(dict.fromkeys(change.field for change in recording.changes))
        return f"the environment changes its model ({fields}), so few steps have the same one"
    return _assembled(recording, usable, frame_skip, seed, nthread)


def _assembled(
    recording: Recording, usable: dict[int, StepTrace], frame_skip: int, seed: int, nthread: int
) -> PhysicsAlone:
    runs = _runs(usable)
    length = _run_length([len(run) for run in runs], nthread)
    pieces = [
        run[first : first + length]
        for run in runs
        for first in range(0, len(run) - length + 1, length)
    ]
    holds = all((trace.control == trace.control[0]).all() for trace in usable.values())
    control_rows = slice(0, 1) if holds else slice(None)
    control = np.array(
        [np.concatenate([usable[n].control[control_rows] for n in piece]) for piece in pieces]
    )
    assert recording.model is not None, "it was stepped"
    workload = Workload(
        recording.model,
        np.array([usable[piece[0]].start for piece in pieces]),
        control,
        frame_skip if holds else 1,
        seed,
    )
    return PhysicsAlone(
        workload,
        np.array([usable[piece[-1]].end for piece in pieces]),
        np.array([n for piece in pieces for n in piece]),
        length,
        holds,
    )


def _runs(usable: dict[int, StepTrace]) -> list[list[int]]:
    """Return runs of steps each of which begins in the state that the one before ended in."""
    runs: list[list[int]] = []
    for number, trace in usable.items():
        if runs and trace.follows and not trace.entered and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs


def _run_length(lengths: Sequence[int], nthread: int) -> int:
    """Return the longest run that covers most steps and gives every thread enough simulations."""
    total = sum(lengths)
    longest = 1
    for length in range(1, MAX_RUN + 1):
        count = sum(n // length for n in lengths)
        if count * length >= MIN_SHARE * total and count >= _PER_THREAD * nthread:
            longest = length
    return longest


@dataclass
class PhysicsComparison:
    """The paths that agree, by the position of the variant, and those whose timed block did not."""

    physics: PhysicsAlone
    variants: Sequence[Variant]
    case: ReferenceCase
    guard: ModelGuard
    prepared: Mapping[int, paths.Prepared]
    differences: dict[int, Difference] = field(default_factory=dict)

    def block_s(self, position: int) -> float:
        """Time one block of a path, compare its final states, and return its seconds."""
        prepared = self.prepared[position]
        seconds = timing.block_s(timing.Contender(prepared.run, before=prepared.clear))
        self.guard.check(f"{self.variants[position]} ")
        difference = self.case.difference(prepared.final_states(), prepared)
        if difference:
            self.differences.setdefault(position, difference)
        return seconds

    def reorder(self, rng: np.random.Generator) -> None:
        if self.physics.workload.nbatch > 1:
            self.case.reorder(rng)

    def close(self) -> None:
        self.case.resources.close()


def difference_from(physics: PhysicsAlone) -> str:
    """Return where a plain loop of the runs first differs from the environment's ends, or empty."""
    observation = reference_run.observe(physics.workload)
    columns = compat.state_columns(physics.workload.model)
    difference = agreement.first_differing_entry(
        physics.final_state, observation.final_state, columns
    )
    if difference is None:
        return ""
    number = physics.numbers[(difference.simulation + 1) * physics.run - 1]
    return described(int(number), difference)


def described(number: int, difference: Difference) -> str:
    return (
        f"{difference.field}[{difference.index}] is {difference.got!r} in the environment and"
        f" {difference.expected!r} in a plain loop, after step {number + 1} of the environment"
    )


def prepare(
    physics: PhysicsAlone,
    variants: Sequence[Variant],
    add: Callable[[Variant, AgreementReport], None],
    channel: Channel,
) -> PhysicsComparison:
    """Verify every path, the plain loop first, and add a report of each."""
    workload, observation = reference_run.observe_healthy(physics.workload)
    if workload.nbatch < physics.workload.nbatch:
        raise InputError(f"the physics diverges ({observation.diagnosis()})")
    workload = dataclasses.replace(
        workload, initial_state=workload.initial_state.copy(), control=workload.control.copy()
    )
    case = ReferenceCase.create(workload, observation)
    further = FurtherCases.create(
        case, reference_run.step_s(workload.model, workload.initial_state[0])
    )
    guard = ModelGuard(workload.model)
    prepared_by_position: dict[int, paths.Prepared] = {}
    for position, variant in enumerate(variants):
        channel.doing(f"preparing {variant}", position)
        channel.allow_silence(0.0)
        if variant.path == _ONE_CALL and not physics.holds:
            detail = "the environment sets another control for each step of the engine"
            add(variant, AgreementReport(position, Status.UNAVAILABLE, detail))
            continue
        report, prepared = verify(position, variant, case, further)
        guard.check(f"{variant} ")
        add(variant, report)
        if prepared is not None:
            prepared_by_position[position] = prepared
    further.close()
    return PhysicsComparison(physics, variants, case, guard, prepared_by_position)
