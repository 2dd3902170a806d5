"""Single steps of an engine beside C's: smooth dynamics, contacts, the constraint problem.

All functions take arrays that an engine returned, so that they need none.
"""

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from mjbench.commands.compare.accelerated_contacts import ContactJudge
from mjbench.commands.compare.accelerated_tolerances import (
    CONTACT_LIMIT,
    MAX_ROUNDING_EFFECT,
    ROUNDING_FACTOR,
    SETTINGS_FACTOR,
    SETTINGS_LIMIT,
    SMOOTH_LIMIT,
    SOLUTION_LIMIT,
)
from mjbench.paths.accelerated import StepOutcome
from mjbench.simulation import agreement, compat, reference_trajectory
from mjbench.simulation import workload as workloads
from mjbench.simulation.accelerated_judgement import (
    EngineAnswer,
    JudgedPart,
    Measure,
    PairContacts,
    PartName,
    Precision,
    finite_or_none,
    worst,
)
from mjbench.simulation.constraint_problem import ConstraintProblem, Solution, without_constraints
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_trajectory import COMPARED, SingleSteps
from mjbench.simulation.state_drift import Fields

# Seconds after which no further state is judged; two passes have as many each.
JUDGING_S = 15.0


def judge_smooth(
    model: mujoco.MjModel, singles: SingleSteps, reached: Fields, precision: Precision
) -> Measure:
    """Compare single steps without constraints with those of C.

    Args:
      reached: (n, size) arrays by MjData field, after the engine's steps.
    """
    in_c = reference_trajectory.take_steps(
        without_constraints(model), singles.state, singles.control
    )
    expected = workloads.fields(model, in_c.after)
    error = float(agreement.max_relative_error(reached, expected, COMPARED).max())
    return Measure("a step without constraints", finite_or_none(error), SMOOTH_LIMIT[precision])


@dataclass(frozen=True)
class JudgedConstraints:
    """What became of contacts, and of the problem that follows from them.

    Attributes:
      states: those that were judged within the time for it.
      contact_states: those of them in which C has contacts.
    """

    precision: Precision
    contacts: JudgedPart
    constraints: JudgedPart
    pairs: tuple[PairContacts, ...]
    states: int
    contact_states: int

    @property
    def has_same_contacts(self) -> bool:
        """Whether contacts change accelerations by no more than rounding does in any model.

        They may agree and change more, where rounding does more in this model.
        """
        return self.contacts.answer == EngineAnswer.YES and all(
            pair.largest_effect is not None and pair.largest_effect <= CONTACT_LIMIT[self.precision]
            for pair in self.pairs
        )


@dataclass(frozen=True)
class Budget:
    """How long states are judged: no further one is begun after that."""

    limit_s: float = JUDGING_S
    on_state: Callable[[], None] = lambda: None
    clock: Callable[[], float] = time.monotonic

    def within(self, rows: Iterable[int]) -> Iterator[int]:
        """Yield rows until the time is up; at least one."""
        end = self.clock() + self.limit_s
        for i, row in enumerate(rows):
            if i and self.clock() > end:
                return
            self.on_state()
            yield row


@dataclass
class _Errors:
    acceleration: list[float] = dataclasses.field(default_factory=list)
    force: list[float] = dataclasses.field(default_factory=list)
    at_settings: list[float] = dataclasses.field(default_factory=list)
    in_c_at_settings: list[float] = dataclasses.field(default_factory=list)
    rounding: list[float] = dataclasses.field(default_factory=list)
    force_rounding: list[float] = dataclasses.field(default_factory=list)
    contact_rounding: list[float] = dataclasses.field(default_factory=list)


def judge_constraints(
    model: mujoco.MjModel,
    singles: SingleSteps,
    converged: StepOutcome,
    timed: StepOutcome,
    precision: Precision,
    budget: Budget | None = None,
) -> JudgedConstraints:
    """Compare contacts, and the solutions of the problems that follow from them, with C's.

    Args:
      converged: the same steps by a solver that goes on to the solution.
      timed: the same steps with the user's own settings.
      budget: for each of two passes over the states, of which the first solves C's own problems.
    """
    if converged.contacts is None:
        reason = "the engine does not report its contacts"
        unknown = JudgedPart(PartName.CONTACTS, EngineAnswer.NOT_JUDGED, reason=reason)
        of_problem = dataclasses.replace(unknown, name=PartName.CONSTRAINTS)
        return JudgedConstraints(precision, unknown, of_problem, (), 0, 0)
    problem, errors = ConstraintProblem(model), _Errors()
    judge, contact_states = ContactJudge(model, precision), 0
    rounding = _Rounding(model) if precision == Precision.FLOAT32 else None
    budget = budget or Budget()
    # in random order, so that those within the budget are of the whole run
    rows = np.random.default_rng(0).permutation(len(singles.state)).tolist()
    loaded = []
    for i in budget.within(rows):
        problem.load(singles.state[i], singles.control[i])  # meets the geoms that touch
        loaded.append(i)
    states = 0
    for i in budget.within(loaded):
        states += 1
        state = singles.state[i]
        problem.load(state, singles.control[i])
        contacts = converged.contacts.select(converged.contacts.simulation == i)
        contact_states += len(problem.contacts.simulation) > 0
        judge.add(problem, contacts)
        if not problem.has_examples(contacts):
            continue
        solution = problem.solve(contacts)
        errors.acceleration.append(problem.acceleration_error(converged.qacc[i], solution))
        following = Solution(converged.qacc[i], problem.forces_at(contacts, converged.qacc[i]))
        errors.force.append(problem.force_error(converged.qfrc_constraint[i], following))
        if model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            errors.at_settings.append(problem.acceleration_error(timed.qacc[i], solution))
            user = problem.at_user_settings()
            errors.in_c_at_settings.append(problem.acceleration_error(user.qacc, problem.own))
        if rounding is not None:
            rounding.add(problem, state, contacts, solution, errors)
        else:
            errors.rounding.append(0.0)
            errors.force_rounding.append(0.0)
    pairs = judge.pairs(_shared_limit(precision, errors.contact_rounding))
    answer = worst(pair.answer for pair in pairs)
    deciding = (str(pair) for pair in pairs if pair.answer == answer != EngineAnswer.YES)
    of_contacts = JudgedPart(PartName.CONTACTS, answer, reason="; ".join(deciding))
    of_solution = _solution_part(errors, precision)
    return JudgedConstraints(precision, of_contacts, of_solution, pairs, states, contact_states)


def _solution_part(errors: _Errors, precision: Precision) -> JudgedPart:
    name = PartName.CONSTRAINTS
    if not errors.acceleration:
        reason = "in every state, a flex touches, or geoms that do not touch in C"
        return JudgedPart(name, EngineAnswer.NOT_JUDGED, reason=reason)
    limits = _limits(precision, errors.rounding)
    force_rounding = np.maximum(errors.rounding, errors.force_rounding)
    force_limits = _limits(precision, force_rounding)
    measures = [
        _worst("accelerations of the solution", errors.acceleration, limits),
        _worst(
            "forces beside those that follow from its accelerations", errors.force, force_limits
        ),
    ]
    if errors.at_settings:
        in_c = np.array(errors.in_c_at_settings)
        allowed = np.maximum(np.maximum(limits, SETTINGS_LIMIT), SETTINGS_FACTOR * in_c)
        measures.append(
            _worst("distance from the solution at your settings", errors.at_settings, allowed, in_c)
        )
    part = JudgedPart.of(name, *measures)
    least = float(force_rounding.min())
    if part.answer == EngineAnswer.YES and ROUNDING_FACTOR * least > MAX_ROUNDING_EFFECT:
        reason = f"rounding to float32 alone changes the solution of every state, by {least:.1g}"
        return dataclasses.replace(part, answer=EngineAnswer.NOT_JUDGED, reason=reason)
    return part


def _shared_limit(precision: Precision, rounding: ArrayLike) -> float:
    """Return the limit that all states have, from what rounding does in each."""
    largest = float(np.max(rounding, initial=0.0))
    return max(CONTACT_LIMIT[precision], min(ROUNDING_FACTOR * largest, MAX_ROUNDING_EFFECT))


def _limits(precision: Precision, rounding: ArrayLike) -> np.ndarray:
    """Return the limit of each state: more than that of all where rounding alone does more."""
    of_all = max(SOLUTION_LIMIT[precision], _shared_limit(precision, rounding))
    return np.maximum(of_all, ROUNDING_FACTOR * np.asarray(rounding))


def _worst(
    name: str, errors: Sequence[float], limits: np.ndarray, in_c: np.ndarray | None = None
) -> Measure:
    """Return the error of the state where it is nearest to its limit, or farthest beyond."""
    is_limited = np.isfinite(limits)  # where C itself is finite if it is moved by rounding
    shares = np.divide(errors, limits, out=np.full(len(limits), -1.0), where=is_limited)
    i = int(np.argmax(shares))
    own = None if in_c is None else finite_or_none(in_c[i])
    return Measure(name, finite_or_none(errors[i]), finite_or_none(limits[i]), own)


class _Rounding:
    """C itself, its states and contacts moved by up to half a unit in the last place of float32."""

    def __init__(self, model: mujoco.MjModel):
        columns = compat.state_columns(model)
        self._places = [columns[name] for name in COMPARED if name in columns]
        self._size, self._rng = float(model.stat.meansize), np.random.default_rng(0)

    def add(
        self,
        problem: ConstraintProblem,
        state: np.ndarray,
        contacts: Contacts,
        solution: Solution,
        errors: _Errors,
    ) -> None:
        """Add the errors that rounding makes in a state; `problem` stays there."""
        moved = state.copy()
        for place in self._places:
            moved[place] += self._draws(moved[place], moved[place])
        own = problem.own
        size = self._size + np.abs(contacts.position)
        other = dataclasses.replace(
            contacts,
            distance=contacts.distance + self._draws(size.max(axis=1), contacts.distance),
            position=contacts.position + self._draws(size, contacts.position),
            frame=contacts.frame + self._draws(contacts.frame, contacts.frame),
        )
        solved = problem.solve_at(moved, other)
        errors.rounding.append(problem.acceleration_error(solved.qacc, solution))
        # forces follow from accelerations by stiff constraints
        qacc = solution.qacc + self._draws(np.abs(solution.qacc).max(initial=0.0), solution.qacc)
        force = problem.forces_at(contacts, qacc)
        errors.force_rounding.append(problem.force_error(force, solution))
        touching, at_touching = problem.solve_touching_at(moved)
        if np.array_equal(np.sort(touching.geom, axis=0), np.sort(problem.contacts.geom, axis=0)):
            # elsewhere one begins to touch, and whether it counts is chance
            errors.contact_rounding.append(problem.acceleration_error(at_touching.qacc, own))

    def _draws(self, size: np.ndarray | float, like: np.ndarray) -> np.ndarray:
        half = 0.5 * np.finfo(np.float32).eps
        return np.asarray(half * size * self._rng.uniform(-1.0, 1.0, like.shape))


def judge_warm_start(
    cold: np.ndarray, warm: np.ndarray, again: np.ndarray, is_deterministic: bool
) -> JudgedPart:
    """Judge whether a model that turns warm starts off ignores them.

    Args:
      cold: (n, nv) accelerations of steps that start at zero; `again` are those of a repetition,
        as a GPU adds in any order.
      warm: those of the same steps that start elsewhere.
    """
    repeated = float(np.abs(again - cold).max(initial=0.0))
    noise = 0.0 if is_deterministic else ROUNDING_FACTOR * repeated
    difference = np.abs(warm - cold).max(initial=0.0)
    name = "accelerations depend on a warm start that the model turns off, by"
    return JudgedPart.of(PartName.WARM_START, Measure(name, finite_or_none(difference), noise))
