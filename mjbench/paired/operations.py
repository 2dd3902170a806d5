"""What programs do with MuJoCo around `mj_step`, each ready to be timed in any release.

A block repeats an operation a fixed number of times, so that two releases do the same work. The
numbers are such that a block takes one to a few milliseconds, or as long as the operation does.
"""

import copy
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench import paths
from mjbench.errors import InputError, UnavailableError
from mjbench.paired.metrics import METRICS, Metric
from mjbench.simulation import compat, models, workload
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Product, Workload

_SEED = 0
# Rays start this high above the origin, and lie within a cone of this slope.
_RAY_HEIGHT_M, _RAY_SLOPE = 10.0, 0.1
# Metres, and metres between neighbours.
_GEOM_RADIUS_M, _GEOM_DISTANCE_M = 0.1, 1.0


@dataclass(frozen=True, eq=False)
class PreparedOperation:
    """An operation that can be timed at will.

    Attributes:
      result: does it once more; a vector of floats, which is to be the same in all releases.
    """

    run: Callable[[], None]
    result: Callable[[], np.ndarray]


# Takes a model, and how often a block does the operation.
Prepare = Callable[[ModelSource, int], PreparedOperation]


def load(source: ModelSource, repeats: int) -> PreparedOperation:
    file, load = str(source.path), mujoco.MjModel.from_xml_path
    models.load(source)  # says in one line what is wrong with it
    if source.path.suffix == ".mjb":
        raise InputError(f"{source.path.name} is compiled: loading is of a model's source")

    def run() -> None:
        for _ in range(repeats):
            load(file)

    return PreparedOperation(run, lambda: _sizes(load(file)))


def edit_spec(source: ModelSource, repeats: int) -> PreparedOperation:
    reason = compat.spec_unavailable()
    if reason:
        raise UnavailableError(reason)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE

    def build() -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        add_geom = spec.worldbody.add_geom
        for i in range(repeats):
            geom = add_geom()
            geom.type = sphere
            geom.size = [_GEOM_RADIUS_M, 0.0, 0.0]
            geom.pos = [_GEOM_DISTANCE_M * i, 0.0, 0.0]
        return spec.compile()

    def run() -> None:
        build()

    return PreparedOperation(run, lambda: _sizes(build()))


def create_data(source: ModelSource, repeats: int) -> PreparedOperation:
    model, create = models.load(source), mujoco.MjData

    def run() -> None:
        for _ in range(repeats):
            create(model)

    return PreparedOperation(run, lambda: _state(create(model)))


def copy_data(source: ModelSource, repeats: int) -> PreparedOperation:
    data = _stepped_data(models.load(source))
    duplicate = copy.copy

    def run() -> None:
        for _ in range(repeats):
            duplicate(data)

    return PreparedOperation(run, lambda: _state(duplicate(data)) - _state(data))


def reset(source: ModelSource, repeats: int) -> PreparedOperation:
    model = models.load(source)
    data, reset = _stepped_data(model), mujoco.mj_resetData

    def run() -> None:
        for _ in range(repeats):
            reset(model, data)

    def result() -> np.ndarray:
        reset(model, data)
        return _state(data)

    return PreparedOperation(run, result)


def cast_rays(source: ModelSource, repeats: int) -> PreparedOperation:
    model = models.load(source)
    data = workload.start_data(model)
    mujoco.mj_forward(model, data)
    origin = np.array([0.0, 0.0, _RAY_HEIGHT_M])
    slopes = np.random.default_rng(_SEED).uniform(-_RAY_SLOPE, _RAY_SLOPE, (repeats, 2))
    directions = [*np.column_stack([slopes, -np.ones(repeats)])]
    geomid, cast = np.zeros(1, dtype=np.int32), mujoco.mj_ray

    def run() -> None:
        for direction in directions:
            cast(model, data, origin, direction, None, 1, -1, geomid)

    def result() -> np.ndarray:
        distances = [cast(model, data, origin, d, None, 1, -1, geomid) for d in directions]
        return np.array(distances)

    return PreparedOperation(run, result)


# Steps of each simulation of a call; the fewer, the more of the time is the call itself.
_CALL_NSTEP = 5


def _call_path(
    name: str, options: Mapping[str, object], returns: Product, source: ModelSource, nbatch: int
) -> PreparedOperation:
    """Return one call of a path that steps `nbatch` simulations _CALL_NSTEP times."""
    model = models.load(source)
    work = _deterministic_work(model, nbatch, returns)
    path = paths.find(name)
    complete = path.complete(options)
    if reason := path.cannot_run(work, complete):
        raise UnavailableError(reason)
    prepared = path.prepare(work, complete, paths.Resources(work))

    def result() -> np.ndarray:
        fields = workload.fields(model, prepared.verified_states().values)
        return np.concatenate([fields[name].ravel() for name in ("qpos", "qvel")])

    return PreparedOperation(prepared.run, result)


_ROLLOUT = {"threads": 1, "pool": "kept"}
call_rollout = functools.partial(_call_path, "rollout", _ROLLOUT, Product.SENSORS)
call_batch = functools.partial(_call_path, "batch_rollout", {"threads": 1}, Product.FINAL)


def _deterministic_work(model: mujoco.MjModel, nbatch: int, returns: Product) -> Workload:
    """Return simulations whose start is computed without a step: the same in all releases."""
    rng = np.random.default_rng(_SEED)
    data = workload.start_data(model)
    starts = np.empty((nbatch, compat.state_size(model)))
    for row in starts:
        data.qvel[:] = rng.normal(0.0, workload.START_VELOCITY_SD, model.nv)
        compat.get_state(model, data, row)
    control = workload.random_controls(model, nbatch, _CALL_NSTEP, 1, rng, 1.0)
    return Workload(model, starts, control, 1, _SEED, returns)


def _stepped_data(model: mujoco.MjModel) -> mujoco.MjData:
    data = workload.start_data(model)
    mujoco.mj_step(model, data)
    return data


def _state(data: mujoco.MjData) -> np.ndarray:
    return np.concatenate([data.qpos, data.qvel, data.act])


def _sizes(model: mujoco.MjModel) -> np.ndarray:
    """Return what tells compiled models apart: sizes, masses, and the positions of all geoms."""
    sizes = [model.nq, model.nv, model.nu, model.nbody, model.njnt, model.ngeom, model.nmeshvert]
    return np.concatenate([sizes, model.body_mass, model.geom_pos.ravel()])


def prepare_of(metric: Metric) -> Prepare:
    """Return the function that prepares the operation of a metric, on any model."""
    prepare: Prepare = globals()[METRICS[metric].operation]
    return prepare
