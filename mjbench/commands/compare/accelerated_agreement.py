"""How far a compiled run is from C: single steps, the run to its end, and the timed blocks.

`check_run` drives the compiled programs beside the reference run and returns a `CheckedRun`, with
the judgement of each part (`mjbench.simulation.accelerated_judgement`).
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.commands.compare.accelerated_run_statistics import figure_measures
from mjbench.commands.compare.accelerated_single_steps import (
    Budget,
    JudgedConstraints,
    judge_constraints,
    judge_smooth,
    judge_warm_start,
)
from mjbench.commands.compare.accelerated_tolerances import (
    SHADOW_FACTOR,
    SMOOTH_LIMIT,
    SOLUTION_LIMIT,
    STILL_LIMIT,
    UNCONSTRAINED_RUN_LIMIT,
)
from mjbench.paths.accelerated import Compiled, StepOutcome, start_fields
from mjbench.simulation import agreement, compat, reference_trajectory
from mjbench.simulation import workload as workloads
from mjbench.simulation.accelerated_judgement import (
    EngineJudgement,
    JudgedPart,
    Measure,
    PartName,
    Precision,
    finite_or_none,
)
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_trajectory import COMPARED, MAX_SINGLE_STEPS, SingleSteps
from mjbench.simulation.state_drift import Fields
from mjbench.simulation.workload import Workload

# Simulations followed step by step, spread over the batch. Single steps from their states are taken
# again in every simulation that remains.
FOLLOWED = 32
# States in which smooth dynamics, contacts and the constraint problem are judged, at most.
JUDGED_STATES = 64


@dataclass(frozen=True, eq=False)
class Programs:
    """What an engine compiled of a model.

    Attributes:
      smooth: single steps of `probe_workload` without constraints.
      converged: the same with constraints, and a solver that goes on to the solution.
    """

    timed: Compiled
    smooth: Compiled
    converged: Compiled


@dataclass(frozen=True, eq=False)
class CheckedRun:
    """A compiled run beside the reference run.

    Attributes:
      final_fields: (nbatch, size) arrays by MjData field, after the last step of the compiled run.
      has_parted: whether a constraint acts in the run, so that simulations diverge.
      final_shadow: difference of the shadow from C at the end of the run: the median over
        simulations where they have parted, else the largest.
    """

    judgement: EngineJudgement
    final_fields: Fields
    has_parted: bool
    final_shadow: float


def probe_workload(model: mujoco.MjModel, workload: Workload) -> Workload:
    """Return the workload of single steps for which other programs of a model are compiled."""
    count = min(JUDGED_STATES, min(FOLLOWED, workload.nbatch) * workload.nstep)
    states = np.tile(workload.initial_state[:1], (count, 1))
    control = np.zeros((count, 1, workload.control.shape[2]))
    return Workload(model, states, control, 1, workload.seed)


def check_run(
    programs: Programs, precision: Precision, on_state: Callable[[], None] = lambda: None
) -> CheckedRun:
    """Judge compiled programs; `on_state` is called before each constraint problem."""
    workload, check = programs.timed.workload, _Check(programs, precision)
    constraints = check.constraints(on_state)
    parts = [check.inputs(), check.smooth(), constraints.contacts, constraints.constraints]
    if workload.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_WARMSTART):
        parts.append(check.warm_start())
    parts.append(check.run(constraints.has_same_contacts))
    states = constraints.states or len(check.judged.state)
    judgement = EngineJudgement.of(
        precision, parts, constraints.pairs, states, constraints.contact_states
    )
    _, final_shadow = check.errors(workload.nstep, check.final_fields)
    has_parted = check.reference.unconstrained_nstep < workload.nstep
    shadow = float(np.median(final_shadow) if has_parted else final_shadow.max())
    return CheckedRun(judgement, check.final_fields, has_parted, shadow)


class _Check:
    """The reference run, and what the compiled programs make of it."""

    def __init__(self, programs: Programs, precision: Precision):
        self._programs, self._precision = programs, precision
        self._workload = workload = programs.timed.workload
        self._is_float32 = precision == Precision.FLOAT32
        self._timed = programs.timed.advance
        self._starts = start_fields(workload)
        self.reference = reference_trajectory.record_trajectory(workload, FOLLOWED)
        self._shadow = reference_trajectory.record_trajectory(
            workload, FOLLOWED, reference_trajectory.as_float32
        )
        self._at_start = self._timed(self._starts, workload.control, 0).fields
        self.judged = self._single_steps(len(programs.smooth.workload.initial_state))
        self.final_fields = self._timed(self._starts, workload.control, workload.nstep).fields

    def inputs(self) -> JudgedPart:
        """Judge whether the engine has exactly the start states, the first and the last control."""
        control = self._workload.control
        first_ctrl = self._timed(self._starts, control, 1).fields["ctrl"]
        pairs = [
            (self._at_start[name], self._starts[name])
            for name in self._starts
            if name in self._at_start
        ]
        pairs += [(first_ctrl, control[:, 0]), (self.final_fields["ctrl"], control[:, -1])]
        if self._is_float32:
            pairs = [(got, reference_trajectory.as_float32(want)) for got, want in pairs]
        others = sum(not np.array_equal(*pair) for pair in pairs)
        return JudgedPart.of(
            PartName.INPUTS, Measure("arrays other than the start states and controls", others, 0)
        )

    def smooth(self) -> JudgedPart:
        """Judge steps on which no constraint acts, and the run as long as none does."""
        model, precision = self._workload.model, self._precision
        reached = take_single_steps(self._programs.smooth, self.judged).fields
        measures = [judge_smooth(model, self.judged, reached, precision)]
        singles = self._single_steps(MAX_SINGLE_STEPS)
        outcome = take_single_steps(self._programs.timed, singles, repeats=True)
        unconstrained, repeated, still_share = _step_errors(model, singles, outcome)
        for name, errors, limits in (
            ("an unconstrained step", unconstrained, SMOOTH_LIMIT),
            ("a step beside the same one in another simulation", repeated, SOLUTION_LIMIT),
        ):
            if len(errors):
                measures.append(Measure(name, finite_or_none(errors.max()), limits[precision]))
        if nstep := self.reference.unconstrained_nstep:
            step_error = float(unconstrained.max(initial=0.0))
            measures.append(self._unconstrained_run(nstep, step_error))
        measures.append(Measure("share of steps that change no state", still_share, STILL_LIMIT))
        return JudgedPart.of(PartName.SMOOTH, *measures)

    def constraints(self, on_state: Callable[[], None]) -> JudgedConstraints:
        return judge_constraints(
            self._workload.model,
            self.judged,
            take_single_steps(self._programs.converged, self.judged),
            take_single_steps(self._programs.timed, self.judged),
            self._precision,
            Budget(on_state=on_state),
        )

    def warm_start(self) -> JudgedPart:
        """Judge whether the engine ignores warm starts, as the model demands."""
        steps, place = self.judged, compat.state_columns(self._workload.model)["qacc_warmstart"]

        def qacc(warm_start: np.ndarray) -> np.ndarray:
            state = steps.state.copy()
            state[:, place] = warm_start
            started = dataclasses.replace(steps, state=state)
            return take_single_steps(self._programs.timed, started).qacc

        cold = np.zeros_like(steps.state[:, place])
        return judge_warm_start(
            qacc(cold),
            qacc(1.0 + np.abs(steps.state[:, place])),
            qacc(cold),
            self._programs.timed.is_deterministic,
        )

    def run(self, has_same_contacts: bool) -> JudgedPart:
        workload = self._workload
        compared = [self.final_fields[name] for name in COMPARED if name in self.final_fields]
        lost = int((~np.isfinite(np.hstack(compared)).all(axis=1)).sum())
        measures = [Measure("simulations that do not end in finite numbers", lost, 0)]
        if not lost:
            measures += figure_measures(
                workload,
                self._timed,
                self.reference,
                self._shadow,
                self._precision,
                has_same_contacts,
            )
        error, shadow = self.errors(workload.nstep, self.final_fields)
        name = f"difference after {workload.nstep} steps (beside it, C with float32 states)"
        in_c = finite_or_none(shadow.max())
        measures.append(Measure(name, finite_or_none(error.max()), in_c=in_c))
        return JudgedPart.of(PartName.RUN, *measures)

    def errors(self, nstep: int, fields: Fields) -> tuple[np.ndarray, np.ndarray]:
        """Return (nsim,) errors of `fields`, and of the shadow, after `nstep` steps."""
        model, reference = self._workload.model, self.reference
        expected = workloads.fields(model, reference.states[:, nstep])
        rounded = workloads.fields(model, self._shadow.states[:, nstep])
        reached = {name: values[reference.simulation] for name, values in fields.items()}
        return (
            agreement.max_relative_error(reached, expected, COMPARED),
            agreement.max_relative_error(rounded, expected, COMPARED),
        )

    def _unconstrained_run(self, nstep: int, step_error: float) -> Measure:
        control = self._workload.control
        reached, shadow = self.errors(nstep, self._timed(self._starts, control, nstep).fields)
        limit = UNCONSTRAINED_RUN_LIMIT
        if self._is_float32:  # over few steps the shadow, which rounds only states, shows little
            rounding = max(step_error, float(np.finfo(np.float32).eps))
            limit = SHADOW_FACTOR * max(float(shadow.max()), rounding)
        return Measure(f"{nstep} unconstrained steps", finite_or_none(reached.max()), limit)

    def _single_steps(self, max_count: int) -> SingleSteps:
        return reference_trajectory.single_steps(
            self._workload, self.reference, max_count, self._is_float32, [*self._at_start]
        )


def take_single_steps(
    program: Compiled, singles: SingleSteps, repeats: bool = False
) -> StepOutcome:
    """Take single steps by a compiled program, as many at a time as it has simulations."""
    nbatch, count = program.workload.nbatch, len(singles.state)
    states = workloads.fields(program.workload.model, singles.state)
    states.pop("ctrl", None)
    outcomes: list[StepOutcome] = []
    for begin in range(0, count, nbatch):
        rows = np.arange(begin, begin + nbatch) % count
        control = np.zeros_like(program.workload.control)
        control[:, 0] = singles.control[rows]
        outcomes.append(program.advance({name: v[rows] for name, v in states.items()}, control, 1))
    total = nbatch * len(outcomes) if repeats else count
    contacts = [outcome.contacts for outcome in outcomes if outcome.contacts is not None]
    return StepOutcome(
        {
            name: np.concatenate([outcome.fields[name] for outcome in outcomes])[:total]
            for name in outcomes[0].fields
        },
        Contacts.joined(contacts, nbatch).first(total) if len(contacts) == len(outcomes) else None,
        np.concatenate([outcome.qacc for outcome in outcomes])[:total],
        np.concatenate([outcome.qfrc_constraint for outcome in outcomes])[:total],
    )


def _step_errors(
    model: mujoco.MjModel, singles: SingleSteps, outcome: StepOutcome
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return how far single steps of the timed program are from C's.

    Returns:
      Errors of the steps on which no constraint acts; differences between a step and the same in
      another simulation; and of the steps that change a state in C, the share that change none.
    """
    count, total = len(singles.state), len(next(iter(outcome.fields.values())))
    step = np.arange(total) % count  # which of the single steps a row took
    expected, before = (
        {name: values[step] for name, values in workloads.fields(model, states).items()}
        for states in (singles.after, singles.state)
    )
    is_free = ((singles.contacts.counts(count) == 0) & (singles.constraints == 0))[step]
    errors = agreement.max_relative_error(outcome.fields, expected, COMPARED)[is_free]
    moves = agreement.max_relative_error(expected, before, COMPARED) > 0
    stays = agreement.max_relative_error(outcome.fields, before, COMPARED) == 0
    first = {name: values[step] for name, values in outcome.fields.items()}
    repeated = agreement.max_relative_error(outcome.fields, first, COMPARED)[count:]
    return errors, repeated, float(stays[moves].mean()) if moves.any() else 0.0


def timed_end_problem(compiled: Compiled, checked: CheckedRun) -> str:
    """Return how the last timed block ended elsewhere than the checked run; empty if it did not.

    What does not repeat to the last bit may differ as rounding to float32 does in C: by the
    farthest simulation where all motion is unconstrained. In contact some simulations diverge from
    each other after any difference, and which ones is chance: there the median counts.
    """
    return _end_problem(compiled, checked, checked.final_fields, compiled.is_deterministic)


def reordered_end_problem(compiled: Compiled, checked: CheckedRun) -> str:
    """Return how one more block of reordered simulations ends elsewhere; empty if it does not.

    A path that replays the result of an earlier block does. The order may change how numbers are
    rounded, on a CPU, too.
    """
    workload = compiled.workload
    order = workloads.draw_order(workload.nbatch, np.random.default_rng(workload.seed))
    workload.reorder(order)
    compiled.reload()
    compiled.block_s()
    expected = {name: values[order] for name, values in checked.final_fields.items()}
    problem = _end_problem(compiled, checked, expected, is_exact=False)
    return f"once the simulations are reordered, {problem}" if problem else ""


def _end_problem(compiled: Compiled, checked: CheckedRun, expected: Fields, is_exact: bool) -> str:
    """Return how the last block ended elsewhere than expected; empty if it did not."""
    workload = compiled.workload
    reached = workloads.fields(workload.model, compiled.final_states().values)
    errors = agreement.max_relative_error(reached, expected, COMPARED)
    lost = sum(finite_or_none(error) is None for error in errors)
    if lost:
        return f"in timed blocks {lost} simulations do not end in finite numbers"
    error, allowed = float(errors.max()), 0.0
    if not is_exact:
        error = float(np.median(errors)) if checked.has_parted else error
        allowed = SHADOW_FACTOR * max(checked.final_shadow, float(np.finfo(np.float32).eps))
    if error <= allowed:
        return ""
    return f"timed blocks end {error:.2g} from the run that was checked"
