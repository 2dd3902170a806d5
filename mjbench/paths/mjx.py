"""MJX: MuJoCo written in JAX, compiled by XLA for this CPU or a GPU; and Warp called from JAX."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco

from mjbench.errors import InputError, MachineError, one_line
from mjbench.paths import warp_buffers
from mjbench.paths.accelerated import CPU, AcceleratedPath, Compiled, keyword_arguments
from mjbench.paths.base import Options
from mjbench.paths.mjx_program import MjxProgram
from mjbench.simulation import compat
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.work import Peaks
from mjbench.simulation.workload import Workload

if TYPE_CHECKING:
    import jax
    from mujoco import mjx

_MATMUL = "JAX_DEFAULT_MATMUL_PRECISION"


class Mjx(AcceleratedPath):
    """MJX in float32, which is how it is usually run."""

    name = "mjx"
    summary = "MJX: jit(vmap(loop of mjx.step)), float32"
    title = "MJX in float32"
    precision = Precision.FLOAT32
    extra = "mjx"
    engine = "MJX"
    packages: ClassVar[tuple[str, ...]] = ("jax", "mujoco.mjx")
    usual = True
    impl: ClassVar[str] = "jax"
    compiles_at_first_call: ClassVar[bool] = False

    def environment(self) -> dict[str, str | None]:
        return {
            "JAX_ENABLE_X64": "1" if self.precision == Precision.FLOAT64 else "0",
            "JAX_COMPILATION_CACHE_DIR": None,
            "JAX_ENABLE_COMPILATION_CACHE": "0",
            # Otherwise JAX reserves most of a GPU's memory: its peak would mean nothing, and Warp,
            # called from JAX, would have only the rest.
            "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
            # Otherwise a GPU multiplies in TF32, with a thousandth of float32's precision.
            _MATMUL: _matmul_precision(),
        }

    def device_kind(self) -> str:
        import jax

        try:
            return str(jax.devices()[0].platform)
        except Exception as error:  # JAX raises an empty AssertionError where a plug-in is missing
            reason = one_line(error) or type(error).__name__
            raise MachineError(f"JAX finds no device: {reason}") from error

    def needs_fixed_nstep(self) -> bool:
        """Return whether a loop whose length is an argument waits for the host before each step."""
        return self.device_kind() != CPU

    def data_fields(self, model: mujoco.MjModel) -> Mapping[str, Any]:
        self.put_model(model)
        return dict(vars(self.make_data(model, self.buffer_sizes(Peaks(1, 1), 1))))

    def compile(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        import jax

        jax.config.update("jax_enable_x64", self.precision == Precision.FLOAT64)
        model = self.put_model(workload.model)
        buffer_sizes = self.buffer_sizes(peaks, workload.nbatch)
        empty = self.make_data(workload.model, buffer_sizes)
        if empty.qpos.dtype != self.precision:
            raise InputError(f"JAX computes in {empty.qpos.dtype}, not {self.precision}")
        nstep_is_fixed = self.needs_fixed_nstep()
        program = MjxProgram(workload, model, empty, nstep_is_fixed)
        first_call_s = program.first_call_s() if self.compiles_at_first_call else 0.0
        device = jax.devices()[0]
        is_cpu = device.platform == CPU
        return Compiled(
            program.run,
            program.clear,
            program.final_states,
            advance=program.advance,
            reload=program.reload,
            device=device.platform if is_cpu else device.device_kind,
            trace_s=program.trace_s,
            compile_s=program.compile_s + first_call_s,
            is_deterministic=not nstep_is_fixed,
            buffer_sizes=buffer_sizes,
            gpu_memory_bytes=lambda: None if is_cpu else self.peak_gpu_memory_bytes(device),
            cached_compile_s=program.cached_compile_s if self.impl == "jax" else lambda: None,
        )

    def put_model(self, model: mujoco.MjModel) -> "mjx.Model":
        from mujoco import mjx

        return mjx.put_model(model, **compat.known(mjx.put_model, impl=self.impl))

    def make_data(self, model: mujoco.MjModel, buffer_sizes: Mapping[str, int]) -> "mjx.Data":
        from mujoco import mjx

        return mjx.make_data(model, **compat.known(mjx.make_data, impl=self.impl), **buffer_sizes)

    def buffer_sizes(self, peaks: Peaks, nbatch: int) -> dict[str, int]:
        """Return sizes of buffers, as make_data names them."""
        return {}

    def peak_gpu_memory_bytes(self, device: "jax.Device") -> int | None:
        """Return the peak memory that JAX used on a GPU."""
        peak = (device.memory_stats() or {}).get("peak_bytes_in_use")
        return None if peak is None else int(peak)

    def snippet(self, workload: Workload, options: Options) -> str:
        """Return the program with `jax.lax.scan`, which fixes the number of steps.

        Args:
          options: sizes of buffers (see `Compiled.buffer_sizes`).
        """
        is_float64 = self.precision == Precision.FLOAT64
        matmul = f'jax.config.update("jax_default_matmul_precision", "{_matmul_precision()}")'
        return _SNIPPET.format(
            config='jax.config.update("jax_enable_x64", True)' if is_float64 else matmul,
            impl="" if self.impl == "jax" else f', impl="{self.impl}"',
            sizes=keyword_arguments(options),
            cast=_SNIPPET_CAST if is_float64 else "",
            step=_SNIPPET_HOLD.format(hold=workload.hold) if workload.hold > 1 else _SNIPPET_STEP,
        )


class Mjx64(Mjx):
    """MJX in float64."""

    name = "mjx64"
    summary = "MJX: jit(vmap(loop of mjx.step)), float64"
    title = "MJX in float64"
    precision = Precision.FLOAT64


class MjxWarp(Mjx):
    """MuJoCo Warp, called by MJX."""

    name = "mjx_warp"
    summary = "MJX with impl=warp: MuJoCo Warp called from JAX, float32"
    title = "MJX with Warp"
    extra = "mjx,warp"
    usual = False
    packages: ClassVar[tuple[str, ...]] = ("jax", "mujoco.mjx", "mujoco_warp", "warp")
    impl = "warp"
    compiles_at_first_call = True  # Warp's kernels

    def compile(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        from mjbench.paths.warp import configure_warp

        configure_warp()
        return super().compile(workload, options, peaks)

    def buffer_sizes(self, peaks: Peaks, nbatch: int) -> dict[str, int]:
        """Return sizes of Warp's buffers; releases name the one for contacts differently."""
        from mujoco import mjx

        sizes = warp_buffers.buffer_sizes(peaks, nbatch)
        return compat.known(mjx.make_data, nconmax=sizes["naconmax"], **sizes)

    def peak_gpu_memory_bytes(self, device: "jax.Device") -> int | None:
        from mjbench.paths.warp import peak_gpu_memory_bytes

        parts = (super().peak_gpu_memory_bytes(device), peak_gpu_memory_bytes())
        return sum(part for part in parts if part) or None


def _matmul_precision() -> str:
    """Return the precision of float32 matrix products: `highest` unless the user names another."""
    return os.environ.get(_MATMUL, "highest")


_SNIPPET_STEP = "    return mjx.step(mx, data.replace(ctrl=ctrl)), None"

_SNIPPET_HOLD = """\
    data = data.replace(ctrl=ctrl)
    return jax.lax.fori_loop(0, {hold}, lambda _, d: mjx.step(mx, d), data), None"""

# make_data and step give some integers different types
_SNIPPET_CAST = """\
kinds = jax.eval_shape(lambda d: mjx.step(mx, d), empty)
empty = jax.tree.map(lambda x, k: jax.numpy.asarray(x, k.dtype), empty, kinds)
"""

_SNIPPET = """\
import jax
import mujoco
import numpy as np
from mujoco import mjx

{config}
mx = mjx.put_model(model{impl})
empty = mjx.make_data(model{impl}{sizes})
{cast}datas = [mujoco.MjData(model) for _ in initial_state]
for data, state in zip(datas, initial_state):
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
names = ("time", "qpos", "qvel", "act", "qacc_warmstart")
start = {{n: np.array([getattr(d, n) for d in datas]) for n in names}}


def step(data, ctrl):
{step}


@jax.jit
@jax.vmap
def rollout(start, control):
    return jax.lax.scan(step, empty.replace(**start), control)[0]


final = jax.block_until_ready(rollout(start, control))"""
