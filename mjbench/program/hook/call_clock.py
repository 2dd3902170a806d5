"""The call clock: which lines of the user's code call MuJoCo and JAX, how often, and for how long.

The step clock times steps in bursts, and with them other calls that are as fast as a step. Calls
that take much longer, such as those that create an MjData, a Renderer or a model, are all timed.
Each line that calls has a slot in a file that is mapped into memory, one file for each process, so
the slots survive any end of the program.

This module runs in the user's program, in any environment: it needs the standard library alone.
`mjbench.program.calls` reads the files.
"""

import contextlib
import itertools
import json
import mmap
import os
import struct
import sys
import sysconfig
import time
from _thread import get_ident
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import FrameType, ModuleType
from typing import Any

# A slot: calls, their ns, calls while steps were timed, their ns, when the first began and the last
# ended, steps of a simulation, steps of all simulations; then an estimate of the calls between
# bursts, of their ns, and of the steps in them.
SLOT = struct.Struct("<11q")
MAX_SLOTS = 2048
# In place of the first slot: bytes of memory shortly after the first step, and at the latest look.
MEMORY = struct.Struct("<2q")
# Lines on the stack that are noted, innermost first; Python's own modules are left out.
MAX_STACK = 60
# The function of this module begins a process; what is below it on a stack belongs to its parent.
_PROCESS_MODULE, _PROCESS_FUNCTION = "multiprocessing/process.py", "_bootstrap"
# States of a model that are noted, to measure other calls on; models, and bytes of one.
MAX_STATES, MAX_MODELS, MAX_MODEL_BYTES = 4, 4, 64 << 20
# Between two looks at the memory of the process and the state of the simulation.
LOOK_NS = 100_000_000

# What is called, as `calls.CALLEES` explains it.
SHARED_DATA, HALVES = "one MjData on two threads", "halves of a Runge-Kutta step"
WARNING, COMPILE = "warning", "jax compile"
IN_TURN, CALLBACK, SOFTWARE_GL = "simulations in turn", "callback", "software rendering"
PROCESS_START, THREADED_ROLLOUT = "start of a process", "rollout on threads"
EAGER_MJX, COPY_OF_DATA = "mjx.step", "copy of MjData"
# Functions of the engine that are timed with steps; each is called with a model and its data.
STEPS = ("mj_step", "mj_step1", "mj_step2")
FAST = (
    "mj_forward",
    "mj_forwardSkip",
    "mj_inverse",
    "mj_kinematics",
    "mj_comPos",
    "mj_collision",
    "mj_sensorPos",
    "mj_sensorVel",
    "mj_sensorAcc",
    "mj_rnePostConstraint",
    "mj_copyData",
    "mj_getState",
    "mj_setState",
)
# Methods that are slow enough to be timed each time: class of the module `mujoco`, method, name.
_METHODS = (
    ("MjData", "__init__", "MjData"),
    ("MjData", "__copy__", COPY_OF_DATA),
    ("MjData", "__deepcopy__", COPY_OF_DATA),
    ("MjModel", "__copy__", "copy of MjModel"),
    ("MjModel", "__deepcopy__", "copy of MjModel"),
    ("MjSpec", "compile", "compile"),
    ("MjSpec", "recompile", "compile"),
    ("Renderer", "__init__", "Renderer"),
    ("Renderer", "update_scene", "update_scene"),
    ("Renderer", "render", "render"),
)
CALLBACKS = (
    "mjcb_control",
    "mjcb_passive",
    "mjcb_sensor",
    "mjcb_contactfilter",
    "mjcb_act_dyn",
    "mjcb_act_gain",
    "mjcb_act_bias",
)
# What OpenGL calls itself where the processor draws.
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_GL_LIBRARIES = ("libOpenGL.so.0", "libGL.so.1", "libGLESv2.so.2", "libOSMesa.so.8")
_GL_RENDERER = 0x1F01
_CONSTRUCTORS = (
    ("MjModel", "from_xml_path"),
    ("MjModel", "from_xml_string"),
    ("MjModel", "from_binary_path"),
    ("MjSpec", "from_file"),
    ("MjSpec", "from_string"),
)
# Events of JAX, the last of which counts compilations.
_JAX_EVENTS = (
    "/jax/core/compile/jaxpr_trace_duration",
    "/jax/core/compile/jaxpr_to_mlir_module_duration",
    "/jax/core/compile/backend_compile_duration",
)
# Functions of JAX that are compiled within each other.
_MOST_NESTED = 100
_HERE = os.path.dirname(os.path.abspath(__file__))


class CallClock:
    """Times the calls of this process by the line that makes them."""

    fast_functions = FAST

    def __init__(self, folder: str, now_ns: Callable[[], int] = time.perf_counter_ns) -> None:
        """Begin the process's file.

        Args:
          folder: for the file.
          now_ns: the clock.
        """
        self._folder, self._now_ns = folder, now_ns
        self._is_own: dict[str, bool] = {}
        self._callback_code: Any = self  # of what times a callback; at first, of nothing
        self._standard = tuple(
            {os.path.realpath(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")}
            | {sysconfig.get_path(name) for name in ("stdlib", "platstdlib")}
        )
        self.begin_process()

    def begin_process(self) -> None:
        """Begin the file of this process; a forked process begins its own."""
        self._sites: dict[tuple[str, int, int, int], list[int]] = {}
        self._codes: list[Any] = []
        self._latest: Sequence[tuple[str, int, str]] | None = None  # the line that stepped first
        self._unwritten: dict[int, list[int]] = {}
        self._counted: dict[int, tuple[int, int, int]] = {}  # by slot, at the end of the last burst
        self._burst: list[tuple[list[int], int, int, int]] = []  # the slots of the last burst
        self._next = itertools.count(1).__next__
        self._names = ""  # path of the file of lines
        self._map = mmap.mmap(-1, SLOT.size * MAX_SLOTS)
        self._inside: set[int] = set()  # threads in a slow call, whose own calls do not count
        self._active: dict[int, int] = {}  # thread by the MjData that it steps
        self._warnings: dict[int, list[int]] = {}
        # number by model, and how many states of each kind were written
        self._models: dict[int, tuple[int, dict[str, int]]] = {}
        self._jax: list[tuple[int, int]] = []
        self._first_bytes = 0  # of memory, at the first look
        self._has_seen_renderer = False
        self._next_look_ns = 0
        self._detail: Sequence[Any] = ()  # of the latest renderer: height, width and backend
        self._cached: tuple[str, Any, int, int] | None = None
        self._cached_slot: list[int] = []
        self.is_observing = True  # until the first step, all is seen
        path = os.path.join(self._folder, f"{os.getpid()}.calls")
        with contextlib.suppress(OSError):
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
            try:
                os.ftruncate(descriptor, SLOT.size * MAX_SLOTS)
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(descriptor, 0, SLOT.size * MAX_SLOTS)
                self._map = mmap.mmap(descriptor, 0)
            finally:
                os.close(descriptor)
            self._names = f"{path[:-6]}.sites"
            self._write_line("")

    # Slots

    def add(
        self,
        callee: str,
        frame: FrameType | None,
        begin_ns: int,
        end_ns: int,
        steps: int = 0,
        all_steps: int = 0,
        calls: int = 1,
        line: tuple[str, int, str] | None = None,
    ) -> None:
        """Count a call.

        Args:
          callee: what was called.
          frame: that called it; None, when the program ends, for the line of the latest step.
          begin_ns: when it began.
          end_ns: when it ended.
          steps: of one simulation.
          all_steps: of all simulations.
          calls: how many calls it counts as.
          line: file, line and function to name in place of the frame's; None for the frame's.
        """
        slot = self._slot(callee, frame, begin_ns, line)
        if slot is None:
            return
        duration_ns = end_ns - begin_ns
        slot[1] += calls
        slot[2] += duration_ns
        if self.is_observing:
            slot[3] += calls
            slot[4] += duration_ns
        slot[6] = end_ns
        slot[7] += steps
        slot[8] += all_steps
        SLOT.pack_into(self._map, slot[0] * SLOT.size, *slot[1:])

    def add_timed(
        self, callee: str, frame: FrameType, begin_ns: int, end_ns: int, steps: int
    ) -> None:
        """Count a call that is timed with steps; `write` writes its slot."""
        # most calls are made where the one before was made
        place = (callee, frame.f_code, frame.f_lasti, get_ident())
        cached = self._cached
        if (
            cached is not None
            and cached[1] is place[1]
            and cached[2] == place[2]
            and cached[0] is callee
            and cached[3] == place[3]
        ):
            slot = self._cached_slot
        else:
            found = self._slot(callee, frame, begin_ns, None)
            if found is None:
                return
            slot = found
            if self._is_own.get(frame.f_code.co_filename):
                self._cached, self._cached_slot = place, slot
        duration_ns = end_ns - begin_ns
        slot[1] += 1
        slot[2] += duration_ns
        slot[3] += 1
        slot[4] += duration_ns
        slot[6] = end_ns
        slot[7] += steps
        slot[8] += steps
        self._unwritten[slot[0]] = slot

    def write(self) -> None:
        """Write the slots of calls that were timed with steps."""
        unwritten, self._unwritten = self._unwritten, {}
        if unwritten:
            self._burst = []
            for number, slot in unwritten.items():
                calls, ns, steps = self._counted.get(number, (0, 0, 0))
                self._burst.append((slot, slot[3] - calls, slot[4] - ns, slot[7] - steps))
                self._counted[number] = slot[3], slot[4], slot[7]
        for number, slot in unwritten.items():
            SLOT.pack_into(self._map, number * SLOT.size, *slot[1:])

    def pass_on(self, bursts: float, until_ns: int = 0) -> None:
        """Count calls that were not timed since the last burst, as many bursts of its kind.

        Args:
          bursts: how many.
          until_ns: when the last of them ended; 0 where that is not known.
        """
        for slot, calls, ns, steps in self._burst:
            slot[9] += round(calls * bursts)
            slot[10] += round(ns * bursts)
            slot[11] += round(steps * bursts)
            slot[6] = max(slot[6], until_ns)
            SLOT.pack_into(self._map, slot[0] * SLOT.size, *slot[1:])

    def _slot(
        self,
        callee: str,
        frame: FrameType | None,
        begin_ns: int,
        line: tuple[str, int, str] | None,
    ) -> list[int] | None:
        """Return the slot of a call, by the line of the user's code.

        Where no line of the process is the user's, it is that of an installed package; None where
        there is none either.
        """
        owns, of_package = self._is_own, None
        if frame is None and self._latest is not None:
            return self._new_slot(callee, get_ident(), self._latest, begin_ns)
        while frame is not None:
            file = frame.f_code.co_filename
            if owns[file] if file in owns else self._owns(file):
                break
            if _begins_process(frame):
                frame = None
                break
            if of_package is None and "-packages" in file:
                of_package = frame
            frame = frame.f_back
        frame = frame or of_package
        if frame is None:
            return None
        # by its identity: to hash the code itself takes microseconds
        key = (callee, id(frame.f_code), frame.f_lasti, get_ident())
        slot = self._sites.get(key)
        return self._begin_slot(key, frame, begin_ns, line) if slot is None else slot

    def _begin_slot(
        self,
        key: tuple[str, int, int, int],
        frame: FrameType,
        begin_ns: int,
        first: tuple[str, int, str] | None,
    ) -> list[int]:
        stack = [
            (each.f_code.co_filename, each.f_lineno, each.f_code.co_name)
            for each in self._lines(frame)
        ]
        if key[0] in STEPS:
            self._latest = stack
        if first is not None:
            stack.insert(0, first)
        slot = self._new_slot(key[0], key[3], stack, begin_ns)
        self._sites[key] = slot
        self._codes.append(frame.f_code)  # so that no other gets its identity
        return slot

    def _new_slot(
        self, callee: str, thread: int, stack: Sequence[tuple[str, int, str]], begin_ns: int
    ) -> list[int]:
        number = self._next()
        if number < MAX_SLOTS and self._names:
            line = {"slot": number, "callee": callee, "thread": thread, "stack": stack}
            if callee == "Renderer":
                line["frame"] = self._detail
            self._write_line(json.dumps(line) + "\n")
        return [min(number, MAX_SLOTS - 1), 0, 0, 0, 0, begin_ns, 0, 0, 0, 0, 0, 0]

    def _write_line(self, line: str) -> None:
        """Append a line to the file of lines, or begin the file.

        It does not stay open: the program may close what it has not opened itself, and its own
        files then get the same numbers.
        """
        with contextlib.suppress(OSError):
            flags = os.O_WRONLY | os.O_CREAT | (os.O_APPEND if line else os.O_TRUNC)
            descriptor = os.open(self._names, flags, 0o600)
            try:
                os.write(descriptor, line.encode())
            finally:
                os.close(descriptor)

    def _lines(self, frame: FrameType | None) -> Iterator[FrameType]:
        """Yield the frames of a process on a stack, innermost first, but Python's own."""
        count = 0
        while frame is not None and count < MAX_STACK:
            file = frame.f_code.co_filename
            if _begins_process(frame):
                return
            if self._owns(file) or "-packages" in file:
                yield frame
                count += 1
            frame = frame.f_back

    def _owns(self, file: str) -> bool:
        """Return whether a file is the user's own: not Python's, and of no installed package."""
        own = self._is_own.get(file)
        if own is None:
            own = not (
                file.startswith(("<", _HERE, *self._standard))
                or "site-packages" in file
                or "dist-packages" in file
            )
            self._is_own[file] = own
        return own

    def count_as_own(self, file: str, is_own: bool) -> None:
        """Let a file count as the user's, while the cost of a call is measured."""
        self._is_own[file] = is_own

    # While steps are timed

    def observe(self, is_observing: bool) -> None:
        """Note that steps are timed from now on, or no longer; write what was timed."""
        self.write()
        self.is_observing = is_observing

    def enter(self, data: int, frame: FrameType, now_ns: int) -> None:
        """Note that a step of an MjData begins, which no other thread may step meanwhile."""
        thread = get_ident()
        if self._active.get(data, thread) != thread:
            self.add(SHARED_DATA, frame, now_ns, now_ns)
        self._active[data] = thread

    def leave(self, data: int) -> None:
        """Note that the step ended."""
        self._active.pop(data, None)

    def note_turns(self, simulations: int, frame: FrameType, now_ns: int) -> None:
        """Note that a burst of steps was of several simulations in turn."""
        self.add(IN_TURN, frame, now_ns, now_ns, all_steps=simulations)

    def look(self, model: Any, data: Any, frame: FrameType | None, now_ns: int) -> None:
        """Look at a simulation after a burst of steps, and at the process from time to time."""
        with contextlib.suppress(Exception):
            self.look_for_warnings(data, frame, now_ns)
            if now_ns >= self._next_look_ns:
                self._next_look_ns = now_ns + LOOK_NS
                latest_bytes = _resident_bytes()
                self._first_bytes = self._first_bytes or latest_bytes
                MEMORY.pack_into(self._map, 0, self._first_bytes, latest_bytes)
                self._keep_state(model, data)

    def look_for_halves(self, model: Any, frame: FrameType | None) -> bool:
        """Note, and return, whether halves of a step run a model that asks for Runge-Kutta."""
        with contextlib.suppress(Exception):
            module = sys.modules["mujoco"]
            if model.opt.integrator == int(module.mjtIntegrator.mjINT_RK4):
                now_ns = self._now_ns()
                self.add(HALVES, frame, now_ns, now_ns)
                return True
        return False

    def look_for_warnings(self, data: Any, frame: FrameType | None, now_ns: int) -> None:
        """Count warnings of a simulation since the last look, at the line that steps it."""
        numbers = getattr(getattr(data, "warning", None), "number", None)
        if numbers is None or (not numbers.any() and id(data) not in self._warnings):
            return
        numbers = [int(number) for number in numbers]
        earlier = self._warnings.get(id(data))
        if earlier is None:
            earlier = [0] * len(numbers)
        for kind, (number, before) in enumerate(zip(numbers, earlier, strict=True)):
            more = number - before if number >= before else number  # it was reset meanwhile
            if more > 0:
                self.add(f"{WARNING} {kind}", frame, now_ns, now_ns, calls=more)
        self._warnings[id(data)] = numbers

    def _keep_state(self, model: Any, data: Any, kind: str = "states") -> None:
        """Write a model once, and a few of its states, or of those that the program copies."""
        if id(model) not in self._models and len(self._models) == MAX_MODELS:
            return
        number, states = self._models.setdefault(id(model), (len(self._models), {}))
        if states.get(kind, 0) >= MAX_STATES:
            return
        module = sys.modules["mujoco"]
        if module.mj_sizeModel(model) > MAX_MODEL_BYTES:
            states[kind] = MAX_STATES
            return
        import numpy as np

        spec = module.mjtState.mjSTATE_INTEGRATION
        state = np.empty(module.mj_stateSize(model, spec))
        path = os.path.join(self._folder, f"{os.getpid()}.{number}")
        if not states:
            module.mj_saveModel(model, f"{path}.mjb", None)
            with open(f"{path}.count", "w", encoding="utf-8") as sizes:
                sizes.write(str(state.size))
        get_state = module.mj_getState
        getattr(get_state, "__wrapped__", get_state)(model, data, state, spec)
        with open(f"{path}.{kind}", "ab") as file:
            file.write(state.tobytes())
        states[kind] = states.get(kind, 0) + 1

    # What is timed each time

    def slow(
        self,
        function: Any,
        callee: str,
        steps: "Steps | None" = None,
    ) -> Any:
        """Return what stands for a slow function: it counts each call, but none inside another.

        Args:
          function: that it calls.
          callee: its name in the slots.
          steps: returns the steps of one simulation and of all.
        """
        now_ns = self._now_ns

        def call(*args: Any, **kwargs: Any) -> Any:
            thread = get_ident()
            if thread in self._inside:
                return function(*args, **kwargs)
            self._inside.add(thread)
            if callee == COPY_OF_DATA:
                with contextlib.suppress(Exception):
                    self._keep_state(args[0].model, args[0], "copied")
            begin_ns = now_ns()
            result = None
            try:
                result = function(*args, **kwargs)
                return result
            finally:
                end_ns = now_ns()
                self._inside.discard(thread)
                counts = (0, 0)
                if steps is not None:
                    with contextlib.suppress(Exception):
                        counts = steps(args, kwargs, result)
                if callee == "Renderer":
                    self._look_at_renderer(args, sys._getframe(1))
                self.add(callee, sys._getframe(1), begin_ns, end_ns, *counts)

        _copy_names(function, call)
        return call

    def install(self, module: ModuleType) -> None:
        """Replace the slow methods in the module `mujoco`, which was just imported."""
        for class_name, method, callee in _METHODS:
            owner = getattr(module, class_name, None)
            original = getattr(owner, method, None)
            if owner is not None and original is not None:
                with contextlib.suppress(AttributeError, TypeError):
                    setattr(owner, method, self.slow(original, callee))
        for class_name, method in _CONSTRUCTORS:
            owner = getattr(module, class_name, None)
            original = getattr(owner, method, None)
            if owner is not None and original is not None:
                with contextlib.suppress(AttributeError, TypeError):
                    setattr(owner, method, staticmethod(self.slow(original, method)))

    def install_callbacks(self, module: ModuleType) -> None:
        """Time Python functions that MuJoCo calls in a step, while steps are timed."""
        for name in CALLBACKS:
            setter = getattr(module, f"set_{name}", None)
            if setter is not None:
                setattr(module, f"set_{name}", self._setting(setter, name))
                getter = getattr(module, f"get_{name}")
                setattr(module, f"get_{name}", self._getting(getter))

    def _setting(self, setter: Any, name: str) -> Any:
        """Return what stands for a function that sets a callback."""

        def set_callback(function: Any) -> Any:
            code = getattr(function, "__code__", None)
            return setter(function if code is None else self._timed_callback(function, name, code))

        _copy_names(setter, set_callback)
        return set_callback

    def _getting(self, getter: Any) -> Any:
        """Return what stands for a function that returns a callback: it returns the program's."""

        def get_callback() -> Any:
            function = getter()
            is_timed = getattr(function, "__code__", None) is self._callback_code
            return function.__wrapped__ if is_timed else function

        _copy_names(getter, get_callback)
        return get_callback

    def _timed_callback(self, function: Any, name: str, code: Any) -> Any:
        now_ns, line = self._now_ns, (code.co_filename, code.co_firstlineno, code.co_name)
        callee = f"{CALLBACK} {name}"

        def call(*args: Any) -> Any:
            if not self.is_observing:
                return function(*args)
            begin_ns = now_ns()
            try:
                return function(*args)
            finally:
                self.add(callee, sys._getframe(1), begin_ns, now_ns(), line=line)

        _copy_names(function, call)
        self._callback_code = call.__code__
        return call

    def install_processes(self, module: ModuleType) -> None:
        """Time how long the start of a process takes."""
        owner = module.BaseProcess
        owner.start = self.slow(owner.start, PROCESS_START)

    def _look_at_renderer(self, args: Sequence[Any], frame: FrameType | None) -> None:
        """Note the size of a renderer's images, and whether the processor draws them."""
        with contextlib.suppress(Exception):
            self._detail = [args[0].height, args[0].width, os.environ.get("MUJOCO_GL", "")]
        if self._has_seen_renderer or not hasattr(os, "RTLD_NOLOAD"):
            return
        self._has_seen_renderer = True
        import ctypes

        for library in _GL_LIBRARIES:
            with contextlib.suppress(OSError, AttributeError):
                # the library that the program has loaded, and no other
                loaded = ctypes.CDLL(library, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
                loaded.glGetString.restype = ctypes.c_char_p
                name = (loaded.glGetString(_GL_RENDERER) or b"").decode(errors="replace").lower()
                if any(each in name for each in _SOFTWARE):
                    now_ns = self._now_ns()
                    self.add(SOFTWARE_GL, frame, now_ns, now_ns)
                    return

    def install_rollout(self, module: ModuleType) -> None:
        """Time `mujoco.rollout`, whose steps count as those of all simulations."""
        if hasattr(module, "rollout"):
            original = module.rollout
            timed = self.slow(original, "rollout", _rollout_steps)
            threaded = self.slow(original, THREADED_ROLLOUT, _rollout_steps)

            def call(*args: Any, **kwargs: Any) -> Any:
                data: Any = kwargs.get("data", args[1] if len(args) > 1 else None)
                is_list = isinstance(data, (list, tuple)) and len(data) > 0
                with contextlib.suppress(Exception):
                    model = args[0] if args else kwargs["model"]
                    first = model[0] if isinstance(model, (list, tuple)) else model
                    self._keep_state(first, data[0] if is_list else data)
                has_threads = is_list and len(data) > 1
                return (threaded if has_threads else timed)(*args, **kwargs)

            _copy_names(original, call)
            module.rollout = call  # type: ignore[attr-defined]
        if hasattr(module, "Rollout"):
            module.Rollout.rollout = self.slow(
                module.Rollout.rollout, "Rollout.rollout", _rollout_steps
            )

    def install_batch(self, module: ModuleType) -> None:
        """Time `mujoco.batch`."""
        owner = getattr(module, "Batch", None)
        for method, steps in (("rollout", _batch_rollout_steps), ("step", _batch_steps)):
            original = getattr(owner, method, None)
            if original is not None:
                setattr(owner, method, self.slow(original, f"Batch.{method}", steps))

    def install_mjx(self, module: ModuleType) -> None:
        """Count steps of MJX that run outside a compiled function."""
        original = getattr(module, "step", None)
        if original is None:
            return
        timed = self.slow(original, EAGER_MJX)

        def call(*args: Any, **kwargs: Any) -> Any:
            is_traced = any("Tracer" in type(_leaf(each)).__name__ for each in args[1:2])
            return (original if is_traced else timed)(*args, **kwargs)

        _copy_names(original, call)
        module.step = call  # type: ignore[attr-defined]

    def install_jax(self, module: ModuleType) -> None:
        """Time what JAX traces and compiles, by the line that made it."""
        from jax import monitoring

        monitoring.register_event_duration_secs_listener(self.note_jax)

    def note_jax(self, event: str, seconds: float, **_: Any) -> None:
        """Count what JAX says that it did; what happened inside it was counted already."""
        if event not in _JAX_EVENTS:
            return
        end_ns = self._now_ns()
        begin_ns = end_ns - int(1e9 * seconds)
        inner = [each for each in self._jax if each[0] >= begin_ns]
        self._jax = [each for each in self._jax[-_MOST_NESTED:] if each[0] < begin_ns]
        self._jax.append((begin_ns, end_ns - begin_ns))
        inner_ns = sum(ns for _, ns in inner)
        is_compile = event == _JAX_EVENTS[-1]
        self.add(
            COMPILE, sys._getframe(1), begin_ns + inner_ns, end_ns, calls=1 if is_compile else 0
        )


def _begins_process(frame: FrameType) -> bool:
    """Return whether what is below a frame on the stack belongs to the process's parent."""
    code = frame.f_code
    return code.co_name == _PROCESS_FUNCTION and code.co_filename.endswith(_PROCESS_MODULE)


def _leaf(value: Any) -> Any:
    """Return the positions of a state of MJX."""
    return getattr(value, "qpos", value)


# Returns the steps of one simulation and of all, of a call's arguments and its result.
Steps = Callable[[Sequence[Any], Mapping[str, Any], Any], tuple[int, int]]


def _rollout_steps(args: Sequence[Any], kwargs: Mapping[str, Any], result: Any) -> tuple[int, int]:
    """Return the steps of one simulation and of all, from the states that rollout returns."""
    shape = result[0].shape
    nstep = int(shape[-2])
    return nstep, nstep * int(shape[0] if len(shape) == 3 else 1)


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


def _resident_bytes() -> int:
    """Return the memory of this process; 0 where the system does not say."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * mmap.PAGESIZE
    except OSError:
        return 0


def _copy_names(function: Any, replacement: Any) -> None:
    """Give a replacement the name and documentation of what it stands for."""
    for name in ("__name__", "__qualname__", "__doc__", "__module__"):
        value = getattr(function, name, None)
        if value is not None:
            setattr(replacement, name, value)
    replacement.__wrapped__ = function
