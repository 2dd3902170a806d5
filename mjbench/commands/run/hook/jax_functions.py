"""What a program spends on JAX: compilation, calls of compiled functions, waits and transfers.

JAX itself says how long it traces and compiles. The other calls are timed in bursts, like steps.
Only what `jax.jit` returns to the user's own code is replaced, not what packages compile.
"""

import os
import sys
import time
from _thread import get_ident
from collections.abc import Callable, Mapping, Sequence
from types import FrameType, MethodType, ModuleType
from typing import Any

from .argument_types import ArgumentTypes, Change
from .call_bursts import CallBursts, cold_cost_ns
from .call_clock import COMPILE, DEVICE_WAIT, DISPATCH, RECOMPILED, TRACE, TRANSFER, CallClock
from .function_replacement import named_like, suppress

# What JAX calls its events, and the callee that each belongs to; after the second it compiles.
_LOWERED = "/jax/core/compile/jaxpr_to_mlir_module_duration"
_EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": TRACE,
    _LOWERED: TRACE,
    "/jax/core/compile/backend_compile_duration": COMPILE,
}
# Seconds from which a compilation is that of a large function, such as steps of an environment that
# a package compiles. Small ones create arrays.
_LARGE_COMPILE_S = 1.0
# Functions that are compiled within each other.
_MOST_NESTED = 100
# Methods of an array that wait until it is computed, and copy it to Python.
_WAITING_METHODS = (
    "__array__",
    "__bool__",
    "__complex__",
    "__float__",
    "__index__",
    "__int__",
    "block_until_ready",
    "item",
    "tolist",
)


_NONE = object()  # stands for an argument that is not given


class JaxFunctions:
    """Times the calls of JAX in this process."""

    def __init__(
        self,
        calls: CallClock,
        now_ns: Callable[[], int] = time.perf_counter_ns,
        processor_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        self._calls, self._now_ns = calls, now_ns
        self.bursts = CallBursts(calls, now_ns, processor_ns)
        calls.step_counts.append(self.bursts.count)
        self.begin_process()

    def begin_process(self) -> None:
        self.bursts.begin_process()
        self._compilations: list[tuple[int, int]] = []
        self._compiled_ns: dict[int, int] = {}  # by thread

    def install(self, module: ModuleType) -> None:
        import numpy
        from jax import monitoring

        monitoring.register_event_duration_secs_listener(self.note_event)
        self._calibrate()
        module.jit = self._jit(module.jit)  # type: ignore[attr-defined]
        self._replace(module, "block_until_ready", DEVICE_WAIT)
        self._replace(module, "device_get", DEVICE_WAIT)
        self._replace(module, "device_put", TRANSFER)
        # not of an array: to create one would start a device, which the program may yet choose
        array_type = getattr(sys.modules.get("jax._src.array"), "ArrayImpl", None)
        for name in _WAITING_METHODS:
            self._replace(array_type, name, DEVICE_WAIT)
        for name in ("asarray", "array"):
            setattr(module.numpy, name, self._to_device(getattr(module.numpy, name)))
            # NumPy reads an array that is in the host's memory without calling its methods; Numba
            # compiles calls of the functions that it knew when it was imported
            if array_type is not None and "numba" not in sys.modules:
                setattr(numpy, name, self._to_host(getattr(numpy, name), array_type))

    def _replace(self, owner: Any, name: str, callee: str) -> None:
        original = getattr(owner, name, None)
        if original is not None:
            with suppress(AttributeError, TypeError):
                setattr(owner, name, self._timed(original, callee))

    def _to_host(self, function: Any, array_type: type) -> Any:
        # with the names of its first arguments: most calls have no others
        def call(a: Any = _NONE, /, dtype: Any = None, *args: Any, **kwargs: Any) -> Any:
            if type(a) is array_type:
                arguments = (a, dtype, *args)
                return self.count(function, arguments, kwargs, DEVICE_WAIT, sys._getframe(1))
            if a is _NONE:
                return function(dtype=dtype, **kwargs)
            if args or kwargs:
                return function(a, dtype, *args, **kwargs)
            return function(a, dtype)

        return named_like(function, call)

    def _to_device(self, function: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            # arrays and tracers of JAX are on the device
            if not args or type(args[0]).__module__.startswith("jax"):
                return function(*args, **kwargs)
            return self.count(function, args, kwargs, TRANSFER, sys._getframe(1))

        return named_like(function, call)

    def _timed(self, function: Any, callee: str) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            return self.count(function, args, kwargs, callee, sys._getframe(1))

        return named_like(function, call)

    def _jit(self, jit: Any) -> Any:
        """Return what stands for `jax.jit`: in the user's own code, calls of its result count."""

        def call(*args: Any, **kwargs: Any) -> Any:
            result = jit(*args, **kwargs)
            if not self._calls.owns(sys._getframe(1).f_code.co_filename):
                return result
            if hasattr(result, "lower"):
                return CompiledFunction(result, self)
            if not args:  # it returns a decorator
                return lambda function: CompiledFunction(result(function), self)
            return result

        return named_like(jit, call)

    def count(
        self,
        function: Any,
        args: Sequence[Any],
        kwargs: Mapping[str, Any],
        callee: str,
        frame: FrameType,
    ) -> Any:
        """Call a function, timed in bursts; calls inside another that is timed are part of it."""
        bursts = self.bursts
        for _ in bursts.pacer.passes:
            return function(*args, **kwargs)
        thread, calls = get_ident(), self._calls
        if thread in calls.inside:
            return function(*args, **kwargs)
        bursts.begin()
        calls.inside.add(thread)
        compiled_ns = self._compiled_ns.get(thread, 0)
        begin_ns = self._now_ns()
        try:
            return function(*args, **kwargs)
        finally:
            end_ns = self._now_ns()
            calls.inside.discard(thread)
            # what was compiled meanwhile counts as that
            begin_ns += self._compiled_ns.get(thread, 0) - compiled_ns
            bursts.add(callee, frame, min(begin_ns, end_ns), end_ns)
            if callee == DISPATCH:
                calls.note_compiled(end_ns)

    def compiled_ns(self) -> int:
        """Return how long JAX has traced and compiled in this thread."""
        return self._compiled_ns.get(get_ident(), 0)

    def begin_compilation(self, frame: FrameType | None) -> None:
        """Note that a function is compiled again, and why: it may take longer than the program."""
        while frame is not None and frame.f_code is not CompiledFunction.__call__.__code__:
            frame = frame.f_back
        if frame is not None:
            call = frame.f_locals
            changes = call["self"].begin_compilation(
                call["args"], call["kwargs"], call["earlier_ns"]
            )
            if changes is not None:
                now_ns = self._now_ns()
                line = frame.f_back
                self._calls.add(RECOMPILED, line, now_ns, now_ns, 1, calls=0, detail=changes)

    def end_compilation(self, compiled_ns: int, frame: FrameType) -> None:
        end_ns = self._now_ns()
        self._calls.add(RECOMPILED, frame, end_ns - compiled_ns, end_ns)

    def end(self) -> None:
        self.bursts.end()

    def _calibrate(self) -> None:
        calls = CallClock(os.devnull, self._now_ns)
        calls.is_own[__file__] = True
        scratch = JaxFunctions(calls, self._now_ns, lambda: 0)

        def nothing() -> None:
            return None

        timed = scratch._timed(nothing, DISPATCH)
        self.bursts.call_cost_ns = max(0, cold_cost_ns(timed, nothing, self._now_ns))
        scratch.bursts.pacer.let_pass(sys.maxsize)
        self.bursts.passed_cost_ns = max(0, cold_cost_ns(timed, nothing, self._now_ns))

    def note_event(self, event: str, seconds: float, **_: Any) -> None:
        """Count what JAX says that it did; what happened inside it was counted already."""
        if event not in _EVENTS:
            return
        end_ns = self._now_ns()
        begin_ns = end_ns - int(1e9 * seconds)
        inner_ns = sum(ns for begin, ns in self._compilations if begin >= begin_ns)
        earlier = [each for each in self._compilations[-_MOST_NESTED:] if each[0] < begin_ns]
        self._compilations = [*earlier, (begin_ns, end_ns - begin_ns)]
        thread, own_ns = get_ident(), end_ns - begin_ns - inner_ns
        self._compiled_ns[thread] = self._compiled_ns.get(thread, 0) + own_ns
        callee = _EVENTS[event]
        # a function that is traced and lowered is then compiled, which counts
        count = int(callee == COMPILE)
        self._calls.add(callee, sys._getframe(1), begin_ns + inner_ns, end_ns, calls=count)
        if callee == COMPILE and seconds >= _LARGE_COMPILE_S:
            self._calls.note_compiled(end_ns)
        if event == _LOWERED:
            with suppress(Exception):
                self.begin_compilation(sys._getframe(1))


class CompiledFunction:
    """A function that `jax.jit` has returned: each call counts, and all else is the function's."""

    def __init__(self, function: Any, clock: JaxFunctions) -> None:
        # as attributes of its own, for those who look for them without asking for them
        names = [name for name in dir(function) if not name.startswith("__")]
        vars(self).update({name: getattr(function, name) for name in names})
        named_like(function, self)
        self.__wrapped__ = getattr(function, "__wrapped__", function)
        self._function, self._clock = function, clock
        self._types = ArgumentTypes(self.__wrapped__)
        # of the latest call that compiled it: what had been compiled before it, and whether again
        self._begun_ns, self._is_again = -1, False

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        clock = self._clock
        earlier_ns = clock.compiled_ns()
        for _ in clock.bursts.pacer.passes:  # as in `count`, without another call
            result = self._function(*args, **kwargs)
            break
        else:
            result = clock.count(self._function, args, kwargs, DISPATCH, sys._getframe(1))
        if self._is_again and self._begun_ns == earlier_ns:
            clock.end_compilation(clock.compiled_ns() - earlier_ns, sys._getframe(1))
            self._is_again = False
        return result

    def begin_compilation(
        self, args: Sequence[Any], kwargs: Mapping[str, Any], earlier_ns: int
    ) -> Sequence[Change] | None:
        """Return how arguments of a call differ; None for a first compilation, or what is noted.

        Args:
          earlier_ns: for which JAX had compiled before the call.
        """
        if self._begun_ns == earlier_ns:
            return None
        changes = self._types.note_compiled(args, kwargs)
        self._begun_ns, self._is_again = earlier_ns, changes is not None
        return changes

    def __get__(self, owner: Any, kind: Any = None) -> Any:
        return self if owner is None else MethodType(self, owner)

    def __getattr__(self, name: str) -> Any:
        return getattr(object.__getattribute__(self, "_function"), name)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Let copies, and other processes, have the function itself."""
        return self._function.__reduce_ex__(protocol)

    def __repr__(self) -> str:
        return repr(self._function)
