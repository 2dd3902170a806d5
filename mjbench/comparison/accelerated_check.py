"""How far a compiled run is from C: single steps, the run to its end, and the timed blocks.

`check_run` drives the compiled program beside the reference run and returns a `CheckedRun`;
`mjbench.simulation.accelerated_limits` says how far it may be.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjbench.paths.accelerated import Advance, Compiled, StepOutcome, start_fields
from mjbench.simulation import accelerated_limits, agreement, compat, trajectory
from mjbench.simulation import workload as workloads
from mjbench.simulation.accelerated_limits import AcceleratedCheck, Precision
from mjbench.simulation.trajectory import (
    COMPARED,
    MAX_SINGLE_STEPS,
    Contacts,
    SingleSteps,
    Trajectory,
)
from mjbench.simulation.workload import Workload

# Simulations followed step by step, spread over the batch. Single steps from their states are taken
# again in every simulation that remains.
FOLLOWED = 32

# Contacts that change velocities by a smaller share than this are lost in float32.
_LEAST_IMPULSE = 1e-4

Fields = Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class CheckedRun:
    """A compiled run beside the reference run.

    Attributes:
      check: how far it is from C.
      final_fields: (nbatch, size) arrays by MjData field, after the last step of the compiled run.
    """

    check: AcceleratedCheck
    final_fields: Fields


def check_run(workload: Workload, advance: Advance, precision: Precision) -> CheckedRun:
    """Return how far a compiled run is from the reference run.

    Args:
      advance: the compiled program, (start fields, control, nstep) → StepOutcome.
    """
    rounded = precision == Precision.FLOAT32
    reference = trajectory.record_trajectory(workload, FOLLOWED)
    shadow = trajectory.record_trajectory(workload, FOLLOWED, trajectory.as_float32)
    starts = start_fields(workload)
    fields = advance(starts, workload.control, 0).fields
    singles = trajectory.single_steps(workload, reference, MAX_SINGLE_STEPS, rounded, [*fields])
    outcome = _take_single_steps(advance, workload, singles)
    final_fields = advance(starts, workload.control, workload.nstep).fields
    unconstrained_fields = final_fields
    if reference.unconstrained_nstep < workload.nstep:
        unconstrained_fields = advance(
            starts, workload.control, reference.unconstrained_nstep
        ).fields
    unconstrained, unconstrained_shadow = _run_errors(
        workload, reference, shadow, reference.unconstrained_nstep, unconstrained_fields
    )
    final, final_shadow = _run_errors(workload, reference, shadow, workload.nstep, final_fields)
    compared = [final_fields[name] for name in COMPARED if name in final_fields]
    is_finite = np.isfinite(np.hstack(compared)).all(axis=1)
    steps = _judge_single_steps(workload, singles, outcome)
    reached = trajectory.violation(
        workload.model, _followed_states(reference, final_fields, workload)
    )
    in_c = trajectory.violation(workload.model, reference.states[:, -1])
    check = AcceleratedCheck(
        precision=precision,
        received=_received(workload, advance, starts, final_fields, rounded),
        still=steps.still,
        same_count=steps.same_count,
        normal_degrees=steps.normal_degrees,
        contact_impulse=steps.contact_impulse,
        penetration=reached.penetration,
        penetration_in_c=in_c.penetration,
        violation=reached.constraint,
        violation_in_c=in_c.constraint,
        mean_size=float(workload.model.stat.meansize),
        unconstrained_steps=steps.unconstrained.count,
        constrained_steps=steps.constrained.count,
        contact_steps=steps.contact.count,
        unconstrained_error=steps.unconstrained.max_error,
        constrained_error=steps.constrained.max_error,
        contact_error=steps.contact.max_error,
        unconstrained_nstep=reference.unconstrained_nstep,
        unconstrained_difference=float(unconstrained.max()),
        unconstrained_shadow=float(unconstrained_shadow.max()),
        final_nstep=workload.nstep,
        final_difference=float(final.max()),
        final_shadow=float(final_shadow.max()),
        final_shadow_median=float(np.median(final_shadow)),
        lost=int((~is_finite).sum()),
    )
    return CheckedRun(check, final_fields)


def _followed_states(reference: Trajectory, final_fields: Fields, workload: Workload) -> np.ndarray:
    """Return (n, nstate) final states of the simulations that are followed, finite ones only.

    Fields that the engine lacks are C's.
    """
    states: np.ndarray = reference.states[:, -1].copy()
    columns = compat.state_columns(workload.model)
    for name, place in columns.items():
        if name in final_fields:
            states[:, place] = final_fields[name][reference.simulation]
    return np.asarray(states[np.isfinite(states).all(axis=1)])


def _run_errors(
    workload: Workload, reference: Trajectory, shadow: Trajectory, nstep: int, fields: Fields
) -> tuple[np.ndarray, np.ndarray]:
    """Return (nsim,) how far simulations are from the reference run after `nstep` steps.

    Returns:
      The errors of `fields`, and those of the shadow.
    """
    expected = workloads.fields(workload.model, reference.states[:, nstep])
    rounded = workloads.fields(workload.model, shadow.states[:, nstep])
    reached = {name: values[reference.simulation] for name, values in fields.items()}
    return (
        agreement.max_relative_error(reached, expected, COMPARED),
        agreement.max_relative_error(rounded, expected, COMPARED),
    )


def timed_end_problem(workload: Workload, compiled: Compiled, checked: CheckedRun) -> str:
    """Return how the last timed block ended elsewhere than the checked run; empty if it did not.

    What does not repeat to the last bit may differ as rounding to float32 does in C: by the
    farthest simulation where all motion is unconstrained. In contact some simulations diverge from
    each other after any difference, and which ones is chance: there the median counts.
    """
    return _end_problem(
        workload, compiled, checked, checked.final_fields, is_exact=compiled.is_deterministic
    )


def reordered_end_problem(workload: Workload, compiled: Compiled, checked: CheckedRun) -> str:
    """Return how one more block of reordered simulations ends elsewhere; empty if it does not.

    A path that replays the result of an earlier block does. The order may change how numbers are
    rounded, on a CPU, too.
    """
    order = workloads.draw_order(workload.nbatch, np.random.default_rng(workload.seed))
    workload.reorder(order)
    compiled.reload()
    compiled.clear()
    compiled.run()
    expected = {name: values[order] for name, values in checked.final_fields.items()}
    problem = _end_problem(workload, compiled, checked, expected, is_exact=False)
    return f"once the simulations are reordered, {problem}" if problem else ""


def _end_problem(
    workload: Workload, compiled: Compiled, checked: CheckedRun, expected: Fields, is_exact: bool
) -> str:
    """Return how the last block ended elsewhere than expected; empty if it did not."""
    reached = workloads.fields(workload.model, compiled.final_states().values)
    errors = agreement.max_relative_error(reached, expected, COMPARED)
    lost = int((errors > accelerated_limits.FINITE_LIMIT).sum())
    if lost:
        return f"in timed blocks {lost} simulations do not end in finite numbers"
    error, allowed = float(errors.max()), 0.0
    if not is_exact:
        shadow = checked.check.final_shadow
        if checked.check.unconstrained_nstep < workload.nstep:
            error, shadow = float(np.median(errors)), checked.check.final_shadow_median
        rounding = float(np.finfo(np.float32).eps)
        allowed = accelerated_limits.SHADOW_FACTOR * max(shadow, rounding)
    if error <= allowed:
        return ""
    return f"timed blocks end {error:.2g} from the run that was checked"


def _received(
    workload: Workload, advance: Advance, starts: Fields, final_fields: Fields, rounded: bool
) -> bool:
    """Return whether the engine has exactly the start states, the first and the last control."""

    def as_held(values: np.ndarray) -> np.ndarray:
        return trajectory.as_float32(values) if rounded else values

    at_start = advance(starts, workload.control, 0).fields
    first_ctrl = advance(starts, workload.control, 1).fields["ctrl"]
    return (
        all(
            np.array_equal(at_start[name], as_held(values))
            for name, values in starts.items()
            if name in at_start
        )
        and np.array_equal(first_ctrl, as_held(workload.control[:, 0]))
        and np.array_equal(final_fields["ctrl"], as_held(workload.control[:, -1]))
    )


def _take_single_steps(advance: Advance, workload: Workload, singles: SingleSteps) -> StepOutcome:
    """Take the single steps by the compiled program, as many at a time as it has simulations.

    Where simulations are left over, it begins again with the first step: every simulation takes one
    that is judged.
    """
    nbatch, count = workload.nbatch, len(singles.state)
    states = workloads.fields(workload.model, singles.state)
    states.pop("ctrl", None)
    outcomes: list[StepOutcome] = []
    for begin in range(0, count, nbatch):
        rows = np.arange(begin, begin + nbatch) % count
        control = np.zeros_like(workload.control)
        control[:, 0] = singles.control[rows]
        outcomes.append(advance({name: v[rows] for name, v in states.items()}, control, 1))
    fields = {
        name: np.concatenate([outcome.fields[name] for outcome in outcomes])
        for name in outcomes[0].fields
    }
    contacts = [outcome.contacts for outcome in outcomes if outcome.contacts is not None]
    if len(contacts) < len(outcomes):
        return StepOutcome(fields, None)
    return StepOutcome(fields, Contacts.joined(contacts, nbatch))


@dataclass(frozen=True)
class _KindOfStep:
    """Single steps of one kind: how many, and the largest error; None without any."""

    count: int
    max_error: float | None


@dataclass(frozen=True)
class _SingleStepErrors:
    """How far single steps are from C's; see `AcceleratedCheck` for the fields."""

    unconstrained: _KindOfStep
    constrained: _KindOfStep
    contact: _KindOfStep
    still: bool
    same_count: float | None = None
    normal_degrees: float | None = None
    contact_impulse: float | None = None


def _judge_single_steps(
    workload: Workload, singles: SingleSteps, outcome: StepOutcome
) -> _SingleStepErrors:
    """Compare single steps with C's: unconstrained ones, constrained ones, those in contact."""
    count, total = len(singles.state), len(next(iter(outcome.fields.values())))
    step = np.arange(total) % count  # which of the single steps a row took
    expected = _rows(workload, singles.after, step)
    before = _rows(workload, singles.state, step)
    errors = agreement.max_relative_error(outcome.fields, expected, COMPARED)
    ncontact = singles.contacts.counts(count)[step]
    is_contact = ncontact > 0
    is_constrained = ~is_contact & (singles.constraints[step] > 0)

    def kind(rows: np.ndarray) -> _KindOfStep:
        max_error = float(errors[rows].max()) if rows.any() else None
        return _KindOfStep(int(rows[:count].sum()), max_error)

    c_moves = agreement.max_relative_error(expected, before, COMPARED) > 0
    engine_stays = agreement.max_relative_error(outcome.fields, before, COMPARED) == 0
    same_count = normal_degrees = None
    if outcome.contacts is not None and is_contact.any():
        has_same_count = outcome.contacts.counts(total) == ncontact
        same_count = float(has_same_count[is_contact].mean())
        first = outcome.contacts.first(count)
        normal_degrees = accelerated_limits.normal_angle(singles.contacts, first)
    return _SingleStepErrors(
        unconstrained=kind(~is_contact & ~is_constrained),
        constrained=kind(is_constrained),
        contact=kind(is_contact),
        still=bool(c_moves.any() and engine_stays[c_moves].all()),
        same_count=same_count,
        normal_degrees=normal_degrees,
        contact_impulse=_contact_impulse(
            outcome.fields["qvel"][:count][is_contact[:count]],
            expected["qvel"][:count][is_contact[:count]],
            singles.qvel_without_contact[is_contact[:count]],
        ),
    )


def _contact_impulse(
    reached: np.ndarray, expected: np.ndarray, without_contact: np.ndarray
) -> float | None:
    """Return the share of C's contact impulse that an engine's steps have, the median.

    An impulse is the change of velocities that contacts make in one step. The engine's is projected
    on that of C.

    Args:
      reached: (n, nv) velocities after steps in contact.
      expected: (n, nv) velocities after the same steps in C.
      without_contact: (n, nv) velocities after the same steps in C without contacts.

    Returns:
      The share; None where no contact changes a velocity by more than rounding in float32.
    """
    in_c, own = expected - without_contact, reached - without_contact
    scale = np.maximum(1.0, np.abs(expected).max(axis=1, initial=0.0))
    counts = np.abs(in_c).max(axis=1, initial=0.0) > _LEAST_IMPULSE * scale
    if not counts.any():
        return None
    shares = (own * in_c).sum(axis=1)[counts] / (in_c * in_c).sum(axis=1)[counts]
    return float(np.median(np.nan_to_num(shares, nan=0.0, posinf=0.0, neginf=0.0)))


def _rows(workload: Workload, states: np.ndarray, rows: np.ndarray) -> dict[str, np.ndarray]:
    fields = workloads.fields(workload.model, states)
    return {name: values[rows] for name, values in fields.items()}
