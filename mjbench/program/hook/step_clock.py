"""The step clock: when the user's program calls the engine, and for how long.

It replaces `mujoco.mj_step`, `mj_step1` and `mj_step2` by functions that note when each call begins
and ends, once the program has imported MuJoCo. It also notes when an environment begins a step, and
how long garbage collections take. Records go into a file that is mapped into memory, one for each
process, so they survive any end of the program.

The clock must cost little. It times bursts of calls; between them, calls pass through. Where even
that would cost too much, it takes its functions away until the program resets a simulation.

This module runs in the user's program, in any environment: it needs the standard library alone.
`mjbench.program.step_times` reads the files.
"""

import atexit
import contextlib
import faulthandler
import gc
import importlib
import importlib.abc
import importlib.machinery
import itertools
import json
import mmap
import os
import struct
import sys
import time
import weakref
from _thread import _count as count_threads
from _thread import get_ident
from collections.abc import Callable, Sequence
from types import MethodType, ModuleType
from typing import Any

# A record: kind, thread, begin and end in ns, steps, timestep in ns.
RECORD = struct.Struct("<6q")
# What stands before the records, as `Header` names it.
HEADER = struct.Struct("<11q")
# Seconds by the engine's timers, as sums over bursts.
MAX_TIMERS = 32
TIMERS = struct.Struct(f"<{MAX_TIMERS}d")
FIRST_RECORD = HEADER.size + TIMERS.size
CAPACITY = 1 << 17  # records of a process: 6 MB

# What `mjbench run --confirm` has the clock change, to see what it saves.
NO_ENGINE_CLOCK, NO_COLLECTION = "no-engine-clock", "no-collection"

# Kinds of records.
STEP, ITERATION, BURST = 1, 2, 3

# Calls of a burst, a prime: bursts end at different places of episodes. What timing them may cost
# of the program's time; to pass calls through costs a little more, which cannot be spared. The
# program's processor time is what counts: of two processes that share a core, each is slowed by the
# clock of both.
BURST_CALLS, MAX_COST_SHARE = 199, 0.003
# What it may cost in any case, so that a fast loop is timed for more than a moment.
FREE_COST_NS = 10_000_000
# Bursts from which the cost of a timed call is learned, and times the calibrated cost at most.
_MOST_COSTS, _MOST_COST = 15, 5
# Calls that follow each other faster are left alone for most of the time: even to pass them through
# would cost more than `MAX_COST_SHARE`.
FASTEST_PASSED_NS = 5_000
CALIBRATION_CALLS = 2000
# Calls of the calibration with cold caches, and bytes that are read before each: what a core's own
# caches hold.
COLD_CALLS, COLD_BYTES = 200, 1 << 20

_STEPPING = ("mj_step", "mj_step1", "mj_step2")
_RESETS = ("mj_resetData", "mj_resetDataKeyframe")
# Methods that begin a step of an environment: module, class, method.
_ENVIRONMENTS = (
    ("gymnasium.envs.mujoco.mujoco_env", "MujocoEnv", "do_simulation"),
    ("dm_control.rl.control", "Environment", "step"),
    ("dm_control.composer.environment", "Environment", "step"),
    ("robosuite.environments.base", "MujocoEnv", "step"),
)

_NONE = object()  # stands for an argument that is not given
_HERE = os.path.dirname(os.path.abspath(__file__))
_now_ns, _processor_ns = time.perf_counter_ns, time.process_time_ns
_HIGH_DESCRIPTOR = 500
# Of a thread's identifier, so that it fits a record.
_THREAD_BITS = 2**63 - 1


class StepFile:
    """The file of one process."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self.open()

    def open(self) -> None:
        """Begin the file of this process; a forked process begins its own."""
        path = os.path.join(self._folder, f"{os.getpid()}.steps")
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
        try:
            size = FIRST_RECORD + CAPACITY * RECORD.size
            os.ftruncate(descriptor, size)
            if hasattr(os, "posix_fallocate"):
                # writing to a file without space would end the program
                os.posix_fallocate(descriptor, 0, size)
            self._map = mmap.mmap(descriptor, 0)
        finally:
            os.close(descriptor)
        self._next = itertools.count().__next__
        self._timers = [0.0] * MAX_TIMERS

    def close(self) -> None:
        """Write no more records."""
        self._map = mmap.mmap(-1, FIRST_RECORD)
        self._next = itertools.repeat(CAPACITY).__next__

    def write(self, kind: int, begin_ns: int, end_ns: int, nstep: int, timestep_ns: int) -> int:
        """Write a record; return how many there are now."""
        slot = self._next()
        if slot < CAPACITY:
            RECORD.pack_into(
                self._map,
                FIRST_RECORD + slot * RECORD.size,
                kind,
                get_ident() & _THREAD_BITS,
                begin_ns,
                end_ns,
                nstep,
                timestep_ns,
            )
        return slot + 1

    def write_header(self, *values: int) -> None:
        """Write what stands before the records, in the order of `step_times.Header`."""
        HEADER.pack_into(self._map, 0, *values)

    def add_timers(self, seconds: Sequence[float]) -> None:
        """Add seconds by the engine's timers to their sums."""
        for i, value in enumerate(seconds[:MAX_TIMERS]):
            self._timers[i] += value
        TIMERS.pack_into(self._map, HEADER.size, *self._timers)


class StepClock:
    """Times the engine's calls of this process in bursts."""

    def __init__(
        self,
        folder: str,
        calls: Any,
        change: str = "",
        now_ns: Callable[[], int] = _now_ns,
        processor_ns: Callable[[], int] = _processor_ns,
    ) -> None:
        """Begin the process's file.

        Args:
          folder: for the file.
          calls: the `call_clock.CallClock` of this process.
          change: to apply, `NO_ENGINE_CLOCK` or `NO_COLLECTION`; "" for none.
          now_ns: the clock.
          processor_ns: the clock of the processor time of this process.
        """
        self._folder, self._change = folder, change
        self._now_ns, self._processor_ns = now_ns, processor_ns
        self._file, self._calls = StepFile(folder), calls
        self._originals: dict[str, Any] = {}
        self._timed: dict[str, Any] = {}
        self._module: ModuleType | None = None
        self._timestep_ns = 0  # of the model that the burst steps
        # What a call costs: timed, timed where caches are cold, and passed through.
        self.timed_ns = self.cold_ns = self.passed_ns = 0
        self._reset_totals()

    def _reset_totals(self) -> None:
        """Begin to count: in a new process, everything begins at 0."""
        self._process_ns = self._now_ns()
        self._begin_clocks()
        self._first_ns = self._last_ns = 0
        self._calls_timed = self._calls_passed = 0
        self._to_pass = self._planned_to_pass = 0
        self._burst_begin_ns = 0
        self._burst_calls = 0
        self._burst_timers: list[float] | None = None
        self._latest: tuple[Any, Any] = None, None  # model and data of the step before
        self._latest_data: Any = None  # a weak reference to the data of the last burst
        self._burst_place: tuple[Any, int] = None, 0  # code and instruction of its first step
        self._turns: dict[int, Any] | None = None  # simulations that are stepped in turn
        self._halves_seen = False
        self._burst_period_ns = self._burst_end_ns = 0
        self._costs_ns: list[int] = []  # of a timed call, as bursts have shown
        self._is_away = self._was_away = self._was_left = self._has_ended = False
        self._collections = self._collections_ns = self._longest_collection_ns = 0
        self._collection_begin_ns = 0
        self._write_header()

    def _begin_clocks(self) -> None:
        """Let the time that bursts may take a share of begin now."""
        self._start_ns, self._processor_start_ns = self._now_ns(), self._processor_ns()

    def _elapsed_ns(self) -> int:
        """Return the time of which bursts may take a share."""
        processor_ns = self._processor_ns() - self._processor_start_ns
        return min(self._now_ns() - self._start_ns, processor_ns)

    def begin_process(self) -> None:
        """Begin anew in a process that was forked; without a file, leave it alone."""
        try:
            self._file.open()
        except OSError:
            self._file.close()
            self._go_away()
            self._module = None
            return
        self._calls.begin_process()
        self._reset_totals()
        self._come_back()

    # MuJoCo

    def install(self, module: ModuleType) -> None:
        """Replace the engine's functions in the module `mujoco`, which was just imported."""
        self._module = module
        self._write_engine(module)
        if self._change == NO_ENGINE_CLOCK:
            from mjbench.simulation.engine_clock import engine_clock

            engine_clock(False)
            self._note_change()
        for name in _STEPPING:
            self._originals[name] = getattr(module, name)
            self._timed[name] = self._timing(self._originals[name], name)
        for name in filter(lambda name: hasattr(module, name), self._calls.fast_functions):
            self._originals[name] = getattr(module, name)
            self._timed[name] = self._noting(self._originals[name], name)
        self._calibrate()
        for name, timed in self._timed.items():
            setattr(module, name, timed)
        for name in _RESETS:
            setattr(module, name, self._returning(getattr(module, name)))

    def _note_change(self) -> None:
        """Leave a note that the change was applied."""
        with open(os.path.join(self._folder, self._change), "w", encoding="utf-8"):
            pass

    def _write_engine(self, module: ModuleType) -> None:
        """Write the release and the names of its timers and warnings, for those who read them."""
        timer = getattr(module, "mjtTimer", None)
        members = getattr(timer, "__members__", {})
        names = {name.removeprefix("mjTIMER_"): int(value) for name, value in members.items()}
        warnings = getattr(getattr(module, "mjtWarning", None), "__members__", {})
        engine = {
            "version": getattr(module, "__version__", ""),
            "timers": names,
            "warnings": {
                int(value): name.removeprefix("mjWARN_") for name, value in warnings.items()
            },
        }
        path = os.path.join(self._folder, "engine.json")
        with open(path, "w", encoding="utf-8") as file:
            json.dump(engine, file)

    def _timing(self, function: Any, name: str) -> Any:
        """Return what stands for a function of the engine: it notes when it begins and ends.

        `mj_step1` is the first part of a step, and counts as none.
        """
        now_ns, write, one = self._now_ns, self._file.write, int(name != "mj_step1")
        calls, get_frame, is_half = self._calls, sys._getframe, name == "mj_step2"

        # with the names that the engine gives its arguments: collecting any into a tuple and a
        # dictionary would take as long again
        def call(_: Any, m: Any = _NONE, d: Any = _NONE, nstep: Any = _NONE) -> Any:
            if self._to_pass and d is not _NONE:
                self._to_pass -= 1
                return function(m, d) if nstep is _NONE else function(m, d, nstep)
            if d is _NONE:  # the engine says what is wrong
                return function(*(each for each in (m, d, nstep) if each is not _NONE))
            frame = get_frame(1)
            if not self._burst_calls:
                self._begin_burst(m, d, frame)
            elif d is not self._latest[1]:
                self._change_simulation(m, d, frame)
            self._latest = m, d
            if is_half and not self._halves_seen:
                self._halves_seen = calls.look_for_halves(m, frame)
            has_threads = count_threads()
            begin_ns = now_ns()
            if has_threads:
                calls.enter(id(d), frame, begin_ns)
            result = function(m, d) if nstep is _NONE else function(m, d, nstep)
            end_ns = now_ns()
            if has_threads:
                calls.leave(id(d))
            count = one if nstep is _NONE else nstep
            used = write(STEP, begin_ns, end_ns, count, self._timestep_ns)
            calls.add_timed(name, frame, begin_ns, end_ns, count)
            self._last_ns = end_ns
            self._burst_calls += 1
            if self._burst_calls == BURST_CALLS:
                self._end_burst(m, d, frame, end_ns, used)
            return result

        return _replacement(call, function)

    def _noting(self, function: Any, name: str) -> Any:
        """Return what stands for another function of the engine, timed while steps are."""
        now_ns, calls, get_frame = self._now_ns, self._calls, sys._getframe

        def call(_: Any, *args: Any, **kwargs: Any) -> Any:
            if self._to_pass:
                return function(*args, **kwargs)
            begin_ns = now_ns()
            result = function(*args, **kwargs)
            calls.add_timed(name, get_frame(1), begin_ns, now_ns(), 0)
            return result

        return _replacement(call, function)

    def _begin_burst(self, model: Any, data: Any, frame: Any) -> None:
        """Begin a burst: read what must not be read in each call."""
        passed = self._planned_to_pass - self._to_pass
        since_ns = self._now_ns() - self._burst_end_ns
        if passed > BURST_CALLS:
            self._learn_cost(since_ns // passed)
        self._pass_on(passed, since_ns, 0)
        self._calls_passed, self._planned_to_pass = self._passed(), 0
        self._timestep_ns = _timestep_ns(model)
        self._burst_timers = _timers(data)
        self._burst_begin_ns = self._now_ns()
        self._burst_place = frame.f_code, frame.f_lasti
        self._calls.observe(True)
        if not self._first_ns:
            self._first_ns = self._burst_begin_ns
            self._collections = self._collections_ns = self._longest_collection_ns = 0
            self._write_header()
            if self._change == NO_COLLECTION:
                gc.collect()
                gc.freeze()
                gc.disable()
                self._note_change()
        self._file.write(BURST, self._burst_begin_ns, self._burst_begin_ns, 0, 0)

    def _pass_on(self, passed: int, since_ns: int, until_ns: int) -> None:
        """Let calls since the last burst count as those in it.

        Args:
          passed: calls that were passed through.
          since_ns: time since the last burst.
          until_ns: when the last of them ended; 0 where that is not known.
        """
        if self._was_left and self._burst_period_ns:  # nothing counted them
            self._was_left = False
            passed = since_ns // max(1, self._burst_period_ns - self.cold_ns)
        if passed > 0:
            self._calls.pass_on(passed / BURST_CALLS, until_ns)

    def _learn_cost(self, passed_ns: int) -> None:
        """Learn what a timed call costs this program, from what it took between two bursts.

        Where the program's own data fill the caches, that is more than the calibration says.

        Args:
          passed_ns: from one call to the next, on average, since the last burst.
        """
        self._costs_ns.append(self._burst_period_ns - passed_ns)
        del self._costs_ns[:-_MOST_COSTS]
        typical_ns = sorted(self._costs_ns)[len(self._costs_ns) // 2]
        self.cold_ns = max(self.timed_ns, min(typical_ns, _MOST_COST * self.timed_ns))

    def _change_simulation(self, model: Any, data: Any, frame: Any) -> None:
        """Note that a step is of another simulation than the step before it.

        Where that happens at the second step of a burst, by the same call, simulations are stepped
        in turn. Two calls may do different things.
        """
        earlier_model, earlier = self._latest
        is_same_call = (frame.f_code, frame.f_lasti) == self._burst_place
        if self._burst_calls == 1 and earlier_model is model and is_same_call:
            self._turns = {id(earlier): earlier}
        if self._turns is None:
            self._calls.look_for_warnings(earlier, frame, self._now_ns())
        else:
            self._turns[id(data)] = data

    def _end_burst(self, model: Any, data: Any, frame: Any, end_ns: int, used: int) -> None:
        """End a burst: decide how many calls to pass through until the next one."""
        self._end_turns(frame, end_ns)
        if self._burst_timers is not None and (timers := _timers(data)) is not None:
            seconds = [now - then for now, then in zip(timers, self._burst_timers, strict=True)]
            if min(seconds, default=0.0) >= 0.0:  # else the program has reset them meanwhile
                self._file.add_timers(seconds)
        self._calls_timed += self._burst_calls
        period_ns = max(1, (end_ns - self._burst_begin_ns) // self._burst_calls)
        self._burst_period_ns = period_ns
        self._burst_calls = 0
        owed_ns = max(0, self._calls_timed * self.cold_ns - FREE_COST_NS)
        debt_ns = owed_ns / MAX_COST_SHARE - self._elapsed_ns()
        by_cost = int(debt_ns / period_ns) if debt_ns > 0 else 0
        # the fuller the file, the fewer calls have a record: it never overflows
        by_space = BURST_CALLS * used // max(1, CAPACITY - 2 * BURST_CALLS - used)
        self._to_pass = max(by_cost, by_space if used > CAPACITY // 2 else 0)
        if used > CAPACITY - 2 * BURST_CALLS:
            self._to_pass = sys.maxsize
        self._planned_to_pass = self._to_pass
        self._calls.observe(False)
        self._calls.look(model, data, frame, end_ns)
        self._calls.observe(not self._to_pass)
        if self._to_pass and period_ns < FASTEST_PASSED_NS:
            self._go_away()
        self._write_header()
        self._burst_end_ns = self._now_ns()

    def _end_turns(self, frame: Any, now_ns: int) -> None:
        """Note how many simulations were stepped in turn; let go of the program's objects."""
        with contextlib.suppress(TypeError):
            self._latest_data = weakref.ref(self._latest[1])
        self._latest = None, None
        if self._turns is not None:
            self._calls.note_turns(len(self._turns), frame, now_ns)
            for data in self._turns.values():
                self._calls.look_for_warnings(data, frame, now_ns)
            self._turns = None

    def _passed(self) -> int:
        """Return how many calls were passed through until now."""
        return self._calls_passed + self._planned_to_pass - self._to_pass

    def _cost_ns(self) -> int:
        return self._calls_timed * self.cold_ns + self._passed() * self.passed_ns

    def _has_earned_bursts(self) -> bool:
        return self._cost_ns() - FREE_COST_NS < MAX_COST_SHARE * self._elapsed_ns()

    def _go_away(self) -> None:
        """Give the program the engine's own functions, until it resets a simulation."""
        self._is_away = self._was_away = self._was_left = True
        self._to_pass = self._planned_to_pass = 0
        for name, function in self._originals.items():
            if getattr(self._module, name) is self._timed[name]:
                setattr(self._module, name, function)

    def _come_back(self) -> None:
        """Time a burst again, where the last one went away."""
        if self._is_away and self._module is not None:
            self._is_away = False
            for name, function in self._originals.items():
                if getattr(self._module, name) is function:
                    setattr(self._module, name, self._timed[name])

    def _returning(self, function: Any) -> Any:
        """Return what stands for a function that resets a simulation."""

        def call(_: Any, *args: Any, **kwargs: Any) -> Any:
            if self._is_away and self._has_earned_bursts():
                self._come_back()
            if self._calls.is_observing and len(args) > 1:
                self._calls.look_for_warnings(args[1], sys._getframe(1), self._now_ns())
            return function(*args, **kwargs)

        return _replacement(call, function)

    def install_rollout(self, module: ModuleType) -> None:
        """Note when a program first steps by `mujoco.rollout`, whose threads are not timed."""
        if hasattr(module, "rollout"):
            module.rollout = self._beginning(module.rollout)  # type: ignore[attr-defined]
        if hasattr(module, "Rollout"):
            module.Rollout.rollout = self._beginning(module.Rollout.rollout)

    def install_batch(self, module: ModuleType) -> None:
        """Note when a program first steps by `mujoco.batch`."""
        owner = getattr(module, "Batch", None)
        for method in ("rollout", "step"):
            if hasattr(owner, method):
                setattr(owner, method, self._beginning(getattr(owner, method)))

    def _beginning(self, function: Any) -> Any:
        """Return what stands for a function that steps on threads: it notes the first call."""

        def call(*args: Any, **kwargs: Any) -> Any:
            if not self._first_ns:
                self._first_ns = self._now_ns()
                self._write_header()
            return function(*args, **kwargs)

        return _like(call, function)

    def _calibrate(self) -> None:
        """Measure what a call costs that is timed, and one that is passed through."""

        def nothing(*args: Any, **kwargs: Any) -> None:
            return None

        self._calls.count_as_own(__file__, True)
        call, costs = self._timing(nothing, "nothing"), []
        # one call more than a burst has: none ends while calls are calibrated
        for to_pass, calls in ((0, BURST_CALLS + 1), (sys.maxsize, 0)):
            blocks = []
            for _ in range(5):
                self._to_pass, self._burst_calls = to_pass, calls
                begin_ns = self._now_ns()
                for _ in range(CALIBRATION_CALLS // 5):
                    call(None, None)
                middle_ns = self._now_ns()
                for _ in range(CALIBRATION_CALLS // 5):
                    nothing(None, None)
                end_ns = self._now_ns()
                blocks.append((middle_ns - begin_ns) - (end_ns - middle_ns))
            costs.append(max(0, min(blocks)) // (CALIBRATION_CALLS // 5))
        self.timed_ns, self.passed_ns = costs
        self.cold_ns = max(self.timed_ns, self._cold_cost_ns(call, nothing))
        self._to_pass = self._burst_calls = 0
        self._file.open()  # without the records of the calibration
        self._calls.count_as_own(__file__, False)
        self._calls.begin_process()
        self._begin_clocks()
        self._write_header()

    def _cold_cost_ns(self, call: Any, nothing: Any) -> int:
        """Return what a timed call costs where the caches hold the program's data, not the clock's.

        A step of the engine leaves little of the clock in them.
        """
        data = bytes(COLD_BYTES)
        self._to_pass, self._burst_calls = 0, BURST_CALLS + 1
        medians = []
        for function in (call, nothing):
            durations = []
            for _ in range(COLD_CALLS):
                data.count(1)  # reads them all
                begin_ns = self._now_ns()
                function(None, None)
                durations.append(self._now_ns() - begin_ns)
            medians.append(sorted(durations)[COLD_CALLS // 2])
        return medians[0] - medians[1]

    # Environments and garbage collection

    def install_environment(self, module: ModuleType, class_name: str, method: str) -> None:
        """Note when an environment begins a step."""
        owner = getattr(module, class_name, None)
        original = getattr(owner, method, None)
        if owner is None or original is None:
            return

        def call(*args: Any, **kwargs: Any) -> Any:
            if self._burst_calls:
                begin_ns = self._now_ns()
                self._file.write(ITERATION, begin_ns, begin_ns, 0, 0)
            return original(*args, **kwargs)

        setattr(owner, method, _like(call, original))

    def note_collection(self, phase: str, info: Any) -> None:
        """Note how long a garbage collection takes; Python calls this at its start and stop."""
        if self._has_ended:  # what Python frees when it ends is not the program's
            return
        now_ns = self._now_ns()
        if phase == "start":
            self._collection_begin_ns = now_ns
            return
        duration_ns = now_ns - self._collection_begin_ns
        self._collections += 1
        self._collections_ns += duration_ns
        self._longest_collection_ns = max(self._longest_collection_ns, duration_ns)
        if info.get("generation") == 2:  # the slow ones
            self._write_header()

    def _write_header(self) -> None:
        self._file.write_header(
            os.getpid(),
            self._first_ns,
            self._last_ns,
            self._calls_passed,
            self._was_away,
            self._cost_ns(),
            self.timed_ns,
            self._collections,
            self._collections_ns,
            self._longest_collection_ns,
            self._process_ns,
        )

    def end(self) -> None:
        """Write what the last burst left; called when the process ends by itself."""
        self._has_ended = True
        passed = self._planned_to_pass - self._to_pass
        if passed > 0 or self._was_left:
            # the last of these calls may have ended any time ago, but not before it could
            period_ns = max(1, self._burst_period_ns - self.cold_ns)
            since_ns = self._now_ns() - self._burst_end_ns
            until_ns = self._burst_end_ns + (since_ns if self._was_left else passed * period_ns)
            self._pass_on(passed, since_ns, min(until_ns, self._now_ns()))
        if self._is_away:
            self._last_ns = self._now_ns()
        self._calls_timed += self._burst_calls
        latest = self._latest[1] if self._latest_data is None else self._latest_data()
        if latest is not None:
            self._calls.look_for_warnings(latest, None, self._last_ns)
        self._end_turns(None, self._last_ns)
        if self._calls.is_observing and self._last_ns:
            self._calls.observe(False)
        self._burst_calls = 0
        self._write_header()


class _MuJoCo:
    """What replacements are methods of; other processes that read one have their own instead."""

    def __reduce__(self) -> tuple[Callable[[str], ModuleType], tuple[str]]:
        """Return how to get the module `mujoco`, which has the replacement as an attribute."""
        return importlib.import_module, ("mujoco",)

    def __getattr__(self, name: str) -> Any:
        """Return what `mujoco` has, as a copy of a method asks for it."""
        return getattr(sys.modules["mujoco"], name)

    def __repr__(self) -> str:
        return "mujoco"


def _replacement(call: Any, function: Any) -> Any:
    """Return what stands for a function of the engine; `call` has one more argument, the first.

    It is a method that has its object already, so it does not become one of a class that has it as
    an attribute, as the engine's function does not. To call an object of a class of our own would
    take half as long again.
    """
    _copy_names(function, call)
    return MethodType(call, _MuJoCo())


def _copy_names(function: Any, replacement: Any) -> None:
    """Give a replacement the name and documentation of what it stands for."""
    for name in ("__name__", "__qualname__", "__doc__", "__module__"):
        value = getattr(function, name, None)
        if value is not None:
            setattr(replacement, name, value)
    replacement.__wrapped__ = function


def _like(call: Any, function: Any) -> Any:
    """Return a method that stands for another."""
    _copy_names(function, call)
    return call


def _timestep_ns(model: Any) -> int:
    """Return the timestep of a model; 0 where there is none."""
    try:
        return int(1e9 * model.opt.timestep)
    except (AttributeError, TypeError):
        return 0


def _timers(data: Any) -> list[float] | None:
    """Return the seconds by the engine's timers of a simulation."""
    try:
        return [float(value) for value in data.timer.duration]
    except (AttributeError, TypeError):
        return None


class _AfterImport(importlib.abc.MetaPathFinder):
    """Calls a function with a module of a certain name, once that was imported."""

    def __init__(self, actions: dict[str, Callable[[ModuleType], None]]) -> None:
        self._actions = actions

    def find_spec(
        self, fullname: str, path: Any, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return another finder's module, whose loader calls the function afterwards."""
        if fullname not in self._actions:
            return None
        for finder in sys.meta_path:
            if finder is self or not hasattr(finder, "find_spec"):
                continue
            spec = finder.find_spec(fullname, path, target)
            if spec is not None:
                _call_after(spec, fullname, self._actions)
                return spec
        return None


def _call_after(
    spec: importlib.machinery.ModuleSpec,
    name: str,
    actions: dict[str, Callable[[ModuleType], None]],
) -> None:
    """Let the loader of a module call its function once the module was executed."""
    loader = spec.loader
    execute = getattr(loader, "exec_module", None)
    if execute is None:
        return

    def exec_module(module: ModuleType) -> None:
        execute(module)
        action = actions.pop(name, None)  # only once: a module may be looked for without import
        try:
            if action is not None:
                action(module)
        except Exception as error:
            print(f"mjbench: steps are not timed: {error}", file=sys.stderr)

    try:
        loader.exec_module = exec_module  # type: ignore[union-attr, method-assign]
    except AttributeError:  # a loader that takes no attributes
        return


def _hide_from_tracebacks() -> None:
    """Let what an uncaught exception prints leave out the clock's own frames."""
    earlier = sys.excepthook

    def report(kind: type[BaseException], error: BaseException, frames: Any) -> None:
        earlier(kind, error, _without_own(frames))

    sys.excepthook = report
    import threading

    earlier_of_threads = threading.excepthook

    def report_of_thread(arguments: Any) -> None:
        error = arguments.exc_value
        if error is not None:
            error = error.with_traceback(_without_own(error.__traceback__))
            arguments = threading.ExceptHookArgs(
                (arguments.exc_type, error, error.__traceback__, arguments.thread)
            )
        earlier_of_threads(arguments)

    threading.excepthook = report_of_thread


def _without_own(frames: Any) -> Any:
    """Return a traceback without the frames of the clocks."""
    rest = []
    while frames is not None:
        if not frames.tb_frame.f_code.co_filename.startswith(_HERE):
            rest.append(frames)
        frames = frames.tb_next
    following = None
    for frame in reversed(rest):
        frame.tb_next = following
        following = frame
    return following


def _note_crashes(path: str) -> None:
    """Let a crash leave the line that the program was at, in a file of its own.

    The program sees a fault handler that is not enabled, until it enables it itself.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        # a number that no file of the program gets, even if the program closes what it inherits
        high = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, _HIGH_DESCRIPTOR)
        os.close(descriptor)
        descriptor = high
    enable, is_enabled = faulthandler.enable, faulthandler.is_enabled
    enable(descriptor, all_threads=False)

    def enable_for_program(*args: Any, **kwargs: Any) -> None:
        faulthandler.is_enabled = is_enabled
        enable(*args, **kwargs)

    faulthandler.enable = _like(enable_for_program, enable)
    faulthandler.is_enabled = _like(lambda: False, is_enabled)


def start(folder: str, calls: Any, change: str = "") -> StepClock:
    """Start the clock of this process, and of those that it forks; see `StepClock`."""
    clock = StepClock(folder, calls, change)

    def environment(class_name: str, method: str) -> Callable[[ModuleType], None]:
        return lambda module: clock.install_environment(module, class_name, method)

    def both(
        first: Callable[[ModuleType], None], second: Callable[[ModuleType], None]
    ) -> Callable[[ModuleType], None]:
        def action(module: ModuleType) -> None:
            first(module)
            second(module)

        return action

    actions: dict[str, Callable[[ModuleType], None]] = {
        "mujoco": both(clock.install, both(calls.install, calls.install_callbacks)),
        "mujoco.rollout": both(clock.install_rollout, calls.install_rollout),
        "mujoco.batch": both(clock.install_batch, calls.install_batch),
        "mujoco.mjx": calls.install_mjx,
        "jax": calls.install_jax,
        "multiprocessing.process": calls.install_processes,
    }
    for module_name, class_name, method in _ENVIRONMENTS:
        actions[module_name] = environment(class_name, method)
    sys.meta_path.insert(0, _AfterImport(actions))
    gc.callbacks.append(clock.note_collection)
    _hide_from_tracebacks()
    if not faulthandler.is_enabled():
        _note_crashes(os.path.join(folder, f"{os.getpid()}.fault"))
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=clock.begin_process)
    atexit.register(clock.end)
    return clock
