"""MuJoCo Warp: MuJoCo written in NVIDIA Warp, for a CUDA GPU; it runs on a CPU as well."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench.paths import warp_buffers
from mjbench.paths.accelerated import (
    CPU,
    AcceleratedPath,
    Compiled,
    StepOutcome,
    keyword_arguments,
    start_fields,
    states_of_fields,
    supported_fields,
)
from mjbench.paths.base import Options, States
from mjbench.simulation import compat
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.workload import Workload

# Names a folder in which Warp keeps compiled kernels.
CACHE_VARIABLE = "WARP_CACHE_PATH"


class Warp(AcceleratedPath):
    """MuJoCo Warp by itself; a step is a captured graph, on a GPU and on a CPU."""

    name = "warp"
    summary = "MuJoCo Warp: mujoco_warp.step over all worlds as a captured graph, float32"
    title = "MuJoCo Warp"
    precision = Precision.FLOAT32
    extra = "warp"
    engine = "MuJoCo Warp"
    packages = ("warp", "mujoco_warp")
    distributions = ("mujoco", "mujoco-warp", "warp-lang")

    def environment(self) -> dict[str, str | None]:
        return {CACHE_VARIABLE: None}

    def use_cache(self, folder: Path) -> None:
        os.environ[CACHE_VARIABLE] = str(folder)

    def device_kind(self) -> str:
        import warp as wp

        _print_warnings_only()
        return CPU if wp.get_device().is_cpu else "cuda"

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Reject also models with sleep: trees asleep after one run stay asleep in the next."""
        if compat.has_sleep(workload.model):
            return (
                "which trees sleep is not part of a state, and persists from run to run: a model"
                " without sleep will do"
            )
        return super().unsuited(workload, options)

    def data_fields(self, model: mujoco.MjModel) -> Mapping[str, Any]:
        import mujoco_warp

        _print_warnings_only()
        mujoco_warp.put_model(model)
        return dict(vars(mujoco_warp.make_data(model)))

    def compile(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Compile all kernels by a first step, then capture one step as a graph."""
        import warp as wp

        configure_warp()
        buffer_sizes = warp_buffers.buffer_sizes(peaks, workload.nbatch)
        graph = _StepGraph(workload, buffer_sizes)
        device = wp.get_device()
        return Compiled(
            graph.run,
            graph.clear,
            graph.final_states,
            workload=workload,
            advance=graph.advance,
            reload=graph.reload,
            device=CPU if device.is_cpu else device.name,
            trace_s=graph.trace_s,
            compile_s=graph.compile_s,
            is_deterministic=device.is_cpu,
            buffer_sizes=buffer_sizes,
            gpu_memory_bytes=peak_gpu_memory_bytes,
        )

    def snippet(self, workload: Workload, options: Options) -> str:
        launch = "    wp.capture_launch(capture.graph)"
        if workload.hold > 1:
            launch = f"    for _ in range({workload.hold}):\n    {launch}"
        return _SNIPPET.format(sizes=keyword_arguments(options), launch=launch)


class _StepGraph:
    """One step of all worlds, captured as a graph, and the arrays that it steps."""

    def __init__(self, workload: Workload, buffer_sizes: Mapping[str, int]):
        import mujoco_warp
        import warp as wp

        self._workload = workload
        begin = time.perf_counter()
        model = mujoco_warp.put_model(workload.model)
        data = mujoco_warp.make_data(workload.model, nworld=workload.nbatch, **buffer_sizes)
        wp.synchronize()
        prepared = time.perf_counter()
        mujoco_warp.step(model, data)
        with wp.ScopedCapture() as capture:
            mujoco_warp.step(model, data)
        wp.synchronize()
        self.trace_s = prepared - begin
        self.compile_s = time.perf_counter() - prepared
        self._model = model  # the graph reads its arrays
        self._data, self._capture = data, capture
        self._arrays = {n: v for n, v in vars(data).items() if isinstance(v, wp.array)}
        self.reload()

    def reload(self) -> None:
        self._start = self._fields_on_device(start_fields(self._workload))
        self._controls = self._controls_on_device(self._workload.control)

    def run(self) -> None:
        self._rollout(self._start, self._controls, self._workload.nstep)

    def clear(self) -> None:
        import warp as wp

        self._data.overflow.zero_()
        for name in self._start:
            if name != "eq_active":
                self._arrays[name].fill_(float("nan"))
        wp.synchronize()

    def final_states(self) -> States:
        return states_of_fields(self._workload, self._fields())

    def advance(
        self, fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
    ) -> StepOutcome:
        """Take `nstep` steps from other states (see `Compiled.advance`)."""
        self._data.overflow.zero_()
        self._rollout(self._fields_on_device(fields), self._controls_on_device(control), nstep)
        solved = (self._data.qacc, self._data.qfrc_constraint)
        rows = (np.asarray(array.numpy(), dtype=np.float64) for array in solved)
        return StepOutcome(self._fields(), _contacts(self._data), *rows)

    def _rollout(self, start: Mapping[str, Any], controls: Sequence[Any], nstep: int) -> None:
        import warp as wp

        arrays, ctrl, hold = self._arrays, self._data.ctrl, self._workload.hold
        capture_launch, graph = wp.capture_launch, self._capture.graph
        for name, values in start.items():
            wp.copy(arrays[name], values)
        for k in range(nstep):
            if k % hold == 0:
                wp.copy(ctrl, controls[k // hold])
            capture_launch(graph)
        wp.synchronize()

    def _fields_on_device(self, fields: Mapping[str, np.ndarray]) -> dict[str, Any]:
        supported = supported_fields(fields, self._arrays, Warp.engine)
        return {name: _array_like(self._arrays[name], v) for name, v in supported.items()}

    def _controls_on_device(self, control: np.ndarray) -> list[Any]:
        """Return one array of all worlds' controls for each of (nbatch, ncontrol, nu) controls."""
        return [_array_like(self._data.ctrl, control[:, k]) for k in range(control.shape[1])]

    def _fields(self) -> dict[str, np.ndarray]:
        """Return the start's fields and the controls as they are now, (nbatch, size) in float64."""
        warp_buffers.check_overflow(self._data.overflow.numpy())
        nbatch = self._workload.nbatch
        return {
            name: np.asarray(self._arrays[name].numpy(), dtype=np.float64).reshape(nbatch, -1)
            for name in (*self._start, "ctrl")
        }


def configure_warp() -> None:
    """Let Warp print warnings only, and compile anew into a new folder inside the current one.

    A folder that the environment variable names is used in its place, with what it holds.
    """
    import tempfile

    import warp as wp

    _print_warnings_only()
    named = os.environ.get(CACHE_VARIABLE)
    wp.config.kernel_cache_dir = named or tempfile.mkdtemp(prefix="warp-", dir=Path.cwd())


def _print_warnings_only() -> None:
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING


def _array_like(array: Any, values: np.ndarray) -> Any:
    import warp as wp

    new = wp.empty_like(array)
    new.assign(values.reshape(array.numpy().shape).astype(array.numpy().dtype))
    return new


def peak_gpu_memory_bytes() -> int | None:
    import warp as wp

    device = wp.get_device()
    if device.is_cpu or not wp.is_mempool_enabled(device):
        return None
    return int(wp.get_mempool_used_mem_high(device))


def _contacts(data: Any) -> Contacts:
    contact = data.contact
    arrays = (contact.worldid, contact.geom, contact.dist, contact.pos, contact.frame)
    return warp_buffers.read_contacts(
        *(array.numpy() for array in (data.nacon, *arrays, contact.includemargin))
    )


_SNIPPET = """\
import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

m = mjw.put_model(model)
d = mjw.make_data(model, nworld=len(initial_state){sizes})
mjw.step(m, d)  # compiles
with wp.ScopedCapture() as capture:
    mjw.step(m, d)
datas = [mujoco.MjData(model) for _ in initial_state]
for data, state in zip(datas, initial_state):
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
for name in ("time", "qpos", "qvel", "act", "qacc_warmstart"):
    values = np.array([getattr(x, name) for x in datas], dtype=np.float32)
    getattr(d, name).assign(values)
ctrl = wp.array(control.transpose(1, 0, 2), dtype=wp.float32)
for k in range(control.shape[1]):
    wp.copy(d.ctrl, ctrl[k])
{launch}
wp.synchronize()"""
