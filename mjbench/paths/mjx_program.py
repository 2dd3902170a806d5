"""The program that MJX's paths time: jit ∘ vmap ∘ loop over `mjx.step`.

It returns the whole batched Data, so that the compiler cannot drop anything that a step computes.
The number of steps is an argument: the timed program also takes the single steps by which it is
checked. On a GPU, where XLA would ask the host before each step of such a loop, a second program
is timed, with the number compiled in.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjbench.errors import MachineError
from mjbench.paths import warp_buffers
from mjbench.paths.accelerated import (
    StepOutcome,
    start_fields,
    states_of_fields,
    supported_fields,
)
from mjbench.paths.base import States
from mjbench.simulation import compat
from mjbench.simulation.trajectory import Contacts
from mjbench.simulation.workload import Workload

if TYPE_CHECKING:
    import jax
    from mujoco import mjx


class MjxProgram:
    """The compiled program of one workload, its arguments on the device, and its last output.

    Attributes:
      trace_s: seconds from Python to the compiler's input.
      compile_s: seconds of compiling the timed program.
    """

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
        """Put the workload's start states and controls on the device."""
        self._start = self._fields_on_device(start_fields(self._workload))
        self._control = self._control_on_device(self._workload.control)

    def _fields_on_device(self, fields: Mapping[str, np.ndarray]) -> "dict[str, jax.Array]":
        """Return the fields that MJX has, in its shapes and types."""
        import jax

        return {
            name: jax.device_put(
                values.reshape(-1, *self._arrays[name].shape).astype(self._arrays[name].dtype)
            )
            for name, values in supported_fields(fields, self._arrays, "MJX").items()
        }

    def _control_on_device(self, control: np.ndarray) -> "jax.Array":
        """Return controls in MJX's type."""
        import jax

        return jax.device_put(control.astype(self._arrays["ctrl"].dtype))

    def _trace(self, nstep: int | None) -> "tuple[jax.stages.Lowered, float]":
        """Return the traced program, ready to compile, and the seconds that tracing took.

        Args:
          nstep: the number to compile in; None to leave it an argument.
        """
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
        """Return the jitted function of `start`, `control` and `nstep`."""
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
        """Return a function that casts Data to the types that a step returns.

        In float64, make_data and step give some integers different types.
        """
        import jax

        after = jax.eval_shape(lambda data: self._step(data, data.ctrl), self._empty)

        def cast(data: "mjx.Data") -> "mjx.Data":
            return jax.tree.map(lambda value, to: jax.numpy.asarray(value, to.dtype), data, after)

        return cast

    def first_call_s(self) -> float:
        """Return the seconds of a first call, of one step."""
        start, nstep = self._copy_of_start(), _count_on_device(1)
        begin = time.perf_counter()
        self._block_until_ready(self._any_nstep(start, self._control, nstep))
        return time.perf_counter() - begin

    def cached_compile_s(self) -> float:
        """Return the seconds of compiling the timed program where it is in JAX's cache.

        The cache is a new folder inside the current one, and is filled first. Tracing does not use
        it.
        """
        import jax
        from jax.experimental.compilation_cache import compilation_cache

        jax.config.update("jax_compilation_cache_dir", tempfile.mkdtemp(dir=Path.cwd()))
        jax.config.update("jax_enable_compilation_cache", True)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
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
        """Run the timed program; each run needs a `clear` before it."""
        start, self._input = self._input, None
        self._output = self._block_until_ready(self._timed(start, self._control, self._nstep))

    def final_states(self) -> States:
        """Return the states that the last run ended in."""
        _check_buffers(self._output)
        return states_of_fields(self._workload, self._fields(self._output))

    def advance(
        self, fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
    ) -> StepOutcome:
        """Take `nstep` steps from other states (see `Compiled.advance`)."""
        data = self._any_nstep(
            self._fields_on_device(fields),
            self._control_on_device(control),
            _count_on_device(nstep),
        )
        _check_buffers(data)
        return StepOutcome(self._fields(data), _contacts(data))

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
    """Return a number of steps as the program takes it."""
    import jax

    return jax.device_put(np.int32(nstep))


def _check_buffers(data: "mjx.Data") -> None:
    """Reject a result for which one of Warp's buffers was too small."""
    own = compat.mjx_own(data)
    if hasattr(own, "overflow"):
        warp_buffers.check_overflow(np.asarray(own.overflow))
    elif hasattr(own, "nacon"):
        raise MachineError(
            "this release of MJX does not report whether one of Warp's buffers was too small"
        )


def _contacts(data: "mjx.Data") -> Contacts | None:
    """Return the contacts of batched Data that are near enough to count."""
    own = compat.mjx_own(data)
    if hasattr(own, "nacon"):  # of Warp: the contacts of all simulations in one list
        names = ("worldid", "geom", "frame", "dist", "includemargin")
        return warp_buffers.read_contacts(
            own.nacon, *(getattr(own, f"contact__{n}") for n in names)
        )
    contact = getattr(own, "contact", None)
    if contact is None:
        return None
    near = np.asarray(contact.dist) < np.asarray(contact.includemargin)
    simulation, slot = np.nonzero(near)
    frame = np.asarray(contact.frame).reshape(*near.shape, 9)
    return Contacts.of(simulation, np.asarray(contact.geom)[near], frame[simulation, slot, :3])
