"""MJX: MuJoCo written in JAX, compiled by XLA for this CPU or a GPU; and Warp called from JAX.

The program that is timed is jit ∘ vmap ∘ loop over `mjx.step`. It returns the whole batched Data,
so that the compiler cannot drop anything that a step computes. The number of steps is an argument:
the timed program also takes the single steps by which it is checked. On a GPU, where XLA would ask
the host before each step of such a loop, a second program is timed, with the number compiled in.
"""

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from mjbench.errors import InputError, MachineError, one_line
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
from mjbench.paths.warp import CACHE_VARIABLE
from mjbench.simulation import compat
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_run import Peaks
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
    distributions: ClassVar[tuple[str, ...]] = ("mujoco", "mujoco-mjx", "jax")
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
            # Otherwise a GPU multiplies in TF32, which keeps 10 bits of float32's 23.
            _MATMUL: _matmul_precision(),
        }

    def use_cache(self, folder: Path) -> None:
        use_jax_cache(folder)

    def device_kind(self) -> str:
        import jax

        try:
            return str(jax.devices()[0].platform)
        except Exception as error:  # JAX raises an empty AssertionError where a plug-in is missing
            reason = one_line(error) or type(error).__name__
            raise MachineError(f"JAX finds no device: {reason}") from error

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Reject also noslip iterations, which MJX ignores."""
        if self.impl == "jax" and workload.model.opt.noslip_iterations > 0:
            return "MJX does not take this model: it ignores noslip_iterations"
        return super().unsuited(workload, options)

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
            workload=workload,
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
        return {}

    def peak_gpu_memory_bytes(self, device: "jax.Device") -> int | None:
        peak = (device.memory_stats() or {}).get("peak_bytes_in_use")
        return None if peak is None else int(peak)

    def snippet(self, workload: Workload, options: Options) -> str:
        """Return the program with `jax.lax.scan`; options are sizes of buffers."""
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
    distributions = ("mujoco", "mujoco-mjx", "mujoco-warp", "jax", "warp-lang")
    impl = "warp"
    compiles_at_first_call = True  # Warp's kernels

    def environment(self) -> dict[str, str | None]:
        return {**super().environment(), CACHE_VARIABLE: None}

    def use_cache(self, folder: Path) -> None:
        super().use_cache(folder)
        os.environ[CACHE_VARIABLE] = str(folder)

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


def use_jax_cache(folder: Path) -> None:
    """See `AcceleratedPath.use_cache`."""
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _matmul_precision() -> str:
    return os.environ.get(_MATMUL, "highest")


class MjxProgram:
    """The compiled program of one workload, its arguments on the device, and its last output."""

    def __init__(
        self, workload: Workload, model: "mjx.Model", empty: "mjx.Data", nstep_is_fixed: bool
    ):
        """Put the workload's start and controls on the device, and compile.

        Args:
          empty: MJX's Data of one simulation, whose fields the start replaces.
          nstep_is_fixed: compile the number of steps into the timed program, and a second program,
            which takes it as an argument, for `advance`.
        """
        import jax

        self._workload, self._model, self._empty = workload, model, empty
        self._arrays = {n: v for n, v in vars(empty).items() if hasattr(v, "dtype")}
        self._block_until_ready = jax.block_until_ready
        self.reload()
        self._nstep = _count_on_device(workload.nstep)
        self._fixed_nstep = workload.nstep if nstep_is_fixed else None
        traced, self.trace_s = self._trace(self._fixed_nstep)
        begin = time.perf_counter()
        self._timed = traced.compile()
        self.compile_s = time.perf_counter() - begin
        self._any_nstep = self._trace(None)[0].compile() if nstep_is_fixed else self._timed
        self._input: Any = None
        self._output: Any = None

    def reload(self) -> None:
        self._start = self._fields_on_device(start_fields(self._workload))
        self._control = self._control_on_device(self._workload.control)

    def _fields_on_device(self, fields: Mapping[str, np.ndarray]) -> "dict[str, jax.Array]":
        import jax

        on_device = {}
        for name, values in supported_fields(fields, self._arrays, "MJX").items():
            like = self._arrays[name]
            on_device[name] = jax.device_put(values.reshape(-1, *like.shape).astype(like.dtype))
        return on_device

    def _control_on_device(self, control: np.ndarray) -> "jax.Array":
        import jax

        return jax.device_put(control.astype(self._arrays["ctrl"].dtype))

    def _trace(self, nstep: int | None) -> "tuple[jax.stages.Lowered, float]":
        """Return the traced program, and the seconds it took; None leaves `nstep` an argument."""
        begin = time.perf_counter()
        arguments = (self._start, self._control, self._nstep)
        try:
            traced = self._jitted(lambda data: data, nstep).lower(*arguments)
        except TypeError:  # the loop's Data must have the same types before and after a step
            cast = self._cast_to_step_types()
            begin = time.perf_counter()
            traced = self._jitted(cast, nstep).lower(*arguments)
        return traced, time.perf_counter() - begin

    def _step(self, data: "mjx.Data", ctrl: "jax.Array") -> "mjx.Data":
        from mujoco import mjx

        return mjx.step(self._model, data.replace(ctrl=ctrl))

    def _jitted(self, cast: Callable[[Any], Any], fixed_nstep: int | None) -> Any:
        import jax

        hold = self._workload.hold

        def rollout(
            start: "dict[str, jax.Array]", control: "jax.Array", nstep: "jax.Array"
        ) -> "mjx.Data":
            data = cast(self._empty.replace(**start))
            end = nstep if fixed_nstep is None else fixed_nstep
            return jax.lax.fori_loop(0, end, lambda k, d: self._step(d, control[k // hold]), data)

        return jax.jit(jax.vmap(rollout, in_axes=(0, 0, None)), donate_argnums=0)

    def _cast_to_step_types(self) -> Callable[[Any], Any]:
        import jax

        after = jax.eval_shape(lambda data: self._step(data, data.ctrl), self._empty)

        def cast(data: "mjx.Data") -> "mjx.Data":
            return jax.tree.map(lambda value, to: jax.numpy.asarray(value, to.dtype), data, after)

        return cast

    def first_call_s(self) -> float:
        start, nstep = self._copy_of_start(), _count_on_device(1)
        begin = time.perf_counter()
        self._block_until_ready(self._any_nstep(start, self._control, nstep))
        return time.perf_counter() - begin

    def cached_compile_s(self) -> float:
        """Return the seconds of compiling the timed program where a cache, filled first, has it."""
        from jax.experimental.compilation_cache import compilation_cache

        use_jax_cache(Path(tempfile.mkdtemp(dir=Path.cwd())))
        compilation_cache.reset_cache()
        self._trace(self._fixed_nstep)[0].compile()
        again, _ = self._trace(self._fixed_nstep)
        begin = time.perf_counter()
        again.compile()
        return time.perf_counter() - begin

    def clear(self) -> None:
        """Drop the output of the last run, and copy the start for the next: a run overwrites it."""
        self._input = self._output = None
        self._input = self._block_until_ready(self._copy_of_start())

    def run(self) -> None:
        start, self._input = self._input, None
        self._output = self._block_until_ready(self._timed(start, self._control, self._nstep))

    def final_states(self) -> States:
        _check_buffers(self._output)
        return states_of_fields(self._workload, self._fields(self._output))

    def advance(
        self, fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
    ) -> StepOutcome:
        """Take `nstep` steps from other states (see `Compiled.advance`)."""
        start, controls = self._fields_on_device(fields), self._control_on_device(control)
        data = self._any_nstep(start, controls, _count_on_device(nstep))
        _check_buffers(data)
        return StepOutcome(
            self._fields(data),
            _contacts(data),
            np.asarray(data.qacc, dtype=np.float64),
            np.asarray(data.qfrc_constraint, dtype=np.float64),
        )

    def _copy_of_start(self) -> "dict[str, jax.Array]":
        import jax

        start: dict[str, jax.Array] = jax.tree.map(jax.numpy.copy, self._start)
        return start

    def _fields(self, data: "mjx.Data") -> dict[str, np.ndarray]:
        """Return the start's fields and the controls of batched Data, (nbatch, size) in float64."""
        fields = {}
        for name in (*self._start, "ctrl"):
            values = np.asarray(getattr(data, name), dtype=np.float64)
            fields[name] = values.reshape(len(values), -1)
        return fields


def _count_on_device(nstep: int) -> "jax.Array":
    import jax

    return jax.device_put(np.int32(nstep))


def _check_buffers(data: "mjx.Data") -> None:
    own = compat.mjx_own(data)
    if hasattr(own, "overflow"):
        warp_buffers.check_overflow(np.asarray(own.overflow))
    elif hasattr(own, "nacon"):
        raise MachineError(
            "this release of MJX does not report whether one of Warp's buffers was too small"
        )


def _contacts(data: "mjx.Data") -> Contacts | None:
    own = compat.mjx_own(data)
    if hasattr(own, "nacon"):  # of Warp: the contacts of all simulations in one list
        names = ("worldid", "geom", "dist", "pos", "frame", "includemargin")
        return warp_buffers.read_contacts(
            own.nacon, *(getattr(own, f"contact__{n}") for n in names)
        )
    contact = getattr(own, "contact", None)
    if contact is None:
        return None
    near = np.asarray(contact.dist) < np.asarray(contact.includemargin)
    simulation, slot = np.nonzero(near)
    arrays = (contact.geom, contact.dist, contact.pos, contact.frame)
    return Contacts.of(simulation, *(np.asarray(each)[simulation, slot] for each in arrays))


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
