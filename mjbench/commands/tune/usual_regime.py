"""What a model does in its usual regime: solver iterations, contacts, and bodies that never touch.

`observe` steps simulations like those of every other command for what is usual. What never happens
is claimed only after exploring further: from every keyframe, with controls that span their range,
and in random poses. Simulations alone do not do: of the pairs of bodies that never touched in 60 s,
half did with another seed (humanoid, quadruped_terrain).
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench.commands.tune.pair_watch import IdlePair, PairWatch
from mjbench.simulation import compat, starts, workload, workload_sampling
from mjbench.simulation.starts import DEFAULT_STARTS, StartPlan
from mjbench.simulation.workload_sampling import SampleRequest

# Simulated seconds to observe, and seconds of computing that they may take.
OBSERVED_S, MAX_COMPUTING_S = 20.0, 5.0
# Random poses, and the share of that computing that they may take.
NPOSE, _POSES_SHARE = 10_000, 0.2
# What reading the counters of a step takes, in seconds, and how many steps distances are read in.
_READING_S, _NSAMPLE = 2e-5, 200
# Usual simulations, and those of wide controls; keyframes, at most.
_NUSUAL, _NWIDE, _MAX_KEYFRAMES = 4, 4, 8
# Limits are soft: joints go beyond them by some of their range, on either side.
_BEYOND = 0.1
# Wide controls: their standard deviation is the whole half of their range, so many are at its end.
_WIDE_SPREAD = 1.0 / workload.CONTROL_SHARE


@dataclass(frozen=True)
class Usage:
    """How many iterations the steps of the usual regime took."""

    median: int
    most: int


@dataclass(frozen=True, eq=False)
class ObservedModel:
    """What was seen of a model.

    Attributes:
      nposes: random poses that were looked at for bodies that touch.
      solver: iterations of a step in the constraint island with the most.
      line_search: iterations of the longest line search of a step; 0 with a solver that has none.
      idle_pairs: bodies that were tested for collision in detail and never touched.
      unnamed_idle_pairs: how many more there are, with a body that has no name.
    """

    model: mujoco.MjModel
    is_mjcf: bool
    simulated_s: float
    nposes: int
    solver: Usage
    line_search: Usage
    max_contacts: int
    max_constraints: int
    idle_pairs: tuple[IdlePair, ...] = ()
    unnamed_idle_pairs: int = 0


def is_mjcf(path: Path) -> bool:
    if path.suffix.lower() != ".xml":
        return False
    try:
        with path.open("rb") as stream:
            _, root = next(ElementTree.iterparse(stream, events=("start",)))
    except (OSError, ElementTree.ParseError, StopIteration):
        return False
    return str(root.tag) != "robot"


def observe_model(
    model: mujoco.MjModel,
    is_mjcf: bool,
    seed: int = 0,
    plan: StartPlan = DEFAULT_STARTS,
    hold: int = 1,
    computing_s: float = MAX_COMPUTING_S,
) -> ObservedModel:
    """Return what is seen of a model; simulations may take `computing_s`, apart from settling."""
    step_s = workload_sampling.settled_step_s(model)
    wanted = OBSERVED_S / float(model.opt.timestep)
    nstep = max(1, int(min(wanted, computing_s / (step_s + _READING_S))))
    nexplored = nstep // 2
    run = _Run(model, hold, max(1, nstep // _NSAMPLE))
    each_nstep = workload.whole_holds((nstep - nexplored) // _NUSUAL, hold)
    settling_nstep = starts.max_settling_nstep(step_s)
    request = SampleRequest(_NUSUAL, each_nstep, hold, seed, plan, settling_nstep, may_shorten=True)
    usual = workload_sampling.draw(model, request).workload
    for state, control in zip(usual.initial_state, usual.control, strict=True):
        compat.restart(model, run.data, state)
        run.simulate(control)
    nusual = run.nstep
    _explore(run, model, nexplored, hold, seed)
    if not model.neq:  # equality constraints forbid poses that joint limits allow
        poses_s = _POSES_SHARE * computing_s
        run.pose(min(NPOSE, max(1, int(poses_s / (step_s + _READING_S)))), seed)
    return run.observed(is_mjcf, nusual)


def _explore(run: "_Run", model: mujoco.MjModel, nstep: int, hold: int, seed: int) -> None:
    """Simulate from keyframes, and under wide controls: further than the usual starts lead."""
    nkey = min(int(model.nkey), _MAX_KEYFRAMES)
    rng = np.random.default_rng([seed, 3])
    ncontrol = max(1, nstep // (nkey + _NWIDE) // hold)
    usual = workload.random_controls(model, nkey, ncontrol, hold, rng, spread=1.0)
    for key, control in enumerate(usual):
        mujoco.mj_resetDataKeyframe(model, run.data, key)
        run.simulate(control + (model.key_ctrl[key] - model.key_ctrl[0]))
    for control in workload.random_controls(model, _NWIDE, ncontrol, hold, rng, _WIDE_SPREAD):
        workload.reset_to_start(model, run.data)
        run.simulate(control)


class _Run:
    def __init__(self, model: mujoco.MjModel, hold: int, sample_every: int):
        self._model, self._hold, self._sample_every = model, hold, sample_every
        self.data = mujoco.MjData(model)
        self._pairs = PairWatch(model, 2 * _NSAMPLE)  # of steps and of poses
        self._iterations: list[tuple[int, int]] = []  # of the solver, and of line searches
        self._max_contacts = self._max_constraints = self._nposes = 0

    @property
    def nstep(self) -> int:
        return len(self._iterations)

    def simulate(self, control: np.ndarray) -> None:
        """Step from where `data` is."""
        for ctrl in control:
            self.data.ctrl[:] = ctrl
            for _ in range(self._hold):
                mujoco.mj_step(self._model, self.data)
                self._read_step()

    def pose(self, count: int, seed: int) -> None:
        model, data = self._model, self.data
        workload.reset_to_start(model, data)
        rng = np.random.default_rng([seed, 4])
        sample_every = max(1, count // _NSAMPLE)
        for number, qpos in enumerate(random_poses(model, np.array(data.qpos), count, rng)):
            data.qpos[:] = qpos
            mujoco.mj_fwdPosition(model, data)
            self._pairs.contacts(data)
            if number % sample_every == 0:
                self._pairs.sample(data)
        self._nposes += count

    def _read_step(self) -> None:
        data = self.data
        if self.nstep % self._sample_every == 0:
            self._pairs.sample(data)
        self._pairs.contacts(data)
        iterations = int(compat.solver_iterations(data).max(initial=0))
        search = compat.line_search_iterations(data) if iterations else 0
        self._iterations.append((iterations, search))
        self._max_contacts = max(self._max_contacts, int(data.ncon))
        self._max_constraints = max(self._max_constraints, int(data.nefc))

    def observed(self, is_mjcf: bool, nusual: int) -> ObservedModel:
        solver, line_search = np.array(self._iterations[:nusual], dtype=int).reshape(-1, 2).T
        return ObservedModel(
            self._model,
            is_mjcf,
            self.nstep * float(self._model.opt.timestep),
            self._nposes,
            _usage(solver),
            _usage(line_search),
            self._max_contacts,
            self._max_constraints,
            *self._pairs.idle(),
        )


def _usage(iterations: np.ndarray) -> Usage:
    return Usage(int(np.ceil(np.median(iterations))), int(iterations.max()))


def random_poses(
    model: mujoco.MjModel, start: np.ndarray, count: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield (nq,) poses, uniform within the limits of hinges and slides, a tenth wider, and balls.

    A hinge or ball without limits turns to any angle. Free joints, and slides without limits, stay
    where they start: joints do not bound them.
    """
    kinds, limited = np.asarray(model.jnt_type), np.asarray(model.jnt_limited).astype(bool)
    low, high = np.array(model.jnt_range).T
    is_hinge, is_slide = (kinds == int(_kind(name)) for name in ("HINGE", "SLIDE"))
    beyond = _BEYOND * (high - low)
    low, high = low - beyond, high + beyond
    low[is_hinge & ~limited], high[is_hinge & ~limited] = -np.pi, np.pi
    scalar = is_hinge | (is_slide & limited)
    at = np.asarray(model.jnt_qposadr)[scalar]
    balls = np.flatnonzero(kinds == int(_kind("BALL")))
    for _ in range(count):
        pose = start.copy()
        pose[at] = rng.uniform(low[scalar], high[scalar])
        for ball in balls:
            place = int(model.jnt_qposadr[ball])
            most_rad = float(high[ball]) if limited[ball] else np.pi
            pose[place : place + 4] = _rotation(most_rad, rng)
        yield pose


def _kind(name: str) -> mujoco.mjtJoint:
    return getattr(mujoco.mjtJoint, f"mjJNT_{name}")


def _rotation(most_rad: float, rng: np.random.Generator) -> np.ndarray:
    """Return (4,) a quaternion about a random axis, by a uniform angle up to `most_rad`."""
    axis, quaternion = rng.standard_normal(3), np.empty(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis / np.linalg.norm(axis), rng.uniform(0.0, most_rad))
    return quaternion
