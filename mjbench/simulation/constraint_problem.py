"""The constraint problem of a state, solved by C to its end, with C's contacts or with others.

Constraints with regularisation make one convex problem with one solution, whichever algorithm
looks for it (MuJoCo's documentation, "Computation"). Another engine's solution is therefore
compared with that of C for the same contacts; their parameters are those of the model, as C
combines them.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.contacts import Contacts, turned

# Enough for Newton's method to end by itself, at a gradient that no step makes smaller.
CONVERGED_ITERATIONS, CONVERGED_LS_ITERATIONS = 100, 50
# A tree's forces are relative to its own, where these are more than this share of the largest of
# any tree.
_LEAST_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver came to: (nv,) accelerations, and forces of constraints."""

    qacc: np.ndarray
    qfrc_constraint: np.ndarray


def converging(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model whose solver goes on to the solution, for C and other engines.

    It is integrated by Euler's method where it was by RK4, of which the accelerations of a step are
    those of its last stage.
    """
    changed = copy.copy(model)
    changed.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    changed.opt.tolerance = 0.0
    changed.opt.iterations = CONVERGED_ITERATIONS
    changed.opt.ls_iterations = CONVERGED_LS_ITERATIONS
    changed.opt.noslip_iterations = 0  # they end elsewhere than at the solution
    if changed.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        changed.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return changed


def without_constraints(model: mujoco.MjModel) -> mujoco.MjModel:
    changed, disable = copy.copy(model), mujoco.mjtDisableBit
    changed.opt.disableflags |= int(disable.mjDSBL_CONSTRAINT) | int(disable.mjDSBL_CONTACT)
    return changed


class ConstraintProblem:
    """The constraint problem of one state of a model after the other.

    Attributes:
      own: C's solution with its own contacts, of the present state.
      contacts: those of C, in simulation 0.
    """

    own: Solution
    contacts: Contacts

    def __init__(self, model: mujoco.MjModel):
        self._model = converging(model)
        compat.disable_flag(self._model, "island")  # islands have one solution together
        self._contactless = copy.copy(self._model)
        self._contactless.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.model = model
        self._data = mujoco.MjData(self._model)
        # contacts of C, by the ids of their geoms, the lower one first
        self._examples: dict[tuple[int, int], mujoco.MjContact] = {}

    def load(self, state: np.ndarray, control: np.ndarray) -> None:
        """Go to a state, a row of mjSTATE_INTEGRATION, and solve its problem."""
        self._state, self._control = state, control
        self._restart(self._model, state)
        mujoco.mj_forward(self._model, self._data)
        for each in self._data.contact[: self._data.ncon]:
            if min(each.geom) >= 0:
                self._examples.setdefault(_pair(each), copy.copy(each))
        self.contacts = self._own_contacts()
        self.own = self._solution()
        self._prepare_norm()

    def at_user_settings(self) -> Solution:
        """Return what C's solver finds in the present state with the user's own settings."""
        self._restart(self.model, self._state)
        mujoco.mj_forward(self.model, self._data)
        return self._solution()

    def has_examples(self, contacts: Contacts) -> bool:
        return bool(self.are_examples(contacts).all())

    def are_examples(self, contacts: Contacts) -> np.ndarray:
        """Return (ncon,) whether C has met the pair of geoms that touch, in any state so far.

        Contacts of a flex do not say which of its parts touch, so that they have none.
        """
        pairs = contacts.geom.tolist()
        return np.array([tuple(pair) in self._examples for pair in pairs], dtype=bool)

    def margins(self, contacts: Contacts) -> np.ndarray:
        """Return (ncon,) distances in m below which contacts of these geoms count in C."""
        return np.array([compat.include_margin(self.model, *p) for p in contacts.geom.tolist()])

    def solve(self, contacts: Contacts) -> Solution:
        """Return C's solution with other contacts; KeyError for a pair that C has not met."""
        return self.solve_at(self._state, contacts)

    def solve_touching_at(self, state: np.ndarray) -> tuple[Contacts, Solution]:
        self._restart(self._model, state)
        mujoco.mj_forward(self._model, self._data)
        return self._own_contacts(), self._solution()

    def solve_at(self, state: np.ndarray, contacts: Contacts) -> Solution:
        """Return C's solution at another state, which errors are not measured at."""
        data = self._data
        self._restart(self._contactless, state)
        mujoco.mj_fwdPosition(self._contactless, data)
        for contact in self._as_c(contacts):
            mujoco.mj_addContact(self._model, data, contact)
        mujoco.mj_makeConstraint(self._model, data)
        mujoco.mj_projectConstraint(self._model, data)
        mujoco.mj_fwdVelocity(self._model, data)
        mujoco.mj_fwdActuation(self._model, data)
        mujoco.mj_fwdAcceleration(self._model, data)
        mujoco.mj_fwdConstraint(self._model, data)
        return self._solution()

    def forces_at(self, contacts: Contacts, qacc: np.ndarray) -> np.ndarray:
        """Return (nv,) forces that constraints have at some accelerations, of the present state."""
        self.solve(contacts)
        data, cost = self._data, np.zeros(1)
        residual = np.zeros(data.nefc)
        if data.nefc:
            mujoco.mj_mulJacVec(self._model, data, residual, qacc)
            residual -= data.efc_aref
            mujoco.mj_constraintUpdate(self._model, data, residual, cost, 0)
        return np.array(data.qfrc_constraint)

    def acceleration_error(self, reached: np.ndarray, solution: Solution) -> float:
        """Return how far accelerations are from a solution's: of the tree where it is farthest.

        The measure is √(aᵀMa): one unit for all joints. It is relative to what constraints add
        to the smooth acceleration, or to that itself where it is more.
        """
        moved = reached - solution.qacc
        added = solution.qacc - self._smooth
        return self._relative(self._squares(moved), self._squares(added))

    def force_error(self, reached: np.ndarray, solution: Solution) -> float:
        """Return the same for forces of constraints: of the accelerations that they cause."""
        wanted = solution.qfrc_constraint
        moved, added = self._caused(reached - wanted), self._caused(wanted)
        return self._relative(self._squares(moved), self._squares(added))

    def _restart(self, model: mujoco.MjModel, state: np.ndarray) -> None:
        compat.restart(model, self._data, state)
        self._data.ctrl[:] = self._control

    def _own_contacts(self) -> Contacts:
        return Contacts.of_c([self._data.contact[: self._data.ncon]])

    def _solution(self) -> Solution:
        return Solution(np.array(self._data.qacc), np.array(self._data.qfrc_constraint))

    def _as_c(self, contacts: Contacts) -> list[mujoco.MjContact]:
        rows = []
        for i, pair in enumerate(contacts.geom.tolist()):
            example = self._examples[tuple(pair)]
            contact, frame = copy.copy(example), contacts.frame[i]
            if example.geom[0] > example.geom[1]:
                frame = turned(frame[None])[0]
            contact.dist = contacts.distance[i]
            contact.pos[:] = contacts.position[i]
            contact.frame[:] = frame.ravel()
            rows.append(contact)
        return rows

    def _prepare_norm(self) -> None:
        """Hold what relative errors need, of the present state: M in factors, and trees."""
        self._smooth = np.array(self._data.qacc_smooth)
        self._mass = np.zeros((self._model.nv, self._model.nv))
        unit = np.eye(self._model.nv)
        for i in range(self._model.nv):
            mujoco.mj_mulM(self._model, self._data, self._mass[i], unit[i])
        self._smooth_squares = self._squares(self._smooth)

    def _caused(self, force: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self._mass, force) if force.size else force

    def _squares(self, acceleration: np.ndarray) -> np.ndarray:
        """Return aᵀMa of each kinematic tree."""
        products = acceleration * (self._mass @ acceleration)
        tree = np.asarray(self._model.dof_treeid)
        return np.maximum(np.bincount(tree, products, minlength=max(1, self._model.ntree)), 0.0)

    def _relative(self, moved: np.ndarray, added: np.ndarray) -> float:
        scale = np.maximum(added, self._smooth_squares)
        scale = np.maximum(scale, _LEAST_SHARE**2 * scale.max(initial=0.0))
        shares = np.sqrt(moved / np.where(scale > 0, scale, 1.0))
        return float(np.nan_to_num(shares.max(initial=0.0), nan=np.inf))


def _pair(contact: mujoco.MjContact) -> tuple[int, int]:
    low, high = sorted(int(each) for each in contact.geom)
    return low, high
