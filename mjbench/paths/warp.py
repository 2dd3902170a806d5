"""MuJoCo Warp: MuJoCo written in NVIDIA Warp, for a CUDA GPU; it runs on a CPU as well."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjbench.paths.accelerated import (
    AcceleratedPath,
    Compiled,
    StepOutcome,
    check_overflow,
    final,
    keywords,
    listed_contacts,
    room_for,
    start_fields,
    taken,
)
from mjbench.paths.base import Options, States
from mjbench.simulation import compat
from mjbench.simulation.trajectory import Contacts
from mjbench.simulation.work import Peaks
from mjbench.simulation.workload import Workload


class Warp(AcceleratedPath):
    """MuJoCo Warp by itself; a step is a captured graph, on a GPU and on a CPU."""

    name = "warp"
    summary = "MuJoCo Warp: mujoco_warp.step over all worlds as a captured graph, float32"
    precision = "float32"
    extra = "warp"
    engine = "MuJoCo Warp"
    packages = ("warp", "mujoco_warp")

    def device_kind(self) -> str:
        """Return the kind of Warp's own choice of device."""
        import warp as wp

        _quiet()
        return "cpu" if wp.get_device().is_cpu else "cuda"

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Return also that Warp keeps asleep from one run to the next what slept at its end."""
        if compat.has_sleep(workload.model):
            return "which trees sleep is not part of a state, and stays from run to run"
        return super().unsuited(workload, options)

    def fields(self, model: Any) -> Mapping[str, Any]:
        """Return MuJoCo Warp's Data of a model."""
        import mujoco_warp

        _quiet()
        mujoco_warp.put_model(model)
        return dict(vars(mujoco_warp.make_data(model)))

    def compiled(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Compile the kernels anew by a first step, then capture one as a graph."""
        import mujoco_warp
        import warp as wp

        quiet_and_uncached()
        nbatch, hold = workload.nbatch, workload.hold
        begin = time.perf_counter()
        model = mujoco_warp.put_model(workload.model)
        room = room_for(peaks, nbatch)
        data = mujoco_warp.make_data(workload.model, nworld=nbatch, **room)
        wp.synchronize()
        made = time.perf_counter()
        mujoco_warp.step(model, data)
        with wp.ScopedCapture() as capture:
            mujoco_warp.step(model, data)
        wp.synchronize()
        compiled = time.perf_counter()
        arrays = {n: v for n, v in vars(data).items() if isinstance(v, wp.array)}

        def on_device(found: Mapping[str, np.ndarray]) -> dict[str, Any]:
            return {
                name: _like(arrays[name], values)
                for name, values in taken(found, arrays, self.engine).items()
            }

        def controls_on_device(controls: np.ndarray) -> list[Any]:
            return [_like(data.ctrl, controls[:, k]) for k in range(controls.shape[1])]

        origin, controls = on_device(start_fields(workload)), controls_on_device(workload.control)

        def rollout(start: Mapping[str, Any], held: Sequence[Any], nstep: int) -> None:
            for name, values in start.items():
                wp.copy(arrays[name], values)
            for k in range(nstep):
                if k % hold == 0:
                    wp.copy(data.ctrl, held[k // hold])
                wp.capture_launch(capture.graph)
            wp.synchronize()

        def run() -> None:
            rollout(origin, controls, workload.nstep)

        def clear() -> None:
            data.overflow.zero_()
            for name in origin:
                if name != "eq_active":
                    arrays[name].fill_(float("nan"))
            wp.synchronize()

        def found() -> dict[str, np.ndarray]:
            check_overflow(data.overflow.numpy())
            return {
                name: np.asarray(arrays[name].numpy(), dtype=np.float64).reshape(nbatch, -1)
                for name in (*origin, "ctrl")
            }

        def final_states() -> States:
            return final(workload, found())

        def advance(
            given: Mapping[str, np.ndarray], control: np.ndarray, count: int
        ) -> StepOutcome:
            data.overflow.zero_()
            rollout(on_device(given), controls_on_device(control), count)
            return StepOutcome(found(), _contacts(data))

        device = wp.get_device()
        return Compiled(
            run,
            clear,
            final_states,
            device="cpu" if device.is_cpu else device.name,
            trace_s=made - begin,
            compile_s=compiled - made,
            exact=device.is_cpu,
            room=room,
            gpu_memory_bytes=most_memory,
            advance=advance,
        )

    def snippet(self, workload: Workload, options: Options) -> str:
        """Return the loop over a captured step.

        Args:
          workload: to run.
          options: sizes of buffers (see `Compiled.room`).
        """
        spec = "mujoco.mjtState.mjSTATE_INTEGRATION"
        times = (
            f"\n    for _ in range({workload.hold}):\n        " if workload.hold > 1 else "\n    "
        )
        return (
            "import mujoco\nimport mujoco_warp as mjw\nimport numpy as np\nimport warp as wp\n\n"
            "m = mjw.put_model(model)\n"
            f"d = mjw.make_data(model, nworld=len(initial_state){keywords(options)})\n"
            "mjw.step(m, d)  # compiles\n"
            "with wp.ScopedCapture() as capture:\n"
            "    mjw.step(m, d)\n"
            "datas = [mujoco.MjData(model) for _ in initial_state]\n"
            "for data, state in zip(datas, initial_state):\n"
            f"    mujoco.mj_setState(model, data, state, {spec})\n"
            'for name in ("time", "qpos", "qvel", "act", "qacc_warmstart"):\n'
            "    values = np.array([getattr(x, name) for x in datas], dtype=np.float32)\n"
            "    getattr(d, name).assign(values)\n"
            "ctrl = wp.array(control.transpose(1, 0, 2), dtype=wp.float32)\n"
            "for k in range(control.shape[1]):\n"
            f"    wp.copy(d.ctrl, ctrl[k]){times}wp.capture_launch(capture.graph)\n"
            "wp.synchronize()"
        )


def quiet_and_uncached() -> None:
    """Have Warp print warnings alone, and compile anew: the figure is that of an empty cache.

    Its cache is a folder where this process stands, which goes with it (see `isolate`).
    """
    import tempfile

    import warp as wp

    _quiet()
    wp.config.kernel_cache_dir = tempfile.mkdtemp(prefix="warp-", dir=Path.cwd())


def _quiet() -> None:
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING


def _like(array: Any, values: np.ndarray) -> Any:
    """Return a Warp array of the shape and type of another, with these values."""
    import warp as wp

    made = wp.empty_like(array)
    made.assign(values.reshape(array.numpy().shape).astype(array.numpy().dtype))
    return made


def most_memory() -> int | None:
    """Return the most bytes that Warp took of a GPU's pool of memory; None on a CPU."""
    import warp as wp

    device = wp.get_device()
    if device.is_cpu or not wp.is_mempool_enabled(device):
        return None
    return int(wp.get_mempool_used_mem_high(device))


def _contacts(data: Any) -> Contacts:
    """Return the contacts of the last step that are close enough to count."""
    of = data.contact
    arrays = (data.nacon, of.worldid, of.geom, of.frame, of.dist, of.includemargin)
    return listed_contacts(*(array.numpy() for array in arrays))
