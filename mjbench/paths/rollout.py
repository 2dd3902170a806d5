"""`mujoco.rollout`: open-loop trajectories, in C, on threads."""

from typing import Any

import mujoco
import numpy as np

from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

# What a rollout sets to the model's defaults unless it is part of the control.
_USER_INPUTS = (
    "QFRC_APPLIED",
    "XFRC_APPLIED",
    "EQ_ACTIVE",
    "MOCAP_POS",
    "MOCAP_QUAT",
    "USERDATA",
)


class Rollout(SteppingPath):
    """`mujoco.rollout.rollout` into arrays made beforehand.

    It returns full-physics states after every step, unless told to return nothing: then the MjData
    of its threads keep what each simulated last. The warm-start is not among them: the timed
    call is compared on all it returns and on the MjData its threads leave behind, and `verify`
    repeats every simulation alone, which leaves its whole state in the MjData.
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
        if options["threads"] > 1 and not compat.rollout_threads():
            return "mujoco.rollout has threads from MuJoCo 3.2.7 on"
        return None

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
        return _PreparedRollout(workload, options, resources).prepared()

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        threads, hold = options["threads"], workload.hold
        extra = "".join(
            f", {word}"
            for word in (
                f"chunk_size={options['chunk']}" if options.get("chunk") else "",
                "persistent_pool=True" if options.get("pool") == "kept" else "",
            )
            if word
        )
        columns = compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
        inputs = _moved_inputs(workload, columns)
        prepare = f"control = np.repeat(control, {hold}, axis=1)\n" if hold > 1 else ""
        if inputs:
            bits = "".join(f" | mujoco.mjtState.mjSTATE_{name}" for name in inputs)
            prepare += _SNIPPET_INPUTS.format(bits=bits)
            extra += ", control_spec=int(spec)"
        if options.get("returns") == "nothing":
            prepare = _SNIPPET_NOTHING + prepare
        return _SNIPPET.format(threads=threads, extra=extra, prepare=prepare)


class _PreparedRollout:
    """Arrays of one rollout variant; all variants of a workload share the big ones."""

    def __init__(self, workload: Workload, options: Options, resources: Resources):
        from mujoco import rollout

        model = workload.model
        self.module, self.model, self.workload = rollout, model, workload
        self.integration = compat.state_spec("INTEGRATION")
        self.columns = compat.state_columns(model, self.integration)
        physics = compat.state_columns(model, compat.state_spec("FULLPHYSICS"))
        self.returned = np.concatenate([np.r_[self.columns[name]] for name in physics])
        self.start = resources.get_or_create(
            "rollout start", lambda: np.ascontiguousarray(workload.initial_state[:, self.returned])
        )
        self.warmstart = resources.get_or_create(
            "rollout warmstart",
            lambda: np.ascontiguousarray(workload.initial_state[:, self.columns["qacc_warmstart"]]),
        )
        self.control_spec, self.control = resources.get_or_create(
            "rollout control", lambda: _control(workload, self.columns)
        )
        shape = (workload.nbatch, workload.nstep)
        self.state = resources.get_or_create(
            "rollout state", lambda: np.empty((*shape, len(self.returned)))
        )
        self.sensordata = resources.get_or_create(
            "rollout sensordata", lambda: np.empty((*shape, model.nsensordata))
        )
        self.datas = resources.datas(options["threads"])
        self.final_state = resources.final_state()
        self.returns_states = options.get("returns") != "nothing"
        self.verified = np.empty((0, self.final_state.shape[1]))
        self.call = self._caller(options, resources)

    def _caller(self, options: Options, resources: Resources) -> Any:
        """Return the function whose one call is the timed region."""
        keywords: dict[str, Any] = {
            "control_spec": self.control_spec,
            "nstep": self.workload.nstep,
            "initial_warmstart": self.warmstart,
            "state": self.state if self.returns_states else None,
            "sensordata": self.sensordata if self.returns_states else None,
        }
        model: Any = self.model
        if options.get("checks") == "off" or not self.returns_states:
            keywords["skip_checks"] = True
            if compat.rollout_threads():
                model = [self.model] * self.workload.nbatch
        if options.get("chunk"):
            keywords["chunk_size"] = options["chunk"]
        data: Any = self.datas if compat.rollout_threads() else self.datas[0]
        if options.get("pool") == "kept":
            pool = resources.get_or_create(
                ("rollout pool", len(self.datas)), lambda: _pool(self.module, len(self.datas))
            )
            resources.at_close(pool.close)
            function = pool.rollout
        else:
            function = self.module.rollout
        return lambda: function(model, data, self.start, self.control, **keywords)

    def prepared(self) -> Prepared:
        """Return the run."""
        return Prepared(self.run, self.clear, self.final_states, self.verify)

    def run(self) -> None:
        self.call()

    def clear(self) -> None:
        if self.returns_states:
            self.state[:, -1] = np.nan
        else:
            for data in self.datas:
                mujoco.mj_resetData(self.model, data)

    def final_states(self) -> States:
        """Return what the call returned, and the whole state of each thread's last simulation."""
        return self._returned_states() if self.returns_states else self._left_states()

    def _left_states(self) -> States:
        """Return the whole state of each thread's last simulation, which no array names.

        It is the simulation that ended so when verified; one that ended like none of them is
        handed back as the last simulation, which it then disagrees with.
        """
        values, held = self.final_state, np.zeros(self.final_state.shape, dtype=bool)
        row = np.empty(values.shape[1])
        for data in self.datas:
            if data.time == 0.0:  # as `clear` left it: the thread got no work
                continue
            compat.get_state(self.model, data, row, self.integration)
            same = (self.verified.view(np.uint64) == row.view(np.uint64)).all(axis=1)
            (ran,) = np.nonzero(same)
            number = int(ran[-1]) if len(ran) else self.workload.nbatch - 1
            values[number], held[number] = row, True
        if not held.any():
            values[-1], held[-1] = np.nan, True
        return States(values, held)

    def _returned_states(self) -> States:
        values, held = self.final_state, np.zeros(self.final_state.shape, dtype=bool)
        values[:, self.returned] = self.state[:, -1]
        held[:, self.returned] = True
        row = np.empty(values.shape[1])
        for data in self.datas:
            compat.get_state(self.model, data, row, self.integration)
            same = values[:, self.returned].view(np.uint64) == row[self.returned].view(np.uint64)
            (ran,) = np.nonzero(same.all(axis=1))
            if len(ran) == 1:  # else the thread got no work, or the simulations are twins
                values[ran[0]], held[ran[0]] = row, True
        return States(values, held)

    def verify(self) -> States:
        """Run each simulation alone, for the entries the timed call keeps back, and then that."""
        values = np.empty_like(self.final_state)
        data = self.datas[0]
        one = [data] if compat.rollout_threads() else data
        for i in range(self.workload.nbatch):
            self.module.rollout(
                self.model,
                one,
                self.start[i : i + 1],
                None if self.control is None else self.control[i : i + 1],
                control_spec=self.control_spec,
                nstep=self.workload.nstep,
                initial_warmstart=self.warmstart[i : i + 1],
                state=self.state[i : i + 1],
                sensordata=self.sensordata[i : i + 1],
            )
            compat.get_state(self.model, data, values[i], self.integration)
        self.verified = values
        self.clear()
        self.run()
        timed = self.final_states()
        held = np.asarray(timed.held)
        return States(np.where(held, timed.values, values))


def _pool(module: Any, threads: int) -> Any:
    return module.Rollout(nthread=threads)


def _moved_inputs(workload: Workload, columns: dict[str, slice]) -> list[str]:
    """Return the inputs (by mjtState name) that differ from what a rollout resets them to."""
    default = mujoco.MjData(workload.model)
    moved = []
    for name in _USER_INPUTS:
        field = name.lower()
        if field in columns:
            given = workload.initial_state[:, columns[field]]
            if np.any(given != np.asarray(getattr(default, field), dtype=float).ravel()):
                moved.append(name)
    return moved


def _control(workload: Workload, columns: dict[str, slice]) -> tuple[int, np.ndarray | None]:
    """Return the control specification and (nbatch, nstep, ncontrol) controls of a rollout.

    Inputs that a rollout would reset (mocap poses, applied forces, ...) are sent along with
    every step's control.
    """
    ctrl = compat.state_spec("CTRL")
    inputs = _moved_inputs(workload, columns)
    if not inputs:
        return ctrl, np.ascontiguousarray(workload.step_control) if workload.model.nu else None
    spec = ctrl
    for name in inputs:
        spec |= compat.state_spec(name)
    parts = [
        workload.step_control
        if field == "ctrl"
        else np.repeat(workload.initial_state[:, None, columns[field]], workload.nstep, axis=1)
        for field in compat.state_columns(workload.model, spec)
    ]
    return spec, np.concatenate(parts, axis=2)


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
