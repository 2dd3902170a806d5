"""What the snippets of several paths share: the lines that record every step."""

from collections.abc import Sequence

from mjbench.simulation.workload import Product, Workload


def allocation(workload: Workload) -> str:
    """Return lines that allocate what a run returns of every step; empty for final states."""
    if workload.returns == Product.FINAL:
        return ""
    nstep = "control.shape[1]" if workload.hold == 1 else f"{workload.hold} * control.shape[1]"
    lines = _STATE.format(nstep=nstep)
    return lines + _SENSORDATA if workload.returns == Product.SENSORS else lines


def output_names(workload: Workload) -> tuple[str, ...]:
    """Return the names of what a run returns of every step, in the snippet."""
    return ("state", "sensordata")[: list(Product).index(workload.returns)]


def recorded_steps(workload: Workload, indent: int, step: str, record: Sequence[str]) -> str:
    """Return lines that take the steps of one control, and record each as step `k`."""
    lines = [step, *record[: len(output_names(workload))], "k += 1"]
    if workload.hold > 1:
        lines = [f"for _ in range({workload.hold}):", *(f"    {line}" for line in lines)]
    return "".join(f"{' ' * indent}{line}\n" for line in lines)


def data_steps(workload: Workload, indent: int, row: str) -> str:
    """Return lines that step an MjData through one control, recorded in simulation `row`."""
    if workload.returns == Product.FINAL:
        nstep = f", nstep={workload.hold}" if workload.hold > 1 else ""
        return f"{' ' * indent}mujoco.mj_step(model, data{nstep})\n"
    record = (
        f"mujoco.mj_getState(model, data, state[{row}, k], physics)",
        f"sensordata[{row}, k] = data.sensordata",
    )
    return recorded_steps(workload, indent, "mujoco.mj_step(model, data)", record)


def counter(workload: Workload, indent: int) -> str:
    """Return the line that sets the counter of recorded steps; empty for final states."""
    return "" if workload.returns == Product.FINAL else f"{' ' * indent}k = 0\n"


_STATE = """\
physics = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
nstep = {nstep}
state = np.empty((len(initial_state), nstep, mujoco.mj_stateSize(model, physics)))
"""

_SENSORDATA = "sensordata = np.empty((len(initial_state), nstep, model.nsensordata))\n"
