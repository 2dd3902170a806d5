"""Functions of MuJoCo that take much longer than a step: each call is timed."""

import os
import sys
import time
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

from .call_clock import (
    CALLBACKS,
    COPIES_OF_DATA,
    COPY_OF_DATA,
    DEEP_COPY_OF_DATA,
    DRAWERS,
    EAGER_MJX,
    PROCESS_START,
    THREADED_ROLLOUT,
    CallClock,
)
from .function_replacement import named_like, suppress
from .watch import Watch

# Methods: class of the module `mujoco`, method, callee.
_METHODS = (
    ("MjData", "__init__", "MjData"),
    ("MjData", "__copy__", COPY_OF_DATA),
    ("MjData", "__deepcopy__", DEEP_COPY_OF_DATA),
    ("MjModel", "__copy__", "copy of MjModel"),
    ("MjModel", "__deepcopy__", "copy of MjModel"),
    ("MjSpec", "compile", "compile"),
    ("MjSpec", "recompile", "compile"),
    ("Renderer", "__init__", "Renderer"),
    ("Renderer", "update_scene", "update_scene"),
    ("Renderer", "render", "render"),
)
_CONSTRUCTORS = (
    ("MjModel", "from_xml_path"),
    ("MjModel", "from_xml_string"),
    ("MjModel", "from_binary_path"),
    ("MjSpec", "from_file"),
    ("MjSpec", "from_string"),
)


class RareCalls:
    """Replaces the slow functions of MuJoCo in this process."""

    def __init__(self, calls: CallClock, watch: Watch) -> None:
        self._calls, self._watch = calls, watch
        self._callback_code: Any = self  # of what times a callback; at first, of nothing

    def install(self, module: ModuleType) -> None:
        for class_name, method, callee in _METHODS:
            self._replace(getattr(module, class_name, None), method, callee)
        for class_name, method in _CONSTRUCTORS:
            self._replace(getattr(module, class_name, None), method, method, staticmethod)
        for name in CALLBACKS:
            setter = getattr(module, f"set_{name}", None)
            if setter is not None:
                setattr(module, f"set_{name}", self._setting(setter, name))
                getter = getattr(module, f"get_{name}")
                setattr(module, f"get_{name}", self._getting(getter))

    def _replace(self, owner: Any, method: str, callee: str, kind: Any = lambda call: call) -> None:
        original = getattr(owner, method, None)
        if original is None:
            return
        before = self._keep_copied if callee in COPIES_OF_DATA else None
        before = self._keep_drawn if callee in ("update_scene", "render") else before
        detail = _frame_size if callee in DRAWERS else None
        with suppress(AttributeError, TypeError):
            timed = self._calls.slow(original, callee, before=before, detail=detail)
            setattr(owner, method, kind(timed))

    def _keep_copied(self, args: Sequence[Any]) -> None:
        self._watch.keep_state(args[0].model, args[0], "copied")

    def _keep_drawn(self, args: Sequence[Any]) -> None:
        """Keep a state of what is drawn: a program that draws each step may end before a burst."""
        drawer, *given = args  # of Gymnasium, which has the data, or of MuJoCo
        if given:
            self._watch.keep_state(drawer.model, getattr(drawer, "data", given[0]))

    def _setting(self, setter: Any, name: str) -> Any:
        def set_callback(function: Any) -> Any:
            if hasattr(function, "__code__"):
                function = self._calls.callback(function, name)
                self._callback_code = function.__code__
            return setter(function)

        return named_like(setter, set_callback)

    def _getting(self, getter: Any) -> Any:
        """Return what stands for a getter of a callback: it returns the program's."""

        def get_callback() -> Any:
            function = getter()
            is_timed = getattr(function, "__code__", None) is self._callback_code
            return function.__wrapped__ if is_timed else function

        return named_like(getter, get_callback)

    def install_gymnasium(self, module: ModuleType) -> None:
        self._replace(module.MujocoRenderer, "render", "render")

    def install_processes(self, module: ModuleType) -> None:
        self._replace(module.BaseProcess, "start", PROCESS_START)

    def install_rollout(self, module: ModuleType) -> None:
        """Time `mujoco.rollout`, whose steps count as those of all simulations."""
        if hasattr(module, "rollout"):
            original, slow = module.rollout, self._calls.slow
            timed = slow(original, "rollout", _rollout_steps, detail=_rollout_threads)
            threaded = slow(original, THREADED_ROLLOUT, _rollout_steps, detail=_rollout_threads)

            def call(*args: Any, **kwargs: Any) -> Any:
                data = _argument(args, kwargs, 1, "data")
                self._look(_argument(args, kwargs, 0, "model"), data)
                has_threads = isinstance(data, (list, tuple)) and len(data) > 1
                return (threaded if has_threads else timed)(*args, **kwargs)

            module.rollout = named_like(original, call)  # type: ignore[attr-defined]
        if hasattr(module, "Rollout"):
            of_pool = module.Rollout.rollout
            in_pool = self._calls.slow(
                of_pool, "Rollout.rollout", _rollout_steps, detail=_pool_threads
            )

            def call_of_pool(*args: Any, **kwargs: Any) -> Any:
                self._look(_argument(args, kwargs, 1, "model"), _argument(args, kwargs, 2, "data"))
                return in_pool(*args, **kwargs)

            module.Rollout.rollout = named_like(of_pool, call_of_pool)

    def _look(self, model: Any, data: Any) -> None:
        now_ns = time.perf_counter_ns()
        if now_ns >= self._watch.next_look_ns:
            model, data = (
                each[0] if isinstance(each, (list, tuple)) and each else each
                for each in (model, data)
            )
            self._watch.look(model, data, sys._getframe(2), now_ns)

    def install_batch(self, module: ModuleType) -> None:
        owner = getattr(module, "Batch", None)
        for method, steps in (("rollout", _batch_rollout_steps), ("step", _batch_steps)):
            original = getattr(owner, method, None)
            if original is not None:
                callee = f"Batch.{method}"
                timed = self._calls.slow(original, callee, steps, detail=_batch_threads)
                setattr(owner, method, timed)

    def install_mjx(self, module: ModuleType) -> None:
        """Count steps of MJX that run outside a compiled function."""
        original = getattr(module, "step", None)
        if original is None:
            return
        timed = self._calls.slow(original, EAGER_MJX)

        def call(*args: Any, **kwargs: Any) -> Any:
            positions = (getattr(each, "qpos", each) for each in args[1:2])
            is_traced = any("Tracer" in type(each).__name__ for each in positions)
            return (original if is_traced else timed)(*args, **kwargs)

        module.step = named_like(original, call)  # type: ignore[attr-defined]


def _frame_size(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> Sequence[Any]:
    return [args[0].height, args[0].width, os.environ.get("MUJOCO_GL", "")]


def _argument(args: Sequence[Any], kwargs: Mapping[str, Any], place: int, name: str) -> Any:
    """Return an argument; None where it is not given, which the function itself reports."""
    return args[place] if len(args) > place else kwargs.get(name)


def _rollout_steps(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> tuple[int, int]:
    shape = result[0].shape
    nstep = int(shape[-2])
    return nstep, nstep * int(shape[0] if len(shape) == 3 else 1)


# Of a call that steps on threads: threads, chunk size (0 for the usual one), sensor data returned.


def _rollout_threads(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> Sequence[int]:
    data = _argument(args, kwargs, 1, "data")
    return _threads(len(data) if isinstance(data, (list, tuple)) else 1, kwargs, result)


def _pool_threads(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> Sequence[int]:
    return _threads(int(args[0].nthread), kwargs, result)


def _batch_threads(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> Sequence[int]:
    return [int(args[0].nthread), 0, int(isinstance(result, dict) and "sensordata" in result)]


def _threads(count: int, kwargs: Mapping[str, Any], result: Any) -> Sequence[int]:
    return [count, int(kwargs.get("chunk_size") or 0), int(result[1].shape[-1] > 0)]


def _batch_rollout_steps(
    args: Sequence[Any], kwargs: Mapping[str, Any], result: Any
) -> tuple[int, int]:
    nstep = int(kwargs["nstep"] if "nstep" in kwargs else args[1])
    return nstep, nstep * _batch_size(args, kwargs, 5)


def _batch_steps(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> tuple[int, int]:
    nstep = int(kwargs.get("nstep", args[2] if len(args) > 2 else 1))
    return nstep, nstep * _batch_size(args, kwargs, 1)


def _batch_size(args: Sequence[Any], kwargs: Mapping[str, Any], place: int) -> int:
    """Return how many simulations of a batch a call steps; `ids` may name them."""
    ids = kwargs.get("ids", args[place] if len(args) > place else None)
    return int(args[0].nsim) if ids is None else len(ids)
