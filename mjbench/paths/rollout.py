"""`mujoco.rollout`: open-loop trajectories, in C, on threads."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.paths.rollout_inputs import RolloutInputs, changed_inputs, make_inputs
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload


class Rollout(SteppingPath):
    """`mujoco.rollout.rollout` into arrays allocated beforehand.

    By default it returns the full-physics states after every step. With `returns=nothing` the
    MjData of each thread holds the last state of the simulation that the thread ran last.

    No output holds the warm-start. A timed call is therefore compared on everything that it returns
    and on the states that its MjData hold. `verify` runs every simulation alone, so that its whole
    state is in the MjData.
    """

    name = "rollout"
    summary = "mujoco.rollout, open loop, states of every step returned"
    closed_loop = False
    options = (
        Option("threads", "threads, an MjData each", (), int),
        Option("chunk", "simulations a thread takes at a time", (None,), int),
        Option(
            "pool",
            "thread pool kept between calls, or new with each",
            ("kept", "new"),
            str,
            ("kept", "new"),
        ),
        Option("checks", "shapes and types checked by each call", ("on",), str, ("on", "off")),
        Option(
            "returns",
            "states and sensors of every step, or nothing (implies checks=off)",
            ("states",),
            str,
            ("states", "nothing"),
        ),
    )

    def unavailable(self) -> str | None:
        """See `SteppingPath.unavailable`."""
        return compat.rollout_unavailable()

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """See `SteppingPath.unsuited`."""
        return compat.rollout_threads_unavailable() if options["threads"] > 1 else None

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        """See `SteppingPath.simplified`: one thread has neither pool nor chunks."""
        if options["threads"] == 1:
            options = {**options, "pool": None, "chunk": None}
        if options["checks"] == "on" or options["returns"] == "nothing":
            options = {**options, "checks": None}
        if options["returns"] == "states":
            options = {**options, "returns": None}
        return super().simplified(options)

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        return _RolloutRun(workload, options, resources).prepared()

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        hold = workload.hold
        arguments = []
        if options.get("chunk"):
            arguments.append(f"chunk_size={options['chunk']}")
        if options.get("pool") == "kept":
            arguments.append("persistent_pool=True")
        prepare = _SNIPPET_NOTHING if options.get("returns") == "nothing" else ""
        if hold > 1:
            prepare += f"control = np.repeat(control, {hold}, axis=1)\n"
        inputs = changed_inputs(workload)
        if inputs:
            bits = "".join(f" | mujoco.mjtState.mjSTATE_{name}" for name in inputs)
            prepare += _SNIPPET_INPUTS.format(bits=bits)
            arguments.append("control_spec=int(spec)")
        extra = "".join(f", {argument}" for argument in arguments)
        return _SNIPPET.format(threads=options["threads"], extra=extra, prepare=prepare)


class _RolloutRun:
    """The arrays and MjData of one variant, and how to read its final states."""

    def __init__(self, workload: Workload, options: Options, resources: Resources):
        self.workload, self.model = workload, workload.model
        self.spec = compat.state_spec("INTEGRATION")
        self.physics = compat.physics_entries(self.model)
        self.inputs: RolloutInputs = resources.get_or_create(
            "rollout inputs", lambda: make_inputs(workload, self.physics)
        )
        shape = (workload.nbatch, workload.nstep)
        self.state = resources.get_or_create(
            "rollout state", lambda: np.empty((*shape, len(self.physics)))
        )
        self.sensordata = resources.get_or_create(
            "rollout sensordata", lambda: np.empty((*shape, self.model.nsensordata))
        )
        self.datas = resources.datas(options["threads"])
        self.final_state = resources.final_state()
        self.returns_states = options.get("returns") != "nothing"
        # (nbatch, nstate) final states of the last `verify`; none before it
        self.verified = np.empty((0, self.final_state.shape[1]))
        self.run = self._timed_call(options, resources)

    def prepared(self) -> Prepared:
        """Return the run."""
        return Prepared(self.run, self.clear, self.final_states, self.verify)

    def _timed_call(self, options: Options, resources: Resources) -> Callable[[], None]:
        """Return the function whose one call is the timed region."""
        start, control = self.inputs.start, self.inputs.control
        keywords: dict[str, Any] = {
            "control_spec": self.inputs.control_spec,
            "nstep": self.workload.nstep,
            "initial_warmstart": self.inputs.warmstart,
            "state": self.state if self.returns_states else None,
            "sensordata": self.sensordata if self.returns_states else None,
        }
        model: mujoco.MjModel | list[mujoco.MjModel] = self.model
        if options.get("checks") == "off" or not self.returns_states:
            keywords["skip_checks"] = True
            if compat.rollout_threads():
                model = [self.model] * self.workload.nbatch
        if options.get("chunk"):
            keywords["chunk_size"] = options["chunk"]
        has_threads = compat.rollout_threads()
        data: mujoco.MjData | list[mujoco.MjData] = self.datas if has_threads else self.datas[0]
        function = _rollout_function(options, resources)

        def run() -> None:
            function(model, data, start, control, **keywords)

        return run

    def clear(self) -> None:
        """Invalidate the states that an earlier call returned, or left in the MjData."""
        if self.returns_states:
            self.state[:, -1] = np.nan
        else:
            for data in self.datas:
                mujoco.mj_resetData(self.model, data)

    def final_states(self) -> States:
        """Return the returned states, and the whole state of each thread's last simulation."""
        return self._returned_states() if self.returns_states else self._states_in_data()

    def _states_in_data(self) -> States:
        """Return the whole state of each thread's last simulation.

        Nothing says which simulation that was, so each state is attributed to the verified state
        that equals it. A state that equals none is attributed to the last simulation, where the
        comparison with the reference then fails.
        """
        values, mask = self.final_state, np.zeros(self.final_state.shape, dtype=bool)
        row = np.empty(values.shape[1])
        for data in self.datas:
            if data.time == 0.0:  # unchanged since `clear`: the thread ran no simulation
                continue
            compat.get_state(self.model, data, row, self.spec)
            matches = np.flatnonzero(_equal_rows(self.verified, row))
            simulation = int(matches[-1]) if len(matches) else self.workload.nbatch - 1
            values[simulation], mask[simulation] = row, True
        if not mask.any():
            values[-1], mask[-1] = np.nan, True
        return States(values, mask)

    def _returned_states(self) -> States:
        values, mask = self.final_state, np.zeros(self.final_state.shape, dtype=bool)
        values[:, self.physics] = self.state[:, -1]
        mask[:, self.physics] = True
        row = np.empty(values.shape[1])
        for data in self.datas:
            compat.get_state(self.model, data, row, self.spec)
            matches = np.flatnonzero(_equal_rows(values[:, self.physics], row[self.physics]))
            if len(matches) == 1:  # none: the thread ran no simulation; several: equal simulations
                values[matches[0]], mask[matches[0]] = row, True
        return States(values, mask)

    def verify(self) -> States:
        """Run the timed call, and each simulation alone for the entries it does not return."""
        self.verified = self._one_by_one()
        self.clear()
        self.run()
        timed = self.final_states()
        return States(np.where(np.asarray(timed.mask), timed.values, self.verified))

    def _one_by_one(self) -> np.ndarray:
        """Return (nbatch, nstate) whole final states of simulations that run alone."""
        from mujoco import rollout

        values = np.empty_like(self.final_state)
        data = self.datas[0]
        for i in range(self.workload.nbatch):
            inputs = self.inputs.only(i)
            rollout.rollout(
                self.model,
                [data] if compat.rollout_threads() else data,
                inputs.start,
                inputs.control,
                control_spec=inputs.control_spec,
                nstep=self.workload.nstep,
                initial_warmstart=inputs.warmstart,
                state=self.state[i : i + 1],
                sensordata=self.sensordata[i : i + 1],
            )
            compat.get_state(self.model, data, values[i], self.spec)
        return values


def _rollout_function(options: Options, resources: Resources) -> Callable[..., Any]:
    """Return `mujoco.rollout.rollout`, or that of a thread pool which outlives the call."""
    from mujoco import rollout

    if options.get("pool") != "kept":
        return rollout.rollout  # type: ignore[no-any-return]
    threads = options["threads"]
    pool = resources.get_or_create(
        ("rollout pool", threads), lambda: rollout.Rollout(nthread=threads)
    )
    resources.at_close(pool.close)
    return pool.rollout  # type: ignore[no-any-return]


def _equal_rows(values: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return (n,) which rows of `values` equal `row` to the last bit."""
    return np.asarray((values.view(np.uint64) == row.view(np.uint64)).all(axis=1))


_SNIPPET_INPUTS = """\
# a rollout resets mocap poses and applied forces, unless they are part of the control
spec = mujoco.mjtState.mjSTATE_CTRL{bits}
inputs = np.empty((*control.shape[:2], mujoco.mj_stateSize(model, int(spec))))
for i, row in enumerate(initial_state):
    mujoco.mj_setState(model, data[0], row, int(full))
    given = np.empty(inputs.shape[2])
    mujoco.mj_getState(model, data[0], given, int(spec))
    inputs[i] = given
inputs[:, :, : model.nu] = control
control = inputs
"""

_SNIPPET_NOTHING = """\
# timed without outputs: skip_checks=True and neither state= nor sensordata=; data keeps the last
"""

_SNIPPET = """\
import mujoco
import numpy as np
from mujoco import rollout

full = mujoco.mjtState.mjSTATE_INTEGRATION
physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
data = [mujoco.MjData(model) for _ in range({threads})]
start, warmstart = [], []
for row in initial_state:
    mujoco.mj_setState(model, data[0], row, int(full))
    start.append(np.empty(mujoco.mj_stateSize(model, int(physics))))
    mujoco.mj_getState(model, data[0], start[-1], int(physics))
    warmstart.append(data[0].qacc_warmstart.copy())
{prepare}state, sensordata = rollout.rollout(
    model, data, np.array(start), control if control.size else None,
    initial_warmstart=np.array(warmstart), nstep=control.shape[1]{extra})
final_state = state[:, -1]  # (nbatch, nphysics)
"""
