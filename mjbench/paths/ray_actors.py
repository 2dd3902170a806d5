"""Ray actors: processes that Ray starts, each with its own MjModel and MjData.

A run sends each actor the start states and controls of its share, and copies what comes back to
arrays. Both travel by Ray's object store where they are large, and with the call where they are
small. An actor keeps nothing but the model, and memory to step in.

Ray is started on this machine (see `local_ray`), also where RAY_ADDRESS names a cluster.
"""

import textwrap
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from mjbench import extras
from mjbench.errors import MachineError, describe, one_line
from mjbench.paths import local_ray, snippets
from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    States,
    SteppingPath,
    make_simulate,
)
from mjbench.paths.rollout import (
    RolloutInputs,
    changed_inputs,
    inputs_snippet,
    shared_inputs,
    whole_final_states,
)
from mjbench.paths.threads import shares
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, StepOutputs, Workload

_START_LIMIT_S = 60.0
# Size of the object store, as a multiple of what a run sends and returns.
_STORE_MARGIN = 4


class Ray(SteppingPath):
    """Actors that each step their share of the simulations, by `mujoco.rollout` on one thread.

    Where this release has no rollout of full physics states, actors run a Python loop.
    """

    name = "ray"
    summary = "Ray actors, each with mujoco.rollout over its share"
    title = "Ray actors"
    closed_loop = False
    usual = False
    starts_slowly = True
    products = tuple(Product)
    options = (Option("actors", "Ray actors, a process each", (), int),)

    def unavailable(self) -> str | None:
        if extras.missing(("ray",)):
            return f"needs ray: {extras.install_command('ray')}"
        return None

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        count = options["actors"]
        pool: _ActorPool = resources.get_or_create(
            ("actors", count), lambda: _ActorPool(workload, count, resources)
        )
        resources.at_close(pool.close)
        is_final = workload.returns == Product.FINAL
        return Prepared(
            pool.run,
            pool.clear,
            pool.final_states,
            pool.verify,
            step_outputs=None if is_final else lambda: pool.outputs,
        )

    def snippet(self, workload: Workload, options: Options) -> str:
        names = ", ".join(("final_state", *snippets.output_names(workload)))
        is_final = workload.returns == Product.FINAL
        gather = "np.concatenate(" if is_final else "map(np.concatenate, zip(*"
        fields = {
            "actors": options["actors"],
            "names": names,
            "gather": f"{names} = {gather}ray.get(calls){')' if is_final else '))'}",
        }
        if compat.rollout_unavailable():
            return _LOOP_SNIPPET.format(
                **fields,
                allocate=textwrap.indent(snippets.allocation(workload), " " * 8),
                count=snippets.counter(workload, indent=12),
                step=snippets.data_steps(workload, indent=16, row="i"),
            )
        step = _ROLLOUT_SENSORS if workload.returns == Product.SENSORS else _ROLLOUT_STATE
        return _ROLLOUT_SNIPPET.format(
            **fields,
            prepare=inputs_snippet(workload),
            rollout=step.format(
                spec=", control_spec=int(spec)" if changed_inputs(workload) else ""
            ),
            returned=names.replace("final_state", "state[:, -1]"),
        )


# What an actor steps from: of a rollout, or start states and controls for a loop.
_Inputs = RolloutInputs | tuple[np.ndarray, np.ndarray]


class _Actor:
    def __init__(self, model: mujoco.MjModel, nstep: int, hold: int, returns: Product):
        self._model, self._nstep, self._hold, self._returns = model, nstep, hold, returns
        self._data = mujoco.MjData(model)
        self._simulate = make_simulate(model, hold, returns)

    def engine(self) -> tuple[str, str]:
        return _engine()

    def step(self, inputs: _Inputs) -> tuple[np.ndarray, ...]:
        """Step simulations; return their final states, and what a run returns of every step.

        Final states are of mjSTATE_FULLPHYSICS after a rollout, else of mjSTATE_INTEGRATION.
        """
        if isinstance(inputs, RolloutInputs):
            return self._roll_out(inputs)
        initial_state, control = inputs
        final_state = np.empty_like(initial_state)
        own = Workload(self._model, initial_state, control, self._hold, 0, self._returns)
        outputs = StepOutputs.empty(own)
        self._simulate(self._data, initial_state, control, final_state, outputs)
        return (final_state, *outputs.arrays)

    def _roll_out(self, inputs: RolloutInputs) -> tuple[np.ndarray, ...]:
        from mujoco import rollout

        n, nphysics = inputs.start.shape
        has_threads, has_sensors = compat.rollout_threads(), self._returns == Product.SENSORS
        state = np.empty((n, self._nstep, nphysics))
        sensordata = np.empty((n, self._nstep, self._model.nsensordata)) if has_sensors else None
        rollout.rollout(
            [self._model] * n if has_threads else self._model,
            [self._data] if has_threads else self._data,
            inputs.start,
            inputs.control,
            control_spec=inputs.control_spec,
            nstep=self._nstep,
            initial_warmstart=inputs.warmstart,
            state=state,
            sensordata=sensordata,
            skip_checks=not has_sensors,
        )
        outputs = StepOutputs(None if self._returns == Product.FINAL else state, sensordata)
        return (state[:, -1], *outputs.arrays)

    def whole_final_states(self, inputs: _Inputs) -> np.ndarray:
        """Step simulations; return (n, nstate) final states in full."""
        if isinstance(inputs, RolloutInputs):
            return whole_final_states(self._model, self._data, inputs, self._nstep)
        return self.step(inputs)[0]


class _ActorPool:
    def __init__(self, workload: Workload, count: int, resources: Resources):
        self.outputs, self._final_state = resources.step_outputs(), resources.final_state()
        self._rows = shares(workload.nbatch, count)
        self._inputs: list[_Inputs]
        if compat.rollout_unavailable():
            self._entries = np.arange(self._final_state.shape[1])
            self._inputs = [(workload.initial_state[r], workload.control[r]) for r in self._rows]
        else:
            self._entries = compat.physics_entries(workload.model)
            inputs = shared_inputs(workload, resources)
            self._inputs = [inputs.part(rows) for rows in self._rows]
        self._returned_final = np.empty((workload.nbatch, len(self._entries)))
        self._returned = (self._returned_final, *self.outputs.arrays)
        sizes = (workload.initial_state, workload.step_control, *self._returned)
        local_ray.acquire(_STORE_MARGIN * sum(array.nbytes for array in sizes))
        self._actors: list[Any] = []
        self._is_closed = False
        try:
            self._start(workload)
        except BaseException:
            self.close()
            raise

    def _start(self, workload: Workload) -> None:
        import ray

        arguments = (ray.put(workload.model), workload.nstep, workload.hold, workload.returns)
        create = ray.remote(num_cpus=0)(_Actor)
        self._actors += [create.remote(*arguments) for _ in self._rows]
        for engine in _answers([actor.engine.remote() for actor in self._actors], _START_LIMIT_S):
            if engine != _engine():
                raise MachineError(f"an actor imports MuJoCo {engine}, this process {_engine()}")

    def run(self) -> None:
        calls = [
            actor.step.remote(inputs)
            for actor, inputs in zip(self._actors, self._inputs, strict=True)
        ]
        for rows, arrays in zip(self._rows, _answers(calls), strict=True):
            for own, part in zip(self._returned, arrays, strict=True):
                own[rows] = part

    def clear(self) -> None:
        for array in self._returned:
            array.fill(np.nan)

    def final_states(self) -> States:
        return States.of_entries(self._final_state, self._entries, self._returned_final)

    def verify(self) -> States:
        """Run, and have each simulation stepped alone for the entries that no run returns."""
        self.clear()
        self.run()
        timed = self.final_states()
        calls = [
            actor.whole_final_states.remote(inputs)
            for actor, inputs in zip(self._actors, self._inputs, strict=True)
        ]
        return timed.completed(np.concatenate(_answers(calls)))

    def close(self) -> None:
        """End the actors, and Ray where nobody else in this process uses it."""
        if self._is_closed:
            return
        import ray

        self._is_closed = True
        for actor in self._actors:
            ray.kill(actor)
        self._actors.clear()
        local_ray.release()


def _answers(calls: Sequence[Any], limit_s: float | None = None) -> list[Any]:
    """Return what calls of actors return; MachineError if one ended or raised. None: no limit."""
    import ray
    from ray import exceptions

    try:
        return ray.get(list(calls), timeout=limit_s)  # type: ignore[no-any-return]
    except exceptions.GetTimeoutError as error:
        raise MachineError(f"an actor did not start within {_START_LIMIT_S:.0f} s") from error
    except exceptions.RayActorError as error:
        cause = ""
        if error.actor_init_failed:
            cause = f" when it started: {one_line(str(error).strip().splitlines()[-1])}"
        raise MachineError(f"the process of an actor ended{cause}") from error
    except exceptions.RayTaskError as error:
        raise MachineError(f"an actor failed: {describe(error.cause)}") from error


def _engine() -> tuple[str, str]:
    return mujoco.__version__, mujoco.__file__


_ROLLOUT_SNIPPET = """\
import mujoco
import numpy as np
import ray
from mujoco import rollout

ray.init(num_cpus={actors})  # or address="auto" for the cluster of this machine
full = mujoco.mjtState.mjSTATE_INTEGRATION
physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
data = [mujoco.MjData(model)]
{prepare}
@ray.remote(num_cpus=1)
class Stepper:
    def __init__(self, model):
        self.model, self.data = model, [mujoco.MjData(model)]

    def step(self, start, warmstart, control):
{rollout}        return {returned}

its_model = ray.put(model)
steppers = [Stepper.remote(its_model) for _ in range({actors})]
arrays = np.array(start), np.array(warmstart), control
parts = [np.array_split(array, {actors}) for array in arrays]
calls = [stepper.step.remote(*part) for stepper, *part in zip(steppers, *parts)]
{gather}
ray.shutdown()
"""

# skip_checks=True leaves out sensor data, unless there is an array for them
_ROLLOUT_STATE = """\
        n, nstep = control.shape[:2]
        state = np.empty((n, nstep, start.shape[1]))
        rollout.rollout(
            [self.model] * n, self.data, start, control if control.size else None, nstep=nstep,
            initial_warmstart=warmstart, state=state, skip_checks=True{spec})
"""

_ROLLOUT_SENSORS = """\
        state, sensordata = rollout.rollout(
            self.model, self.data, start, control if control.size else None,
            nstep=control.shape[1], initial_warmstart=warmstart{spec})
"""

_LOOP_SNIPPET = """\
import mujoco
import numpy as np
import ray

ray.init(num_cpus={actors})  # or address="auto" for the cluster of this machine

@ray.remote(num_cpus=1)
class Stepper:
    def __init__(self, model):
        self.model, self.data = model, mujoco.MjData(model)

    def step(self, initial_state, control):
        model, data = self.model, self.data
        full = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        final_state = np.empty_like(initial_state)
{allocate}        for i, row in enumerate(initial_state):
            mujoco.mj_setState(model, data, row, full)
{count}            for u in control[i]:  # or u = policy(data)
                data.ctrl[:] = u
{step}            mujoco.mj_getState(model, data, final_state[i], full)
        return {names}

its_model = ray.put(model)
steppers = [Stepper.remote(its_model) for _ in range({actors})]
parts = [np.array_split(array, {actors}) for array in (initial_state, control)]
calls = [stepper.step.remote(*part) for stepper, *part in zip(steppers, *parts)]
{gather}
ray.shutdown()
"""
