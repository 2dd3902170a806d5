"""MJX: MuJoCo written in JAX, compiled by XLA for this CPU or a GPU; and Warp called from JAX.

The program is jit ∘ vmap ∘ loop over `mjx.step`, and returns the whole batched Data, so that
nothing that a step computes can be left out. The number of steps is an argument of the program: the
one that is timed also does the single steps by which it is judged. On a GPU, where XLA asks the
host before each step of such a loop, the number is compiled into the one that is timed.
"""

import os
import time
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from mjbench.errors import InputError, MachineError, one_line
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

_MATMUL = "JAX_DEFAULT_MATMUL_PRECISION"


class Mjx(AcceleratedPath):
    """MJX in float32, which is how it is usually run."""

    name = "mjx"
    summary = "MJX: jit(vmap(loop of mjx.step)), float32"
    precision = "float32"
    extra = "mjx"
    engine = "MJX"
    packages: ClassVar[tuple[str, ...]] = ("jax", "mujoco.mjx")
    usual = True
    impl: ClassVar[str] = "jax"
    compiles_at_first: ClassVar[bool] = False

    def environment(self) -> dict[str, str | None]:
        """Return variables that set the precision, and keep no compiled program between runs."""
        return {
            "JAX_ENABLE_X64": "1" if self.precision == "float64" else "0",
            "JAX_COMPILATION_CACHE_DIR": None,
            "JAX_ENABLE_COMPILATION_CACHE": "0",
            # Else a GPU's memory is no figure, and Warp, called from JAX, has what is left.
            "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
            # Else a GPU multiplies in TF32, which has a thousandth of float32's precision.
            _MATMUL: _matmul(),
        }

    def device_kind(self) -> str:
        """Return the platform of JAX's first device."""
        import jax

        try:
            return str(jax.devices()[0].platform)
        except Exception as error:  # an assertion without a word, where a plug-in is missing
            said = one_line(error) or type(error).__name__
            raise MachineError(f"JAX finds no device: {said}") from error

    def counts_on_host(self) -> bool:
        """Return whether a loop as often as an argument says goes by way of the host."""
        return self.device_kind() != "cpu"

    def fields(self, model: Any) -> Mapping[str, Any]:
        """Return MJX's Data of a model."""
        self._put(model)
        return dict(vars(self._data(model, self._room(Peaks(1, 1), 1))))

    def compiled(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Trace and compile the program; see the module."""
        import jax
        from mujoco import mjx

        jax.config.update("jax_enable_x64", self.precision == "float64")
        model, hold = self._put(workload.model), workload.hold
        room = self._room(peaks, workload.nbatch)
        empty = self._data(workload.model, room)
        leaves = {name: value for name, value in vars(empty).items() if hasattr(value, "dtype")}
        if leaves["qpos"].dtype != self.precision:
            raise InputError(f"JAX computes in {leaves['qpos'].dtype}, not {self.precision}")

        def on_device(found: Mapping[str, np.ndarray]) -> dict[str, Any]:
            kept = taken(found, leaves, self.engine)
            return {
                name: jax.device_put(
                    values.reshape(-1, *leaves[name].shape).astype(leaves[name].dtype)
                )
                for name, values in kept.items()
            }

        def step(data: Any, ctrl: Any) -> Any:
            return mjx.step(model, data.replace(ctrl=ctrl))

        def program(settled: Any, count: int | None) -> Any:
            def rollout(start: Any, control: Any, nstep: Any) -> Any:
                data, end = settled(empty.replace(**start)), nstep if count is None else count
                return jax.lax.fori_loop(0, end, lambda k, d: step(d, control[k // hold]), data)

            return jax.jit(jax.vmap(rollout, in_axes=(0, 0, None)), donate_argnums=0)

        def lowered(count: int | None) -> tuple[Any, float]:
            begin = time.perf_counter()
            try:
                found = program(lambda data: data, count).lower(origin, control, nstep)
            except TypeError:  # make_data's types are not those that a step gives back
                settled = _settled(lambda data: step(data, data.ctrl), empty)
                begin = time.perf_counter()
                found = program(settled, count).lower(origin, control, nstep)
            return found, time.perf_counter() - begin

        dtype = leaves["ctrl"].dtype
        origin = on_device(start_fields(workload))
        control = jax.device_put(workload.control.astype(dtype))
        nstep = jax.device_put(np.int32(workload.nstep))
        fixed = self.counts_on_host()
        to_compile, trace_s = lowered(workload.nstep if fixed else None)
        begin = time.perf_counter()
        timed = to_compile.compile()
        compile_s = time.perf_counter() - begin
        checked = lowered(None)[0].compile() if fixed else timed
        if self.compiles_at_first:
            first = jax.tree.map(jax.numpy.copy, origin)
            begin = time.perf_counter()
            jax.block_until_ready(checked(first, control, jax.device_put(np.int32(1))))
            compile_s += time.perf_counter() - begin
        holder: dict[str, Any] = {}

        def clear() -> None:
            holder.clear()
            holder["start"] = jax.block_until_ready(jax.tree.map(jax.numpy.copy, origin))

        def run() -> None:
            holder["data"] = jax.block_until_ready(timed(holder.pop("start"), control, nstep))

        def final_states() -> States:
            _check_room(holder["data"])
            return final(workload, _fields(holder["data"], origin))

        def advance(
            found: Mapping[str, np.ndarray], controls: np.ndarray, count: int
        ) -> StepOutcome:
            given = jax.device_put(controls.astype(dtype))
            data = checked(on_device(found), given, jax.device_put(np.int32(count)))
            _check_room(data)
            return StepOutcome(_fields(data, origin), _contacts(data))

        device = jax.devices()[0]
        name = device.platform if device.platform == "cpu" else device.device_kind
        return Compiled(
            run,
            clear,
            final_states,
            device=name,
            trace_s=trace_s,
            compile_s=compile_s,
            exact=not fixed,
            room=room,
            gpu_memory_bytes=lambda: None if name == "cpu" else self._most_memory(device),
            advance=advance,
        )

    def snippet(self, workload: Workload, options: Options) -> str:
        """Return the program, with scan: the number of steps is fixed there.

        Args:
          workload: to run.
          options: sizes of buffers (see `Compiled.room`).
        """
        x64 = self.precision == "float64"
        config = (
            'jax.config.update("jax_enable_x64", True)\n'
            if x64
            else f'jax.config.update("jax_default_matmul_precision", "{_matmul()}")\n'
        )
        types = (  # some integers of make_data are not of the type that a step gives back
            "kinds = jax.eval_shape(lambda d: mjx.step(mx, d), empty)\n"
            "empty = jax.tree.map(lambda x, k: jax.numpy.asarray(x, k.dtype), empty, kinds)\n"
            if x64
            else ""
        )
        impl = "" if self.impl == "jax" else f', impl="{self.impl}"'
        held = (
            "    data = data.replace(ctrl=ctrl)\n"
            f"    return jax.lax.fori_loop(0, {workload.hold}, lambda _, d: mjx.step(mx, d), data),"
            " None\n"
            if workload.hold > 1
            else "    return mjx.step(mx, data.replace(ctrl=ctrl)), None\n"
        )
        return (
            "import jax\nimport mujoco\nimport numpy as np\nfrom mujoco import mjx\n\n"
            f"{config}mx = mjx.put_model(model{impl})\n"
            f"empty = mjx.make_data(model{impl}{keywords(options)})\n{types}"
            "datas = [mujoco.MjData(model) for _ in initial_state]\n"
            "for data, state in zip(datas, initial_state):\n"
            "    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)\n"
            'names = ("time", "qpos", "qvel", "act", "qacc_warmstart")\n'
            "start = {n: np.array([getattr(d, n) for d in datas]) for n in names}\n\n\n"
            "def step(data, ctrl):\n"
            f"{held}\n\n"
            "@jax.jit\n@jax.vmap\ndef rollout(start, control):\n"
            "    return jax.lax.scan(step, empty.replace(**start), control)[0]\n\n\n"
            "final = jax.block_until_ready(rollout(start, control))"
        )

    def _put(self, model: Any) -> Any:
        from mujoco import mjx

        return mjx.put_model(model, **compat.known(mjx.put_model, impl=self.impl))

    def _data(self, model: Any, room: Mapping[str, int]) -> Any:
        from mujoco import mjx

        return mjx.make_data(model, **compat.known(mjx.make_data, impl=self.impl), **room)

    def _room(self, peaks: Peaks, nbatch: int) -> dict[str, int]:
        """Return sizes of buffers, as make_data names them."""
        return {}

    def _most_memory(self, device: Any) -> int | None:
        """Return the most bytes that were taken of a GPU."""
        most = (device.memory_stats() or {}).get("peak_bytes_in_use")
        return None if most is None else int(most)


class Mjx64(Mjx):
    """MJX in float64."""

    name = "mjx64"
    summary = "MJX: jit(vmap(loop of mjx.step)), float64"
    precision = "float64"


class MjxWarp(Mjx):
    """MuJoCo Warp, called by MJX."""

    name = "mjx_warp"
    summary = "MJX with impl=warp: MuJoCo Warp called from JAX, float32"
    extra = "mjx,warp"
    usual = False
    packages: ClassVar[tuple[str, ...]] = ("jax", "mujoco.mjx", "mujoco_warp", "warp")
    impl = "warp"
    compiles_at_first = True  # Warp's kernels, when the program first calls them

    def compiled(self, workload: Workload, options: Options, peaks: Peaks) -> Compiled:
        """Trace and compile the program, and Warp's kernels with it."""
        from mjbench.paths.warp import quiet_and_uncached

        quiet_and_uncached()
        return super().compiled(workload, options, peaks)

    def _room(self, peaks: Peaks, nbatch: int) -> dict[str, int]:
        from mujoco import mjx

        room = room_for(peaks, nbatch)
        return compat.known(mjx.make_data, nconmax=room["naconmax"], **room)  # one, by release

    def _most_memory(self, device: Any) -> int | None:
        from mjbench.paths.warp import most_memory

        parts = (super()._most_memory(device), most_memory())
        return sum(part for part in parts if part) or None


def _matmul() -> str:
    """Return the precision of products of matrices in float32, unless the user names another."""
    return os.environ.get(_MATMUL, "highest")


def _settled(step: Any, empty: Any) -> Any:
    """Return a function that gives Data the types that a step gives it.

    Those that make_data gives some integers differ in float64, and a loop needs types that stay.
    """
    import jax

    after = jax.eval_shape(step, empty)

    def settled(data: Any) -> Any:
        return jax.tree.map(lambda value, kept: jax.numpy.asarray(value, kept.dtype), data, after)

    return settled


def _fields(data: Any, kept: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return batched Data as (nbatch, size) float64 arrays by field: those kept, and controls."""
    found = {}
    for name in (*kept, "ctrl"):
        values = np.asarray(getattr(data, name), dtype=np.float64)
        found[name] = values.reshape(len(values), -1)
    return found


def _check_room(data: Any) -> None:
    """Refuse a result for which a buffer of Warp's was too small."""
    inner = compat.mjx_own(data)
    if hasattr(inner, "overflow"):
        check_overflow(np.asarray(inner.overflow))
    elif hasattr(inner, "nacon"):
        raise MachineError("this MJX does not tell whether a buffer of Warp's was too small")


def _contacts(data: Any) -> Contacts | None:
    """Return the contacts of batched Data that are close enough to count."""
    inner = compat.mjx_own(data)
    if hasattr(inner, "nacon"):  # of Warp: those of all simulations in one list
        names = ("worldid", "geom", "frame", "dist", "includemargin")
        return listed_contacts(inner.nacon, *(getattr(inner, f"contact__{n}") for n in names))
    contact = getattr(inner, "contact", None)
    if contact is None:
        return None
    near = np.asarray(contact.dist) < np.asarray(contact.includemargin)
    simulation, slot = np.nonzero(near)
    frame = np.asarray(contact.frame).reshape(*near.shape, 9)
    return Contacts.of(simulation, np.asarray(contact.geom)[near], frame[simulation, slot, :3])
