"""The call clock: which lines of the user's code call MuJoCo and JAX, how often, and for how long.

The step clock times steps in bursts, and with them other calls that are as fast as a step. Calls
that take much longer, such as those that create an MjData, a Renderer or a model, are all timed.
Each line that calls has a slot in a file that is mapped into memory, one file for each process, so
the slots survive any end of the program.

This module runs in the user's program, in any environment: it needs the standard library alone.
`mjbench.commands.run.call_times` reads the files.
"""

import itertools
import json
import mmap
import os
import struct
import sys
import time
from _thread import get_ident
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import CodeType, FrameType
from typing import Any

from . import file_owners
from .function_replacement import named_like, suppress
from .step_file import map_file

# A slot: calls, their ns, calls while steps were timed, their ns, when the first began and the last
# ended, steps of a simulation, steps of all simulations; then an estimate of the calls between
# bursts, of their ns, and of the steps in them.
SLOT = struct.Struct("<11q")
MAX_SLOTS = 2048
# In place of the first slot: bytes of memory shortly after the first step, and at the latest look.
MEMORY = struct.Struct("<2q")
# Behind it: when a program of MJX first called a compiled function, or compiled a large one.
FIRST_COMPILED = struct.Struct("<q")
# Lines on the stack that are noted, innermost first; those of Python and mjbench are left out.
MAX_STACK = 60
# The function of this module begins a process; what is below it on a stack belongs to its parent.
_PROCESS_MODULE, _PROCESS_FUNCTION = "multiprocessing/process.py", "_bootstrap"
# Names of what is called or seen, other than functions of the engine.
SHARED_DATA, HALVES = "one MjData on two threads", "halves of a Runge-Kutta step"
WARNING = "warning"
TRACE, COMPILE, DISPATCH = "jax trace", "jax compile", "jax dispatch"
RECOMPILED = "jax compiled again"
DEVICE_WAIT, TRANSFER = "jax wait", "jax transfer"
IN_TURN, CALLBACK = "simulations in turn", "callback"
PROCESS_START, THREADED_ROLLOUT = "start of a process", "rollout on threads"
EAGER_MJX, COPIED_ENVIRONMENT = "mjx.step", "copy of an environment"
COPY_OF_DATA, DEEP_COPY_OF_DATA = COPIES_OF_DATA = "copy of MjData", "deep copy of MjData"
# What has the size of an image.
DRAWERS = ("Renderer", "render")
# Functions of the engine that are timed with steps; each is called with a model and its data.
STEPS = ("mj_step", "mj_step1", "mj_step2")
# What loads or compiles a model. Several models without a step between them are one set-up.
LOADERS = (
    "from_xml_path",
    "from_xml_string",
    "from_binary_path",
    "from_file",
    "from_string",
    "compile",
)
# Functions of JAX that are timed in bursts.
FAST_JAX = (DISPATCH, DEVICE_WAIT, TRANSFER)
FAST = (
    "mj_forward",
    "mj_forwardSkip",
    "mj_inverse",
    "mj_inverseSkip",
    "mjd_transitionFD",
    "mjd_inverseFD",
    "mj_kinematics",
    "mj_comPos",
    "mj_collision",
    "mj_ray",
    "mj_sensorPos",
    "mj_sensorVel",
    "mj_sensorAcc",
    "mj_rnePostConstraint",
    "mj_copyData",
    "mj_getState",
    "mj_setState",
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


class CallClock:
    """Times the calls of this process by the line that makes them."""

    def __init__(self, folder: str, now_ns: Callable[[], int] = time.perf_counter_ns) -> None:
        self._folder, self._now_ns = folder, now_ns
        self.is_own: dict[str, bool] = {}
        self.before_steps: Callable[[], None] = lambda: None  # called before a call that steps
        self.step_counts: list[Callable[[], int]] = []  # each changes when the program steps
        self.begin_process()

    def begin_process(self) -> None:
        """Begin the file of this process; a forked process begins its own."""
        self.close()
        self._sites: dict[tuple[str, int, int, int], list[int]] = {}
        self._codes: list[Any] = []
        self._latest: Sequence[tuple[str, int, str]] | None = None  # the line that stepped first
        self._next = itertools.count(1).__next__
        self._has_compiled = False
        self.cost_ns = 0  # of calls that are timed in bursts of their own
        self._calls_of_steps = 0  # that step many times, such as rollouts
        self._steps_at_load: dict[str, int] = {}  # by what loads
        self.inside: set[int] = set()  # threads in a slow call, whose own calls do not count
        self.is_observing = True  # until the first step, all is seen
        path = os.path.join(self._folder, f"{os.getpid()}.calls")
        with suppress(OSError):
            self._map = map_file(path, SLOT.size * MAX_SLOTS)
            self._names = f"{path[:-6]}.sites"
            self._write_line("")

    def close(self) -> None:
        """Write into no file any more."""
        self._map = mmap.mmap(-1, SLOT.size * MAX_SLOTS)
        self._names = ""  # path of the file of lines

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
        detail: Sequence[Any] = (),
    ) -> None:
        """Count a call.

        Args:
          frame: that called it; None, when the program ends, for the line of the latest step.
          line: file, line and function to name in place of the frame's; None for the frame's.
          detail: what is noted with the line, at its first call.
        """
        slot = self.slot(callee, frame, begin_ns, line, detail)
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
        self.write(slot)

    def note(self, callee: str, frame: FrameType | None) -> None:
        """Count what takes no time."""
        now_ns = self._now_ns()
        self.add(callee, frame, now_ns, now_ns)

    def write(self, slot: Sequence[int]) -> None:
        SLOT.pack_into(self._map, slot[0] * SLOT.size, *slot[1:])

    def write_memory(self, first_bytes: int, latest_bytes: int) -> None:
        MEMORY.pack_into(self._map, 0, first_bytes, latest_bytes)

    def note_compiled(self, now_ns: int) -> None:
        """Note when a program of MJX has first run what JAX compiles: it may step in no other way.

        A program that does not import MJX steps in MuJoCo, and may compile its policy long before.
        """
        if not self._has_compiled and "mujoco.mjx" in sys.modules:
            self._has_compiled = True
            FIRST_COMPILED.pack_into(self._map, MEMORY.size, now_ns)

    def slot(
        self,
        callee: str,
        frame: FrameType | None,
        begin_ns: int,
        line: tuple[str, int, str] | None = None,
        detail: Sequence[Any] = (),
    ) -> list[int] | None:
        """Return the slot of a call, by the line of the user's code.

        Where no line of the process is the user's, it is that of an installed package; None where
        there is none either.
        """
        owns, of_package = self.is_own, None
        if frame is None and self._latest is not None:
            return self._new_slot(callee, get_ident(), self._latest, begin_ns)
        while frame is not None:
            file = frame.f_code.co_filename
            if owns[file] if file in owns else self.owns(file):
                break
            if _begins_process(frame):
                frame = None
                break
            if of_package is None and file_owners.is_of_program(file):
                of_package = frame
            frame = frame.f_back
        frame = frame or of_package
        if frame is None:
            return None
        # by its identity: to hash the code itself takes microseconds
        key = (callee, id(frame.f_code), frame.f_lasti, get_ident())
        slot = self._sites.get(key)
        return self._begin_slot(key, frame, begin_ns, line, detail) if slot is None else slot

    def _begin_slot(
        self,
        key: tuple[str, int, int, int],
        frame: FrameType,
        begin_ns: int,
        first: tuple[str, int, str] | None,
        detail: Sequence[Any],
    ) -> list[int]:
        stack = [
            (each.f_code.co_filename, each.f_lineno, _name_of(each.f_code))
            for each in self._lines(frame)
        ]
        if key[0] in STEPS:
            self._latest = stack
        if first is not None:
            stack.insert(0, first)
        slot = self._new_slot(key[0], key[3], stack, begin_ns, detail)
        self._sites[key] = slot
        self._codes.append(frame.f_code)  # so that no other gets its identity
        return slot

    def _new_slot(
        self,
        callee: str,
        thread: int,
        stack: Sequence[tuple[str, int, str]],
        begin_ns: int,
        detail: Sequence[Any] = (),
    ) -> list[int]:
        number = self._next()
        if number < MAX_SLOTS and self._names:
            line = {"slot": number, "callee": callee, "thread": thread, "stack": stack}
            if detail:
                line["detail"] = detail
            self._write_line(json.dumps(line) + "\n")
        return [min(number, MAX_SLOTS - 1), 0, 0, 0, 0, begin_ns, 0, 0, 0, 0, 0, 0]

    def _write_line(self, line: str) -> None:
        """Append a line to the file of lines, or begin the file.

        It does not stay open: the program may close what it has not opened itself, and its own
        files then get the same numbers.
        """
        with suppress(OSError):
            flags = os.O_WRONLY | os.O_CREAT | (os.O_APPEND if line else os.O_TRUNC)
            descriptor = os.open(self._names, flags, 0o600)
            try:
                os.write(descriptor, line.encode())
            finally:
                os.close(descriptor)

    def _lines(self, frame: FrameType | None) -> Iterator[FrameType]:
        """Yield the frames of a process on a stack, innermost first, but Python's and mjbench's."""
        count = 0
        while frame is not None and count < MAX_STACK:
            file = frame.f_code.co_filename
            if _begins_process(frame):
                return
            if file_owners.is_of_program(file):
                yield frame
                count += 1
            frame = frame.f_back

    def owns(self, file: str) -> bool:
        """Return whether a file is the user's own; `is_own` may say so of another."""
        own = self.is_own.get(file)
        if own is None:
            own = self.is_own[file] = file_owners.is_own(file)
        return own

    def slow(
        self,
        function: Any,
        callee: str,
        steps: "Steps | None" = None,
        before: Callable[[Sequence[Any]], None] | None = None,
        detail: "Detail | None" = None,
    ) -> Any:
        """Return what stands for a slow function: it counts each call, but none inside another."""
        now_ns = self._now_ns

        def call(*args: Any, **kwargs: Any) -> Any:
            thread = get_ident()
            if thread in self.inside:
                return function(*args, **kwargs)
            if before is not None:
                with suppress(Exception):
                    before(args)
            if steps is not None:
                self.before_steps()
                self._calls_of_steps += 1
            is_counted = callee not in LOADERS or self._has_stepped(callee)
            self.inside.add(thread)
            begin_ns = now_ns()
            result = None
            try:
                result = function(*args, **kwargs)
                return result
            finally:
                end_ns = now_ns()
                self.inside.discard(thread)
                counts: tuple[int, int] = (0, 0)
                details: Sequence[Any] = ()
                with suppress(Exception):
                    counts = steps(args, kwargs, result) if steps is not None else counts
                    details = detail(args, kwargs, result) if detail is not None else details
                frame = sys._getframe(1)
                self.add(callee, frame, begin_ns, end_ns, *counts, int(is_counted), detail=details)

        return named_like(function, call)

    def _has_stepped(self, loader: str) -> bool:
        """Return whether the process has stepped since it last loaded a model in this way."""
        steps = self._calls_of_steps + sum(count() for count in self.step_counts)
        earlier, self._steps_at_load[loader] = self._steps_at_load.get(loader, 0), steps
        return steps != earlier

    def callback(self, function: Any, name: str) -> Any:
        """Return what stands for a callback of MuJoCo, which is timed while steps are."""
        now_ns, code, callee = self._now_ns, function.__code__, f"{CALLBACK} {name}"
        line = code.co_filename, code.co_firstlineno, _name_of(code)

        def call(*args: Any) -> Any:
            if not self.is_observing:
                return function(*args)
            begin_ns = now_ns()
            try:
                return function(*args)
            finally:
                self.add(callee, sys._getframe(1), begin_ns, now_ns(), line=line)

        return named_like(function, call)


def _name_of(code: CodeType) -> str:
    """Return the name that samples have, too: with the class, where Python knows it (3.11)."""
    return getattr(code, "co_qualname", code.co_name)


def _begins_process(frame: FrameType) -> bool:
    code = frame.f_code
    return code.co_name == _PROCESS_FUNCTION and code.co_filename.endswith(_PROCESS_MODULE)


# Returns the steps of one simulation and of all, of a call's arguments and its result.
Steps = Callable[[Sequence[Any], Mapping[str, Any], Any], tuple[int, int]]
# Returns what is noted with the line of a slow call.
Detail = Callable[[Sequence[Any], Mapping[str, Any], Any], Sequence[Any]]
