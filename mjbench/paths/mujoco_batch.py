"""`mujoco.batch.Batch`: many simulations on the engine's threads, stepped or rolled out."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from mjbench.host import machine
from mjbench.paths import snippets
from mjbench.paths.base import Option, Options, Prepared, Resources, SteppingPath, prepared_arrays
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, StepOutputs, Workload

if TYPE_CHECKING:
    from mujoco.batch import Batch

_THREADS = Option("threads", "threads, the caller's included", (), int)
_DATA = Option(
    "data",
    "an MjData per thread (shared), or one per simulation (persistent)",
    ("shared", "persistent"),
    str,
    ("shared", "persistent"),
)
# Share of the free memory that an MjData per simulation may take.
_SHARE_OF_MEMORY = 0.5


class _BatchPath(SteppingPath):
    products = tuple(Product)

    def unavailable(self) -> str | None:
        return compat.batch_unavailable()

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        if options["data"] == "shared":
            if compat.has_sleep(workload.model):
                return "a model with sleep needs an MjData per simulation: --option data=persistent"
            return None
        needed = workload.nbatch * machine.data_bytes(workload.model)
        free = machine.available_memory_bytes()
        if needed > _SHARE_OF_MEMORY * free:
            return (
                f"{workload.nbatch} MjData need {needed / 2**30:.1f} GiB,"
                f" {free / 2**30:.1f} GiB are free: reduce --nbatch"
            )
        return None

    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        """By default only the most threads try data=persistent."""
        variants = super().variants(choices)
        if "data" in choices:
            return variants
        most = max(options["threads"] for options in variants)
        return [o for o in variants if o["data"] == "shared" or o["threads"] == most]

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        batch = _batch(workload, options, resources)
        start, state = workload.initial_state, batch.state
        step_all = self.make_step_all(batch, workload, options, resources)

        def run() -> None:
            state[:] = start
            batch.warning[:] = 0
            step_all()

        return prepared_arrays(run, state, resources.step_outputs())

    @abstractmethod
    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        """Return a function that takes all steps of the simulations in `batch`."""


class BatchStep(_BatchPath):
    """`Batch.step` once per control: all simulations step together, so a policy can run between."""

    name = "batch_step"
    summary = "mujoco.batch step(), controls of all simulations written before each"
    title = "Batch.step"
    closed_loop = True
    options: ClassVar[tuple[Option, ...]] = (
        _THREADS,
        _DATA,
        Option(
            "stage",
            "derived fields after each call: as mj_step leaves them, or current (mj_step1)",
            ("none",),
            str,
            ("none", "vel"),
        ),
    )

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        if options["stage"] == "none":
            options = {**options, "stage": None}
        return super().simplified(options)

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        if options.get("stage") == "vel" and workload.returns == Product.SENSORS:
            return (
                "stage=vel leaves the sensor data of the state after the step: stage=none will do"
            )
        return super().unsuited(workload, options)

    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        by_control = resources.get_or_create(
            "control by step", lambda: _control_by_step(workload, resources)
        )
        ctrl, hold, step = batch.bind("ctrl"), workload.hold, batch.step
        keywords = {}
        if options.get("stage") == "vel":
            keywords["stage"] = int(mujoco.mjtStage.mjSTAGE_VEL)

        def step_all() -> None:
            for values in by_control:
                ctrl[:] = values
                step(nstep=hold, **keywords)

        if workload.returns == Product.FINAL:
            return step_all
        record = _recorder(batch, workload, resources.step_outputs())

        def step_and_record() -> None:
            k = 0
            for values in by_control:
                ctrl[:] = values
                for _ in range(hold):
                    step(**keywords)
                    record(k)
                    k += 1

        return step_and_record

    def snippet(self, workload: Workload, options: Options) -> str:
        is_final = workload.returns == Product.FINAL
        bind = 'b.bind("sensordata")\n' if workload.returns == Product.SENSORS else ""
        arguments = [f"nstep={workload.hold}"] if workload.hold > 1 and is_final else []
        if options.get("stage") == "vel":
            arguments.append("stage=mujoco.mjtStage.mjSTAGE_VEL.value")
        step = f"b.step({', '.join(arguments)})"
        record = ("state[:, k] = b.state[:, columns]", "sensordata[:, k] = b.sensordata")
        return _STEP.format(
            constructor=_constructor(options),
            imports="" if is_final else "import numpy as np\n",
            allocate="" if is_final else snippets.allocation(workload) + _COLUMNS + bind,
            step=f"    {step}\n"
            if is_final
            else snippets.recorded_steps(workload, 4, step, record),
        )


class BatchRollout(_BatchPath):
    """`Batch.rollout`: one call takes all steps of all simulations."""

    name = "batch_rollout"
    summary = "mujoco.batch rollout(), open loop"
    title = "Batch.rollout"
    closed_loop = False
    options: ClassVar[tuple[Option, ...]] = (_THREADS, _DATA)

    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        control = workload.step_control if workload.model.nu else None
        recorded = resources.step_outputs().arrays
        items = dict(zip((compat.FULLPHYSICS, "sensordata"), recorded, strict=False))
        return lambda: batch.rollout(workload.nstep, control, record=tuple(items), out=items)

    def snippet(self, workload: Workload, options: Options) -> str:
        record, read = {
            Product.FINAL: ("()", ""),
            Product.TRAJECTORY: ("(physics,)", "state = recorded[physics]\n"),
            Product.SENSORS: (
                "(physics, 'sensordata')",
                "state, sensordata = recorded[physics], recorded['sensordata']\n",
            ),
        }[workload.returns]
        hold, repeat, imports = workload.hold, "", ""
        if hold > 1:
            repeat = f"control = np.repeat(control, {hold}, axis=1)\n"
            imports = "import numpy as np\n"
        if workload.returns != Product.FINAL:
            imports = "import mujoco\n" + imports
            repeat += "physics = mujoco.mjtState.mjSTATE_FULLPHYSICS.value\n"
        return _ROLLOUT.format(
            constructor=_constructor(options),
            imports=imports,
            repeat=repeat,
            record=record,
            assign="" if workload.returns == Product.FINAL else "recorded = ",
            read=read,
        )


def _batch(workload: Workload, options: Options, resources: Resources) -> "Batch":
    """Return a Batch; paths with the same threads and storage share it."""
    from mujoco import batch

    threads, persistent = options["threads"], options["data"] == "persistent"
    return resources.get_or_create(
        ("batch", threads, persistent),
        lambda: batch.Batch(workload.model, workload.nbatch, threads, persistent),
    )


def _control_by_step(workload: Workload, resources: Resources) -> np.ndarray:
    """Return (ncontrol, nbatch, nu) controls, which follow when simulations are reordered."""
    by_control = np.ascontiguousarray(workload.control.swapaxes(0, 1))

    def follow() -> None:
        by_control[...] = workload.control.swapaxes(0, 1)

    resources.at_change(follow)
    return by_control


def _recorder(batch: "Batch", workload: Workload, outputs: StepOutputs) -> Callable[[int], None]:
    """Return a function that copies what a step leaves to row `k` of each simulation's outputs."""
    physics = compat.physics_entries(workload.model)
    groups = np.split(np.arange(len(physics)), np.flatnonzero(np.diff(physics) != 1) + 1)
    columns = [
        (slice(group[0], group[-1] + 1), slice(physics[group[0]], physics[group[-1]] + 1))
        for group in groups
    ]
    rows, state, sensordata = batch.state, outputs.state, outputs.sensordata
    assert state is not None, "a run that records has arrays to record to"
    sensors = None if sensordata is None else batch.bind("sensordata")

    def record(k: int) -> None:
        for to, source in columns:
            state[:, k, to] = rows[:, source]
        if sensordata is not None:
            sensordata[:, k] = sensors

    return record


def _constructor(options: Options) -> str:
    persistent = ", persistent=True" if options["data"] == "persistent" else ""
    return f"batch.Batch(model, len(initial_state), nthread={options['threads']}{persistent})"


_STEP = """\
import mujoco
{imports}from mujoco import batch

b = {constructor}
b.state[:] = initial_state
ctrl = b.bind("ctrl")
{allocate}for i in range(control.shape[1]):
    ctrl[:] = control[:, i]  # or one policy for all: ctrl[:] = policy(b.qpos, b.qvel)
{step}final_state = b.state
"""

_COLUMNS = """\
# where the full physics state stands in a row of b.state
data, columns = mujoco.MjData(model), np.empty(state.shape[2])
everything = mujoco.mjtState.mjSTATE_INTEGRATION.value
mujoco.mj_setState(model, data, np.arange(b.nstate, dtype=float), everything)
mujoco.mj_getState(model, data, columns, physics)
columns, k = columns.astype(int), 0
"""

_ROLLOUT = """\
{imports}from mujoco import batch

{repeat}b = {constructor}
b.state[:] = initial_state
{assign}b.rollout(control.shape[1], control if control.size else None, record={record})
{read}final_state = b.state
"""
