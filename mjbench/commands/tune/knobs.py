"""The table of knobs: what `mjbench tune` may change, and to which values for a given model.

A knob offers values that differ from the model's own, that can have an effect on it, and that this
release has. To add one, write a row of KNOBS, and its name in `setting_names.GROUPS`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mjbench.commands.profile.step_parts import COLLISION, Stage
from mjbench.commands.tune import knob_values as values
from mjbench.commands.tune import model_features as features
from mjbench.commands.tune.setting_names import NAMES
from mjbench.commands.tune.settings import Setting
from mjbench.commands.tune.usual_regime import ObservedModel
from mjbench.errors import InputError, shown, suggestion

_CONSTRAINTS = (Stage.CONSTRAINT_MAKING, Stage.CONSTRAINT_PROJECTION, Stage.SOLVER)
_SOLVER = (Stage.SOLVER,)
_SLOW_SLIP = "what is held or stacked may slip over many seconds: let your longest task run"
# What a setting that acts on whole steps may gain, where nothing says more.
_UNKNOWN_GAIN = 0.25
# A setting that saves this share of the time by count is worth naming, though it is not timed.
_HALF = 0.5


@dataclass(frozen=True)
class Knob:
    """One thing to change.

    Attributes:
      name: that of its option or flag, where it is one.
      values: returns the settings worth trying.
      stages: of a step that it can speed up; empty for the whole step.
      changes: what it may change, in one short sentence.
      helps: why it can, where it is not for its stages, in a few words.
      slow: what it prevents that is slower than runs of a second show, in one short sentence.
      since: the first release that has it, or 2.3.7, the oldest that mjbench supports.
    """

    name: str
    values: Callable[[ObservedModel], Sequence[Setting]]
    stages: tuple[Stage, ...]
    changes: str
    helps: str = ""
    slow: str = ""
    since: str = "2.3.7"


def _has_constraints(observed: ObservedModel) -> bool:
    return observed.max_constraints > 0


def _has_contacts(observed: ObservedModel) -> bool:
    return observed.max_contacts > 0


def _is_convex(observed: ObservedModel) -> bool:
    return features.needs_convex_collider(observed.model)


def _has_signed_distances(observed: ObservedModel) -> bool:
    return features.has_signed_distances(observed.model)


# Of those that may save as much, the ones that most often help without a change of results first.
KNOBS: Sequence[Knob] = (
    Knob(
        "timer",
        values.clock_off,
        (),
        "Nothing but mjData.timer and the viewer's profiler.",
        "a step reads the timer of MuJoCo's Python package before and after every stage",
        since="3.3.1",
    ),
    Knob(
        "unused_features",
        values.unused_features,
        (),
        "Nothing, until the model or the program adds one: MuJoCo then ignores it.",
        "a step skips them",
    ),
    Knob("jacobian", values.jacobians, _CONSTRAINTS, "Nothing but rounding."),
    Knob(
        "excludes",
        values.excludes,
        COLLISION,
        "These bodies pass through each other, should they ever meet.",
    ),
    Knob(
        "island",
        values.flag("island", values.has_islands),
        _CONSTRAINTS,
        "Constraint forces, within the solver's tolerance if it converges.",
        since="3.0.0",
    ),
    Knob(
        "midphase",
        values.flag("midphase", lambda observed: features.has_compound_bodies(observed.model)),
        (Stage.COLLISION,),
        "Nothing but rounding.",
    ),
    Knob(
        "sleep",
        values.sleep,
        (),
        "Bodies that hardly move stop; states do not hold what sleeps, so a run's history counts.",
        "resting and static bodies are left out of a step",
        since="3.4.0",
    ),
    Knob(
        "nativeccd",
        values.flag("nativeccd", _is_convex),
        (Stage.NARROW_PHASE,),
        "Contacts of meshes, cylinders and ellipsoids: another algorithm.",
        since="3.2.3",
    ),
    Knob(
        "multiccd",
        values.disabled("multiccd", _is_convex),
        (*COLLISION, *_CONSTRAINTS),
        "Flat faces of meshes touch at one point instead of several.",
    ),
    Knob(
        "warmstart",
        values.flag("warmstart", _has_constraints),
        _SOLVER,
        "Constraint forces, within the solver's tolerance if it converges.",
    ),
    Knob(
        "eulerdamp",
        values.flag("eulerdamp", values.is_damped_euler),
        (Stage.INTEGRATION,),
        "Joint damping: explicit damping is less stable.",
        since="3.0.0",
    ),
    Knob(
        "tolerance",
        values.coarser("tolerance", (1e-8, 1e-6, 1e-5, 1e-4), _has_constraints),
        _SOLVER,
        "Constraint forces: the solver stops at the new tolerance.",
    ),
    Knob(
        "solver",
        values.keywords("solver", ("Newton", "CG", "PGS"), _has_constraints),
        _CONSTRAINTS,
        "Constraint forces, where the new solver converges less far.",
    ),
    Knob(
        "iterations",
        lambda o: values.bounds("iterations", o.solver, "solver iterations"),
        _SOLVER,
        "Constraint forces of the steps that need more iterations.",
    ),
    Knob(
        "ls_iterations",
        # not 1: a line search evaluates the cost twice in any case, so 1 does the same as 2
        lambda o: values.bounds("ls_iterations", o.line_search, "line-search iterations", least=2),
        _SOLVER,
        "Constraint forces of the steps that need longer line searches.",
    ),
    Knob(
        "noslip_iterations", values.no_noslip, _SOLVER, "Contacts may slip slowly.", slow=_SLOW_SLIP
    ),
    Knob(
        "ccd_iterations",
        values.fewer("ccd_iterations", (20, 10, 5), _is_convex),
        (Stage.NARROW_PHASE,),
        "Contacts of meshes, cylinders and ellipsoids that need more iterations.",
        since="3.2.3",
    ),
    Knob(
        "ccd_tolerance",
        values.coarser("ccd_tolerance", (1e-5, 1e-4, 1e-3), _is_convex),
        (Stage.NARROW_PHASE,),
        "Contacts of meshes, cylinders and ellipsoids, to the new tolerance.",
        since="3.2.3",
    ),
    Knob(
        "sdf_iterations",
        values.fewer("sdf_iterations", (5, 3), _has_signed_distances),
        (Stage.NARROW_PHASE,),
        "Contacts of signed distance fields are less exact.",
        since="3.0.0",
    ),
    Knob(
        "sdf_initpoints",
        values.fewer("sdf_initpoints", (20, 10, 5), _has_signed_distances),
        (Stage.NARROW_PHASE,),
        "Contacts of signed distance fields are fewer.",
        since="3.0.0",
    ),
    Knob(
        "maxhullvert",
        values.smaller_hulls,
        (Stage.NARROW_PHASE,),
        "Meshes collide as a coarser convex hull.",
        since="3.2.3",
    ),
    Knob(
        "tendons",
        values.no_unused_tendons,
        (Stage.KINEMATICS, Stage.TENDONS, Stage.VELOCITY),
        "Nothing but what is drawn and mjData's tendons; other tendons get new ids.",
        since="3.3.3",
    ),
    Knob(
        "autoreset",
        values.disabled("autoreset", loses="the reset of simulations that diverge"),
        (Stage.CHECKS,),
        "Nothing, unless a simulation diverges.",
        since="3.2.1",
    ),
    Knob(
        "override",
        values.disabled("override", _has_contacts),
        _CONSTRAINTS,
        "Contacts get the parameters of their geoms back.",
    ),
    Knob(
        "speculative",
        values.disabled("speculative", _has_contacts),
        (*COLLISION, *_CONSTRAINTS),
        "Fast bodies may pass through thin ones.",
        since="4.0.0",
    ),
    Knob(
        "diagexact",
        values.disabled("diagexact", _has_constraints),
        _CONSTRAINTS,
        "How soft constraints are.",
        since="3.9.0",
    ),
    Knob(
        "sensor",
        values.disabled("sensor", lambda o: o.model.nsensor > 0, loses="sensor data"),
        (Stage.SENSORS,),
        "Nothing but sensor data.",
    ),
    Knob(
        "energy",
        values.disabled("energy", loses="the energy in mjData"),
        (Stage.ENERGY,),
        "Nothing but mjData.energy.",
    ),
    Knob(
        "fwdinv",
        values.disabled("fwdinv", loses="the check of forward against inverse dynamics"),
        (Stage.OTHER,),
        "Nothing but mjData.solver_fwdinv.",
    ),
    Knob(
        "visual_geoms",
        values.no_visual_geoms,
        (Stage.KINEMATICS, Stage.SENSORS),
        "What is drawn and what rays hit; other geoms get new ids.",
    ),
    Knob(
        "fusestatic",
        values.fused_bodies,
        (Stage.KINEMATICS, Stage.INERTIA, Stage.VELOCITY),
        "Nothing but rounding; bodies without joints lose their names, others get new ids.",
    ),
    Knob(
        "engine_threads",
        values.threads,
        (),
        "Nothing but rounding; mujoco.rollout and Batch refuse such an MjData.",
        "several cores share a step",
        since="3.10.0",
    ),
    Knob(
        "integrator",
        values.integrators,
        (),
        "How positions and velocities advance: accuracy and stability.",
    ),
    Knob(
        "cone",
        values.keywords("cone", ("pyramidal", "elliptic"), _has_contacts),
        _CONSTRAINTS,
        "Friction forces: the other cone is another model of friction.",
        slow=_SLOW_SLIP,
    ),
    Knob(
        "timestep",
        values.timesteps,
        (),
        "All motion: integration errors grow; contacts stiffer than two timesteps become softer.",
        "fewer steps per simulated second",
    ),
)


def settings(observed: ObservedModel) -> dict[str, tuple[Setting, ...]]:
    offered = {knob.name: tuple(knob.values(observed)) for knob in KNOBS}
    return {name: some for name, some in offered.items() if some}


def counted_gain(setting: Setting, stages: Mapping[str, float]) -> float:
    """Return the share of the time that a setting saves by count; 0 where that is not known."""
    if not setting.stages:
        return setting.saves
    return setting.saves * sum(stages.get(stage, 0.0) for stage in setting.stages)


def halves(setting: Setting, stages: Mapping[str, float]) -> bool:
    """Return whether a setting saves half of a step or more by count."""
    return counted_gain(setting, stages) >= _HALF


def order(setting: Setting, stages: Mapping[str, float]) -> tuple[float, float]:
    """Return what sorts settings: those that halve the time by count, then by what may be saved."""
    counted, knob = counted_gain(setting, stages), find(setting.knob)
    at_most = sum(stages.get(stage, 0.0) for stage in knob.stages) if stages else 0.0
    is_known = counted or (knob.stages and stages)
    may_save = max(counted, at_most) if is_known else _UNKNOWN_GAIN
    return (-counted if counted >= _HALF else 0.0), -may_save


def find(name: str) -> Knob:
    """Return a knob by its name; InputError for any other name, which a run file may have."""
    for knob in KNOBS:
        if knob.name == name:
            return knob
    raise InputError(f"no setting {shown(name)}{suggestion(name, NAMES)}")
