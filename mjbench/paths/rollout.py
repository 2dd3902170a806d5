"""`mujoco.rollout`: open-loop trajectories, in C, on threads.

A rollout resets mocap poses and applied forces, unless they are part of the control; then they are
sent along with every step's control.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, StepOutputs, Workload

# Inputs that a rollout resets to the model's defaults unless they are part of the control.
_USER_INPUTS = ("QFRC_APPLIED", "XFRC_APPLIED", "EQ_ACTIVE", "MOCAP_POS", "MOCAP_QUAT", "USERDATA")


class Rollout(SteppingPath):
    """`mujoco.rollout.rollout` into arrays allocated beforehand.

    It returns the full-physics states after every step, also to a caller who wants the last ones.
    Where nobody asks for sensor data, its checks are skipped: with them it returns sensor data,
    too.

    No output holds the warm-start. A timed call is therefore compared on everything that it returns
    and on the states that its MjData hold. `verify` runs every simulation alone, so that its whole
    state is in the MjData.
    """

    name = "rollout"
    summary = "mujoco.rollout, open loop, states of every step returned"
    title = "mujoco.rollout"
    closed_loop = False
    products = tuple(Product)
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
        Option(
            "checks",
            "shapes and types checked by each call; only where it returns sensor data",
            ("on",),
            str,
            ("on", "off"),
        ),
    )

    def unavailable(self) -> str | None:
        return compat.rollout_unavailable()

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        return compat.rollout_threads_unavailable() if options["threads"] > 1 else None

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        if options["threads"] == 1:
            options = {**options, "pool": None, "chunk": None}
        if options["checks"] == "on":
            options = {**options, "checks": None}
        return super().simplified(options)

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        return _RolloutRun(workload, options, resources).prepared()

    def snippet(self, workload: Workload, options: Options) -> str:
        returns, arguments = workload.returns, []
        if options.get("chunk"):
            arguments.append(f"chunk_size={options['chunk']}")
        if options.get("pool") == "kept":
            arguments.append("persistent_pool=True")
        prepare = inputs_snippet(workload)
        if changed_inputs(workload):
            arguments.append("control_spec=int(spec)")
        skips_checks = options.get("checks") == "off" or returns != Product.SENSORS
        if skips_checks:
            prepare += _SNIPPET_STATE
            arguments += ["state=state", "skip_checks=True"]
        if skips_checks and returns == Product.SENSORS:
            prepare += _SNIPPET_SENSORDATA
            arguments.append("sensordata=sensordata")
        call = "rollout.rollout" if skips_checks else "state, sensordata = rollout.rollout"
        return _SNIPPET.format(
            threads=options["threads"],
            model="[model] * len(start)" if skips_checks else "model",
            call=call,
            extra="".join(f", {argument}" for argument in arguments),
            prepare=prepare,
        )


class _RolloutRun:
    def __init__(self, workload: Workload, options: Options, resources: Resources):
        self.workload, self.model = workload, workload.model
        self.physics = compat.physics_entries(self.model)
        self.inputs = shared_inputs(workload, resources)
        self.state, self.sensordata = self._output_arrays(resources)
        self.datas = resources.datas(options["threads"])
        self.final_state = resources.final_state()
        self.run = self._timed_call(options, resources)

    def prepared(self) -> Prepared:
        is_final = self.workload.returns == Product.FINAL
        return Prepared(
            self.run,
            self.clear,
            self.final_states,
            self.verify,
            step_outputs=None if is_final else self._step_outputs,
        )

    def _output_arrays(self, resources: Resources) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the arrays for states and for sensor data; None where nobody asks for those."""
        outputs = resources.step_outputs()
        if outputs.state is not None:
            return outputs.state, outputs.sensordata
        shape = (self.workload.nbatch, self.workload.nstep, len(self.physics))
        return resources.get_or_create("rollout state", lambda: np.empty(shape)), None

    def _timed_call(self, options: Options, resources: Resources) -> Callable[[], None]:
        start, control = self.inputs.start, self.inputs.control
        keywords: dict[str, Any] = {
            "control_spec": self.inputs.control_spec,
            "nstep": self.workload.nstep,
            "initial_warmstart": self.inputs.warmstart,
            "state": self.state,
            "sensordata": self.sensordata,
        }
        model: mujoco.MjModel | list[mujoco.MjModel] = self.model
        if options.get("checks") == "off" or self.sensordata is None:
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
        if self.workload.returns == Product.FINAL:
            self.state[:, -1] = np.nan
        else:
            self._step_outputs().clear()

    def _step_outputs(self) -> StepOutputs:
        return StepOutputs(self.state, self.sensordata)

    def final_states(self) -> States:
        """Return the returned states, and the whole state of each thread's last simulation."""
        states = States.of_entries(self.final_state, self.physics, self.state[:, -1])
        values, mask = states.values, np.asarray(states.mask)
        row = np.empty(values.shape[1])
        for data in self.datas:
            compat.get_state(self.model, data, row)
            matches = np.flatnonzero(_equal_rows(values[:, self.physics], row[self.physics]))
            if len(matches) == 1:  # none: the thread ran no simulation; several: equal simulations
                values[matches[0]], mask[matches[0]] = row, True
        return states

    def verify(self) -> States:
        """Run the timed call, and each simulation alone for the entries it does not return."""
        nstep = self.workload.nstep
        alone = whole_final_states(self.model, self.datas[0], self.inputs, nstep)
        self.clear()
        self.run()
        return self.final_states().completed(alone)


def _rollout_function(options: Options, resources: Resources) -> Callable[..., Any]:
    """Return `mujoco.rollout.rollout`, or that of a thread pool which outlives the call."""
    from mujoco import rollout

    if options.get("pool") != "kept":
        return rollout.rollout  # type: ignore[no-any-return]
    threads = options["threads"]
    key = ("rollout pool", threads)
    pool = resources.get_or_create(key, lambda: rollout.Rollout(nthread=threads))
    resources.at_close(pool.close)
    return pool.rollout  # type: ignore[no-any-return]


def _equal_rows(values: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return (n,) which rows of `values` equal `row` to the last bit."""
    return np.asarray((values.view(np.uint64) == row.view(np.uint64)).all(axis=1))


_SNIPPET_STATE = """\
# skip_checks=True leaves out sensor data, unless there is an array for them
state = np.empty((*control.shape[:2], mujoco.mj_stateSize(model, int(physics))))
"""

_SNIPPET_SENSORDATA = "sensordata = np.empty((*control.shape[:2], model.nsensordata))\n"

_SNIPPET = """\
import mujoco
import numpy as np
from mujoco import rollout

full = mujoco.mjtState.mjSTATE_INTEGRATION
physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
data = [mujoco.MjData(model) for _ in range({threads})]
{prepare}{call}(
    {model}, data, np.array(start), control if control.size else None,
    initial_warmstart=np.array(warmstart), nstep=control.shape[1]{extra})
final_state = state[:, -1]  # (nbatch, nphysics)
"""


@dataclass(frozen=True, eq=False)
class RolloutInputs:
    """The arrays that a rollout starts from; all variants of a workload share them.

    Attributes:
      start: (nbatch, nphysics) states.
      warmstart: (nbatch, nv) accelerations.
      control_spec: mjtState components in a row of `control`.
      control: (nbatch, nstep, ncontrol); None without any.
    """

    start: np.ndarray
    warmstart: np.ndarray
    control_spec: int
    control: np.ndarray | None

    def part(self, rows: slice) -> "RolloutInputs":
        control = None if self.control is None else self.control[rows]
        return RolloutInputs(self.start[rows], self.warmstart[rows], self.control_spec, control)


def shared_inputs(workload: Workload, resources: Resources) -> RolloutInputs:
    """Return the inputs of a workload's rollout, shared, which follow changes of its arrays."""
    return resources.get_or_create(  # type: ignore[no-any-return]
        "rollout inputs", lambda: _make_inputs(workload, resources)
    )


def _make_inputs(workload: Workload, resources: Resources) -> RolloutInputs:
    physics = compat.physics_entries(workload.model)
    warmstart = compat.state_columns(workload.model)["qacc_warmstart"]
    spec, control, write_control = _control(workload)
    inputs = RolloutInputs(
        np.ascontiguousarray(workload.initial_state[:, physics]),
        np.ascontiguousarray(workload.initial_state[:, warmstart]),
        spec,
        control,
    )

    def follow() -> None:
        np.take(workload.initial_state, physics, axis=1, out=inputs.start)
        inputs.warmstart[...] = workload.initial_state[:, warmstart]
        write_control()

    resources.at_change(follow)
    return inputs


def whole_final_states(
    model: mujoco.MjModel, data: mujoco.MjData, inputs: RolloutInputs, nstep: int
) -> np.ndarray:
    """Return (nbatch, nstate) final states in full, of simulations that are rolled out alone.

    What a rollout does not return, such as the warm-start, is in its MjData afterwards.
    """
    from mujoco import rollout

    values = np.empty((len(inputs.start), compat.state_size(model)))
    state = np.empty((1, nstep, inputs.start.shape[1]))
    sensordata = np.empty((1, nstep, model.nsensordata))
    for i, row in enumerate(values):
        one = inputs.part(slice(i, i + 1))
        rollout.rollout(
            model,
            [data] if compat.rollout_threads() else data,
            one.start,
            one.control,
            control_spec=one.control_spec,
            nstep=nstep,
            initial_warmstart=one.warmstart,
            state=state,
            sensordata=sensordata,
        )
        compat.get_state(model, data, row)
    return values


def changed_inputs(workload: Workload) -> list[str]:
    """Return the inputs (by mjtState name) that differ from what a rollout resets them to."""
    default, columns = mujoco.MjData(workload.model), compat.state_columns(workload.model)
    changed = []
    for name in _USER_INPUTS:
        field = name.lower()
        if field in columns:
            values = workload.initial_state[:, columns[field]]
            if np.any(values != np.asarray(getattr(default, field), dtype=float).ravel()):
                changed.append(name)
    return changed


def inputs_snippet(workload: Workload) -> str:
    """Return lines that make the inputs of a rollout in Python code for people to paste.

    They use `data`, a list of MjData, and leave `start`, `warmstart` and `control`; and `spec`, the
    components in a row of `control`, where these are not those of `ctrl` alone.
    """
    lines = _SNIPPET_STARTS
    if workload.hold > 1:
        lines += f"control = np.repeat(control, {workload.hold}, axis=1)\n"
    inputs = changed_inputs(workload)
    if inputs:
        bits = "".join(f" | mujoco.mjtState.mjSTATE_{name}" for name in inputs)
        lines += _SNIPPET_CONTROL.format(bits=bits)
    return lines


def _control(workload: Workload) -> tuple[int, np.ndarray | None, Callable[[], None]]:
    """Return the control specification of a rollout, its controls, and what writes them.

    The controls are the workload's own where they are all that is sent.
    """
    spec = compat.state_spec("CTRL")
    inputs = changed_inputs(workload)
    if not inputs:
        return spec, workload.step_control if workload.model.nu else None, lambda: None
    for name in inputs:
        spec |= compat.state_spec(name)
    columns = compat.state_columns(workload.model)
    places = compat.state_columns(workload.model, spec)
    size = compat.state_size(workload.model, spec)
    control = np.empty((workload.nbatch, workload.nstep, size))

    def write() -> None:
        for field, place in places.items():
            if field == "ctrl":
                control[:, :, place] = workload.step_control
            else:
                control[:, :, place] = workload.initial_state[:, None, columns[field]]

    write()
    return spec, control, write


_SNIPPET_STARTS = """\
start, warmstart = [], []
for row in initial_state:
    mujoco.mj_setState(model, data[0], row, int(full))
    start.append(np.empty(mujoco.mj_stateSize(model, int(physics))))
    mujoco.mj_getState(model, data[0], start[-1], int(physics))
    warmstart.append(data[0].qacc_warmstart.copy())
"""

_SNIPPET_CONTROL = """\
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
