"""`mujoco.batch.Batch`: many simulations on the engine's threads, stepped or rolled out."""

import functools
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from mjbench.instrument import machine
from mjbench.paths.base import Option, Options, Prepared, Resources, States, SteppingPath
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

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
    """The base class of stepping and of rolling out a Batch."""

    def unavailable(self) -> str | None:
        """See `SteppingPath.unavailable`."""
        return compat.batch_unavailable()

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """See `SteppingPath.unsuited`: sleep needs an MjData per simulation, and memory for it."""
        if options["data"] == "shared":
            if compat.has_sleep(workload.model):
                return "a model with sleep enabled needs data=persistent"
            return None
        needed = workload.nbatch * machine.data_bytes(workload.model)
        free = machine.available_memory_bytes()
        if needed > _SHARE_OF_MEMORY * free:
            return (
                f"{workload.nbatch} MjData need {needed / 2**30:.1f} GiB,"
                f" {free / 2**30:.1f} GiB are free"
            )
        return None

    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        """See `SteppingPath.variants`: by default only the most threads try data=persistent."""
        variants = super().variants(choices)
        if "data" in choices:
            return variants
        most = max(options["threads"] for options in variants)
        return [o for o in variants if o["data"] == "shared" or o["threads"] == most]

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        batch = _batch(workload, options, resources)
        start, state = workload.initial_state, batch.state
        step_all = self.make_step_all(batch, workload, options, resources)

        def run() -> None:
            state[:] = start
            batch.warning[:] = 0
            step_all()

        return Prepared(run, lambda: state.fill(np.nan), lambda: States(state))

    @abstractmethod
    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        """Return a function that takes all steps of the simulations in `batch`."""


class BatchStep(_BatchPath):
    """`Batch.step` once per control: all simulations step together, so a policy can run between."""

    name = "batch_step"
    summary = "mujoco.batch step(), controls of all simulations written before each"
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
        """See `SteppingPath.simplified`."""
        if options["stage"] == "none":
            options = {**options, "stage": None}
        return super().simplified(options)

    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        """See `_BatchPath.make_step_all`."""
        by_control = resources.get_or_create(
            "control by step", lambda: np.ascontiguousarray(workload.control.swapaxes(0, 1))
        )
        ctrl, hold, step = batch.bind("ctrl"), workload.hold, batch.step
        keywords = {}
        if options.get("stage") == "vel":
            keywords["stage"] = int(mujoco.mjtStage.mjSTAGE_VEL)

        def step_all() -> None:
            for values in by_control:
                ctrl[:] = values
                step(nstep=hold, **keywords)

        return step_all

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        arguments = [f"nstep={workload.hold}"] if workload.hold > 1 else []
        if options.get("stage") == "vel":
            arguments.append("stage=mujoco.mjtStage.mjSTAGE_VEL.value")
        return _STEP.format(constructor=_constructor(options), arguments=", ".join(arguments))


class BatchRollout(_BatchPath):
    """`Batch.rollout`: one call takes all steps of all simulations."""

    name = "batch_rollout"
    summary = "mujoco.batch rollout(), open loop"
    closed_loop = False
    options: ClassVar[tuple[Option, ...]] = (
        _THREADS,
        _DATA,
        Option(
            "record",
            "recorded after every step: nothing, qpos, or the state",
            ("none",),
            str,
            ("none", "qpos", "state"),
        ),
    )

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        """See `SteppingPath.simplified`."""
        if options["record"] == "none":
            options = {**options, "record": None}
        return super().simplified(options)

    def make_step_all(
        self, batch: "Batch", workload: Workload, options: Options, resources: Resources
    ) -> Callable[[], None]:
        """See `_BatchPath.make_step_all`."""
        control = workload.step_control if workload.model.nu else None
        items = _record_items(options)
        out = {
            item: resources.get_or_create(
                ("batch record", item), functools.partial(_buffer, workload, item)
            )
            for item in items
        }
        return lambda: batch.rollout(workload.nstep, control, record=items, out=out)

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        record = {
            "none": "()",
            "qpos": "('qpos',)",
            "state": "(mujoco.mjtState.mjSTATE_FULLPHYSICS.value,)",
        }[options.get("record", "none")]
        hold = workload.hold
        repeat = f"control = np.repeat(control, {hold}, axis=1)\n" if hold > 1 else ""
        imports = "import numpy as np\n" if hold > 1 else ""
        if options.get("record") == "state":
            imports = "import mujoco\n" + imports
        return _ROLLOUT.format(
            constructor=_constructor(options), imports=imports, repeat=repeat, record=record
        )


def _batch(workload: Workload, options: Options, resources: Resources) -> "Batch":
    """Return a Batch; paths with the same threads and storage share it."""
    from mujoco import batch

    threads, persistent = options["threads"], options["data"] == "persistent"
    return resources.get_or_create(
        ("batch", threads, persistent),
        lambda: batch.Batch(workload.model, workload.nbatch, threads, persistent),
    )


def _record_items(options: Options) -> tuple[str | int, ...]:
    """Return what `Batch.rollout` records: field names or state specifications."""
    record = options.get("record", "none")
    if record == "none":
        return ()
    return ("qpos",) if record == "qpos" else (compat.state_spec("FULLPHYSICS"),)


def _buffer(workload: Workload, item: str | int) -> np.ndarray:
    """Return an (nbatch, nstep, size) array for what is recorded of an item."""
    model = workload.model
    size = model.nq if isinstance(item, str) else compat.state_size(model, item)
    return np.empty((workload.nbatch, workload.nstep, size))


def _constructor(options: Options) -> str:
    persistent = ", persistent=True" if options["data"] == "persistent" else ""
    return f"batch.Batch(model, len(initial_state), nthread={options['threads']}{persistent})"


_STEP = """\
import mujoco
from mujoco import batch

b = {constructor}
b.state[:] = initial_state
ctrl = b.bind("ctrl")
for k in range(control.shape[1]):
    ctrl[:] = control[:, k]  # or ctrl[:] = policy(b.bind("qpos"), b.bind("qvel"))
    b.step({arguments})
final_state = b.state
"""

_ROLLOUT = """\
{imports}from mujoco import batch

{repeat}b = {constructor}
b.state[:] = initial_state
b.rollout(control.shape[1], control if control.size else None, record={record})
final_state = b.state
"""
