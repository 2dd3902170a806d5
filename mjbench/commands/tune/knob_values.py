"""Which values of a knob are worth trying on a model.

Every function here returns settings that differ from the model's own value, and none where the
model or this release has no use for them.
"""

import copy
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from mjbench.commands.profile import model_costs
from mjbench.commands.profile.evaluations import Evaluations
from mjbench.commands.tune import model_features as features
from mjbench.commands.tune.settings import Edit, LoopChange, Part, Setting, option
from mjbench.commands.tune.usual_regime import ObservedModel, Usage
from mjbench.formats import count_of
from mjbench.host import topology
from mjbench.simulation import compat, model_options
from mjbench.simulation.engine_clock import has_clock
from mjbench.simulation.workload import start_data

Values = Callable[[ObservedModel], list[Setting]]
Condition = Callable[[ObservedModel], bool]

# Integrators that are faster than each one, or about as fast, by MJCF's keyword. RK4 evaluates the
# dynamics four times; `implicit` factorises an asymmetric matrix, `implicitfast` a symmetric one.
_FAST = ("Euler", "implicitfast", "discrete")
_FASTER_INTEGRATORS = {
    "Euler": _FAST,
    "implicitfast": _FAST,
    "discrete": (*_FAST, "implicit"),
    "implicit": _FAST,
    "RK4": (*_FAST, "implicit"),
}
# A timestep up to this one, MJCF's own, is no larger than usual.
_USUAL_TIMESTEP_S = 0.002
# A convex hull of more vertices has more than its shape needs; and how many to try.
_MANY_VERTICES, _FEW_VERTICES = 500, 64
# From so many degrees of freedom on, `jacobian="auto"` is sparse (mj_isSparse).
_AUTO_SPARSE_NV = 60
_TIMESTEP_FACTORS = (2, 4, 8)


def _always(_: ObservedModel) -> bool:
    return True


# -- options ------------------------------------------------------------------------------------


def keywords(name: str, choices: Sequence[str], applies: Condition = _always) -> Values:
    """Return what offers an option's other keywords, where they apply and the engine takes them."""

    def values(observed: ObservedModel) -> list[Setting]:
        if not applies(observed):
            return []
        present = keyword(observed.model, name)
        return [
            option(name, choice)
            for choice in choices
            if choice.lower() != present and _is_accepted(observed.model, name, choice)
        ]

    return values


def integrators(observed: ObservedModel) -> list[Setting]:
    present = keyword(observed.model, "integrator")
    faster = {each.lower(): others for each, others in _FASTER_INTEGRATORS.items()}
    others = keywords("integrator", faster.get(present, ()))(observed)
    evaluations = Evaluations.of(observed.model).of_step
    if evaluations == 1:
        return others
    evidence = f"one evaluation of the dynamics a step, where RK4 makes {evaluations}"
    return [replace(each, evidence=evidence, saves=1 - 1 / evaluations) for each in others]


def jacobians(observed: ObservedModel) -> list[Setting]:
    model = observed.model
    if not observed.max_constraints:
        return []
    present = keyword(model, "jacobian")
    if present == "auto":
        present = "sparse" if model.nv >= _AUTO_SPARSE_NV else "dense"
    return [option("jacobian", "dense" if present == "sparse" else "sparse")]


def timesteps(observed: ObservedModel) -> list[Setting]:
    """Return multiples of the timestep: powers of 2, so that grids of controls stay aligned."""
    timestep_s = float(observed.model.opt.timestep)
    return [
        option(
            "timestep",
            repr(each_s),
            f"{1 / timestep_s:.0f} steps a simulated second" if each_s <= _USUAL_TIMESTEP_S else "",
            saves=1 - timestep_s / each_s,
        )
        for each_s in (factor * timestep_s for factor in _TIMESTEP_FACTORS)
    ]


def no_noslip(observed: ObservedModel) -> list[Setting]:
    count, median = int(observed.model.opt.noslip_iterations), observed.solver.median
    if not count or not observed.max_constraints:
        return []
    evidence = f"up to {count} iterations a step against slip"
    saves = min(count, median - 1) / median if median else 0.0  # the engine counts both as one
    setting = option("noslip_iterations", "0", evidence, saves)
    return [replace(setting, stages=("constraint solver",))]


def fewer(name: str, choices: Iterable[int], applies: Condition) -> Values:
    return _compared(name, choices, applies, operator.lt)


def coarser(name: str, choices: Iterable[float], applies: Condition) -> Values:
    return _compared(name, choices, applies, operator.gt)


def _compared(
    name: str,
    choices: Iterable[float],
    applies: Condition,
    is_cheaper: Callable[[float, float], bool],
) -> Values:
    def values(observed: ObservedModel) -> list[Setting]:
        present = getattr(observed.model.opt, name, None)
        if present is None or not applies(observed):
            return []
        return [option(name, f"{c:g}") for c in choices if is_cheaper(c, float(present))]

    return values


def bounds(name: str, used: Usage, what: str, least: int = 1) -> list[Setting]:
    """Return powers of 2 below what steps used: larger bounds bind nowhere."""
    evidence = f"observed steps take {used.median} {what} in the median and {used.most} at most"
    powers = (2**k for k in range(used.most.bit_length()))
    return [option(name, str(power), evidence) for power in powers if least <= power < used.most]


def keyword(model: mujoco.MjModel, name: str) -> str:
    enum, prefix = model_options.ENUMS[name]
    return compat.enum_name(getattr(mujoco, enum), getattr(model.opt, name), prefix)


def _is_accepted(model: mujoco.MjModel, name: str, choice: str) -> bool:
    enum, prefix = model_options.ENUMS[name]
    value = getattr(getattr(mujoco, enum), prefix + choice.upper(), None)
    if value is None:
        return False
    changed = copy.copy(model)
    setattr(changed.opt, name, int(value))
    return _can_step(changed)


def _can_step(model: mujoco.MjModel) -> bool:
    try:
        mujoco.mj_step(model, start_data(model))
    except mujoco.FatalError:
        return False
    return True


# -- flags --------------------------------------------------------------------------------------


def flag(name: str, applies: Condition = _always, loses: str = "") -> Values:
    def values(observed: ObservedModel) -> list[Setting]:
        enabled = compat.flag_enabled(observed.model, name)
        if enabled is None or not applies(observed):
            return []
        changed, value = copy.copy(observed.model), "disable" if enabled else "enable"
        model_options.set_flag(changed.opt, name, value)
        if not _can_step(changed):
            return []
        return [Setting(name, f"{name}={value}", (Edit(Part.FLAG, name, value),), loses=loses)]

    return values


def disabled(name: str, applies: Condition = _always, loses: str = "") -> Values:
    other = flag(name, applies, loses)
    return lambda o: other(o) if compat.flag_enabled(o.model, name) else []


def sleep(observed: ObservedModel) -> list[Setting]:
    """Return sleep, where bodies may sleep, or where most geoms are static: it skips those."""
    model = observed.model
    if not (count := model_costs.static_geoms(model)):
        return flag("sleep", lambda _: features.can_sleep(model))(observed)
    evidence = f"{count} of {model.ngeom} geoms are static, and skipped with it"
    return [
        replace(each, evidence=evidence, saves=count / model.ngeom, stages=("kinematics",))
        for each in flag("sleep")(observed)
    ]


def has_islands(observed: ObservedModel) -> bool:
    """Return whether constraints may be solved island by island: PGS solves all together."""
    return observed.max_constraints > 0 and keyword(observed.model, "solver") != "pgs"


def is_damped_euler(observed: ObservedModel) -> bool:
    is_euler = keyword(observed.model, "integrator") == "euler"
    return is_euler and bool(np.any(observed.model.dof_damping))


def unused_features(observed: ObservedModel) -> list[Setting]:
    names = features.absent(observed.model)
    absent = [flag for flag in names if compat.flag_enabled(observed.model, flag)]
    if not absent:
        return []
    edits = tuple(Edit(Part.FLAG, flag, "disable") for flag in absent)
    evidence = f"the model has no {', no '.join(names[flag] for flag in absent)}"
    return [Setting("unused_features", "unused features off", edits, evidence=evidence)]


# -- what only MJCF can say ---------------------------------------------------------------------


def excludes(observed: ObservedModel) -> list[Setting]:
    pairs = observed.idle_pairs
    if not pairs or not observed.is_mjcf:
        return []
    edits = tuple(Edit(Part.EXCLUDE, pair.body1, pair.body2) for pair in pairs)
    count = count_of(len(pairs), "pair")
    return [Setting("excludes", f"exclude {count}", edits, evidence=_never_touched(observed))]


def no_visual_geoms(observed: ObservedModel) -> list[Setting]:
    count = features.drawn_geoms(observed.model)
    if not count or not observed.is_mjcf:
        return []
    edits = (Edit(Part.COMPILER, "discardvisual", "true"),)
    loses = "geoms that are only drawn"
    evidence = f"{count} geom{' is' if count == 1 else 's are'} only drawn"
    return [Setting("visual_geoms", "discardvisual=true", edits, loses=loses, evidence=evidence)]


def fused_bodies(observed: ObservedModel) -> list[Setting]:
    """Return the model with bodies that cannot move in their parents merged into them."""
    model = observed.model
    is_fixed = (np.asarray(model.body_jntnum) == 0) & (np.asarray(model.body_mocapid) < 0)
    count = int(is_fixed[1:].sum())  # the first body is the world
    if not count or not observed.is_mjcf:
        return []
    edits = (Edit(Part.COMPILER, "fusestatic", "true"),)
    evidence = f"{count} of {model.nbody - 1} bodies have no joint"
    return [Setting("fusestatic", "fusestatic=true", edits, evidence=evidence)]


def no_unused_tendons(observed: ObservedModel) -> list[Setting]:
    """Return the model without the tendons that nothing uses."""
    names, count = features.unused_tendons(observed.model), observed.model.ntendon
    if not names or not observed.is_mjcf:
        return []
    edits = tuple(Edit(Part.TENDON, name, "") for name in names)
    evidence = f"nothing uses {len(names)} of {count_of(count, 'tendon')}"
    label = f"without {count_of(len(names), 'unused tendon')}"
    return [Setting("tendons", label, edits, evidence=evidence)]


def smaller_hulls(observed: ObservedModel) -> list[Setting]:
    count = features.hull_vertices(observed.model)
    if count <= _MANY_VERTICES or not observed.is_mjcf:
        return []
    edits = (Edit(Part.MESHES, "maxhullvert", str(_FEW_VERTICES)),)
    evidence = f"the convex hull of a mesh that collides has {count} vertices"
    return [Setting("maxhullvert", f"maxhullvert={_FEW_VERTICES}", edits, evidence=evidence)]


def _never_touched(observed: ObservedModel) -> str:
    pairs = observed.idle_pairs
    seen = f"in {observed.simulated_s:.3g} s of simulation"
    if observed.nposes:
        seen += f" and {observed.nposes} random poses"
    closest_m = [pair.closest_m for pair in pairs if pair.closest_m is not None]
    nearest = f"; the closest came within {min(closest_m):.2g} m" if closest_m else ""
    unnamed = observed.unnamed_idle_pairs
    more = f"; {unnamed} more cannot be excluded, as a body has no name" if unnamed else ""
    return f"{count_of(len(pairs), 'pair')} never touched {seen}{nearest}{more}"


# -- the loop -----------------------------------------------------------------------------------


def clock_off(observed: ObservedModel) -> list[Setting]:
    """Return the loop without the timer of MuJoCo's Python package, where it installs one."""
    if not has_clock(observed.model):
        return []
    return [Setting("timer", "timer off", loop=LoopChange(is_clock_off=True))]


def threads(observed: ObservedModel) -> list[Setting]:
    """Return thread pools within one simulation, of the sizes at which cores run out."""
    if compat.threadpool_unavailable() is not None:
        return []
    counts = [count for count in topology.read().thread_counts() if count > 1]
    return [
        Setting("engine_threads", f"engine threads={n}", loop=LoopChange(engine_threads=n))
        for n in counts
    ]
