"""Ray actors: processes that Ray starts, each with its own MjModel and MjData.

A run sends each actor the start states and controls of its share, and copies what comes back to
arrays. Both travel by Ray's object store where they are large, and with the call where they are
small.

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
from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.paths.python_loop import PythonLoopHold
from mjbench.paths.rollout import Rollout, changed_inputs, inputs_snippet
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


class _Actor:
    """What an actor's process holds: its share of a workload, and a prepared run of it."""

    def __init__(
        self,
        path: SteppingPath,
        model: mujoco.MjModel,
        initial_state: np.ndarray,
        control: np.ndarray,
        hold: int,
        returns: Product,
    ):
        # copies, because the arrays that Ray sends are read-only
        start, controls = initial_state.copy(), control.copy()
        self._workload = Workload(model, start, controls, hold, seed=0, returns=returns)
        self._resources = Resources(self._workload)
        self._prepared = path.prepare(self._workload, path.complete({}), self._resources)

    def engine(self) -> tuple[str, str]:
        """Return the release of MuJoCo, and the file that it was imported from."""
        return _engine()

    def step(self, initial_state: np.ndarray, control: np.ndarray) -> tuple[States, StepOutputs]:
        """Step from these states; return the final ones, and what is recorded of every step."""
        self._load(initial_state, control)
        self._prepared.run()
        return self._prepared.final_states(), self._resources.step_outputs()

    def verify(self, initial_state: np.ndarray, control: np.ndarray) -> np.ndarray:
        """Step from these states; return (n, nstate) final states in full."""
        self._load(initial_state, control)
        return self._prepared.verified_states().values

    def _load(self, initial_state: np.ndarray, control: np.ndarray) -> None:
        self._workload.initial_state[...] = initial_state
        self._workload.control[...] = control
        self._resources.changed()


class _ActorPool:
    """Started actors, and the arrays that what they return is copied to."""

    def __init__(self, workload: Workload, count: int, resources: Resources):
        self.outputs = resources.step_outputs()
        self._workload, self._final_state = workload, resources.final_state()
        self._mask = np.zeros(self._final_state.shape, dtype=bool)
        self._rows = shares(workload.nbatch, count)
        sizes = (workload.initial_state, workload.control, self._final_state, *self.outputs.arrays)
        local_ray.acquire(_STORE_MARGIN * sum(array.nbytes for array in sizes))
        self._actors: list[Any] = []
        self._is_closed = False
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def _start(self) -> None:
        import ray

        own, create = self._workload, ray.remote(num_cpus=0)(_Actor)
        path = PythonLoopHold() if compat.rollout_unavailable() else Rollout()
        model = ray.put(own.model)
        for rows in self._rows:
            arrays = own.initial_state[rows], own.control[rows]
            self._actors.append(create.remote(path, model, *arrays, own.hold, own.returns))
        for engine in _answers([actor.engine.remote() for actor in self._actors], _START_LIMIT_S):
            if engine != _engine():
                raise MachineError(f"an actor imports MuJoCo {engine}, this process {_engine()}")

    def run(self) -> None:
        """Let every actor step its share, and copy what it returns."""
        calls = self._calls("step")
        for rows, (states, outputs) in zip(self._rows, _answers(calls), strict=True):
            self._final_state[rows] = states.values
            self._mask[rows] = True if states.mask is None else states.mask
            own = self.outputs.part(rows)
            for array, returned in zip(own.arrays, outputs.arrays, strict=True):
                array[...] = returned

    def _calls(self, method: str) -> list[Any]:
        """Call a method of every actor with the start states and controls of its share."""
        workload = self._workload
        return [
            getattr(actor, method).remote(workload.initial_state[rows], workload.control[rows])
            for actor, rows in zip(self._actors, self._rows, strict=True)
        ]

    def clear(self) -> None:
        """Invalidate what an earlier run returned."""
        self._final_state.fill(np.nan)
        self.outputs.clear()

    def final_states(self) -> States:
        """Return the returned entries of the final states."""
        return States(self._final_state, self._mask)

    def verify(self) -> States:
        """Run, and have actors verify the entries that no run returns."""
        alone = np.concatenate(_answers(self._calls("verify")))
        self.clear()
        self.run()
        return States(np.where(self._mask, self._final_state, alone))

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
    """Return what calls of actors return.

    Args:
      limit_s: seconds to wait; None for any time.

    Raises:
      MachineError: an actor's process ended, or it raised an exception.
    """
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
    """Return the release of MuJoCo, and the file that it was imported from."""
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
