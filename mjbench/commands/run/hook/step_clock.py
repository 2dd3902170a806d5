"""The step clock: when the user's program calls the engine, and for how long.

It replaces `mujoco.mj_step`, `mj_step1` and `mj_step2` by functions that note when each call begins
and ends, once the program has imported MuJoCo. It also notes when an environment begins a step.
Records go into a file that is mapped into memory, one for each process, so they survive any end of
the program.

The clock must cost little. It times bursts of calls; between them, calls pass through.

`step_file` has the format of the files.
"""

import os
import sys
import time
import weakref
from _thread import _count as count_threads
from collections.abc import Callable
from types import FrameType, ModuleType
from typing import Any

from .call_bursts import BURST_CALLS, Burst, CallBursts, Pacer, Written, cold_cost_ns
from .call_clock import FAST, STEPS, CallClock
from .collection_clock import CollectionClock
from .engine_calls import EngineCalls
from .function_replacement import engine_function, named_like
from .step_file import BURST, ITERATION, STEP, StepFile
from .watch import Watch, write_engine

# Bursts from which the cost of a timed call is learned, and times the calibrated cost at most.
_MOST_COSTS, _MOST_COST = 15, 5
CALIBRATION_CALLS = 2000
_RESETS = ("mj_resetData", "mj_resetDataKeyframe")


class StepClock:
    """Times the engine's calls of this process in bursts."""

    def __init__(
        self,
        folder: str,
        calls: CallClock,
        watch: Watch,
        now_ns: Callable[[], int] = time.perf_counter_ns,
        processor_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        """Begin the process's file."""
        self._folder = folder
        self._now_ns, self._pacer = now_ns, Pacer(now_ns, processor_ns)
        self._file, self._calls, self._watch = StepFile(folder), calls, watch
        self.collections = CollectionClock(now_ns)
        self._burst = Burst(calls)
        bursts = CallBursts(calls, now_ns, processor_ns)
        self._others = EngineCalls(self, bursts, watch, now_ns)
        calls.before_steps = self._note_first
        calls.step_counts.append(self._count)
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
        self._pacer.begin()
        self._first_ns = self._last_ns = 0
        self._calls_timed = 0
        self._latest_burst: Written = ()
        self._others.bursts.begin_process()
        self._burst_begin_ns = 0
        self.burst_calls = 0
        self._burst_timers: list[float] | None = None
        self._latest_ids = id(None), id(None)  # of model and data of the step before
        self._latest: Callable[[], Any] = lambda: None  # returns this data
        self._has_several = False  # simulations
        self._burst_place: tuple[Any, int] = None, 0  # code and instruction of its first step
        self._turns: dict[int, Any] | None = None  # weak references to simulations in turn
        self._halves_seen = False
        self._burst_period_ns = self._burst_end_ns = 0
        self._costs_ns: list[int] = []  # of a timed call, as bursts have shown
        self.collections.begin(self._file.write_collections)
        self._write_header()

    def begin_process(self) -> None:
        """Begin anew in a process that was forked; without a file, leave it alone."""
        try:
            self._file.open()
        except OSError:
            self.leave()
            return
        self._burst.begin_process()
        self._reset_totals()

    def leave(self) -> None:
        """Leave the process alone: it has no file."""
        self._file.close()
        self.collections.end()
        if self._module is not None:
            for name, function in self._originals.items():
                if getattr(self._module, name) is self._timed[name]:
                    setattr(self._module, name, function)

    # MuJoCo

    def install(self, module: ModuleType) -> None:
        """Replace the engine's functions in the module `mujoco`, which was just imported."""
        self._module = module
        write_engine(self._folder, module)
        for name in STEPS:
            self._originals[name] = getattr(module, name)
            self._timed[name] = self._timing(self._originals[name], name)
        for name in filter(lambda name: hasattr(module, name), FAST):
            self._originals[name] = getattr(module, name)
            self._timed[name] = self._others.timing(self._originals[name], name)
        self._calibrate()
        for name, timed in self._timed.items():
            setattr(module, name, timed)
        for name in _RESETS:
            setattr(module, name, self._returning(getattr(module, name)))

    def _note_first(self) -> None:
        """Note when the program first steps, be it on threads that are not timed."""
        if not self._first_ns:
            self._first_ns = self._now_ns()
            self._write_header()

    def _observe(self, is_observing: bool) -> None:
        """Note whether steps are timed from now on; write what was timed."""
        self._latest_burst = self._burst.write() or self._latest_burst
        self._calls.is_observing = is_observing

    def _timing(self, function: Any, name: str) -> Any:
        """Return what stands for a function of the engine: it notes when it begins and ends.

        `mj_step1` is the first part of a step, and counts as none.
        """
        pacer, now_ns, write = self._pacer, self._now_ns, self._file.write
        add, watch, one = self._burst.add, self._watch, int(name != "mj_step1")
        is_half = name == "mj_step2"

        # With the names that the engine gives its arguments: collecting any into a tuple and a
        # dictionary would take as long again. None, which the engine refuses, is compared fastest.
        # All that only a timed call needs is in another function: Python would copy its variables.
        def call(_: Any, m: Any, d: Any, nstep: Any = None) -> Any:
            for _ in pacer.passes:
                return function(m, d) if nstep is None else function(m, d, nstep)
            return timed(m, d, nstep, sys._getframe(1))

        def timed(m: Any, d: Any, nstep: Any, frame: FrameType) -> Any:
            if not self.burst_calls:
                self._begin_burst(m, d, frame)
            elif id(d) != self._latest_ids[1]:
                self._change_simulation(m, d, frame)
            if is_half and not self._halves_seen:
                self._halves_seen = watch.look_for_halves(m, frame)
            has_threads = count_threads()
            begin_ns = now_ns()
            if has_threads:
                watch.enter(id(d), frame, begin_ns)
            result = function(m, d) if nstep is None else function(m, d, nstep)
            end_ns = now_ns()
            if has_threads:
                watch.leave(id(d))
            count = one if nstep is None else nstep
            used = write(STEP, begin_ns, end_ns, count, self._timestep_ns)
            add(name, frame, begin_ns, end_ns, count)
            self._last_ns = end_ns
            self.burst_calls += 1
            if self.burst_calls == BURST_CALLS:
                self._end_burst(m, d, frame, end_ns, used)
            return result

        return engine_function(call, function)

    def _begin_burst(self, model: Any, data: Any, frame: Any) -> None:
        """Begin a burst: read what must not be read in each call."""
        self._note_latest(model, data)
        passed = self._pacer.passed_since
        since_ns = self._now_ns() - self._burst_end_ns
        if passed > BURST_CALLS:
            self._learn_cost(since_ns // passed)
        self._timestep_ns = _timestep_ns(model)
        self._burst_timers = _timers(data)
        self._burst_begin_ns = self._now_ns()
        self._burst_place = frame.f_code, frame.f_lasti
        self._observe(True)
        if not self._first_ns:
            self._first_ns = self._burst_begin_ns
            self.collections.begin(self._file.write_collections)
            self._write_header()
        self._file.write(BURST, self._burst_begin_ns, self._burst_begin_ns, 0, 0)

    def _pass_on(self, until_ns: int = 0) -> None:
        """Let untimed calls count as those of the latest burst; `until_ns` of 0 is not known."""
        if passed := self._pacer.passed_since:
            self._burst.pass_on(self._latest_burst, passed / BURST_CALLS, until_ns)

    def _learn_cost(self, passed_ns: int) -> None:
        """Learn what a timed call costs this program, from what it took between two bursts.

        Where the program's own data fill the caches, that is more than the calibration says. Where
        its own calls vary by more, their quartile does not take this for a cost.
        """
        self._costs_ns.append(self._burst_period_ns - passed_ns)
        del self._costs_ns[:-_MOST_COSTS]
        typical_ns = sorted(self._costs_ns)[len(self._costs_ns) // 4]
        self.cold_ns = max(self.timed_ns, min(typical_ns, _MOST_COST * self.timed_ns))

    def _note_latest(self, model: Any, data: Any) -> None:
        """Note of which simulation a step is.

        Its data are kept only while there are no others: those that the program lets go of would be
        freed, and sampled, within the clock.
        """
        self._latest_ids = id(model), id(data)
        self._latest = _reference(data) if self._has_several else lambda: data

    def _change_simulation(self, model: Any, data: Any, frame: Any) -> None:
        """Note that a step is of another simulation than the step before it.

        Where that happens at the second step of a burst, by the same call, simulations are stepped
        in turn. Two calls may do different things.
        """
        earlier, (earlier_model, earlier_id) = self._latest(), self._latest_ids
        self._has_several = True
        self._note_latest(model, data)
        is_same_call = (frame.f_code, frame.f_lasti) == self._burst_place
        if self.burst_calls == 1 and earlier_model == id(model) and is_same_call:
            self._turns = {} if earlier is None else {earlier_id: _reference(earlier)}
        if self._turns is None:
            self._watch.look_for_warnings(earlier, frame, self._now_ns())
        else:
            self._turns[id(data)] = _reference(data)

    def _end_burst(self, model: Any, data: Any, frame: Any, end_ns: int, used: int) -> None:
        """End a burst: decide how many calls to pass through until the next one."""
        self._end_turns(frame, end_ns)
        if self._burst_timers is not None and (timers := _timers(data)) is not None:
            seconds = [now - then for now, then in zip(timers, self._burst_timers, strict=True)]
            if min(seconds, default=0.0) >= 0.0:  # else the program has reset them meanwhile
                self._file.add_timers(seconds)
        period_ns = max(1, (end_ns - self._burst_begin_ns) // self.burst_calls)
        self._burst_period_ns = period_ns
        self._calls_timed += self.burst_calls
        self._pacer.spend(self.burst_calls * self.cold_ns)
        self.burst_calls = 0
        to_pass = self._pacer.calls_to_pass(period_ns)
        to_pass = max(to_pass, self._file.calls_to_pass(used, BURST_CALLS))
        self._observe(False)
        # those before it, not those after it: a slow burst lets fewer pass, and would weigh less
        self._pass_on()
        self._pacer.let_pass(to_pass)
        self._watch.look(model, data, frame, end_ns)
        self._observe(not to_pass)
        self._write_header()
        self._burst_end_ns = self._now_ns()

    def _end_turns(self, frame: Any, now_ns: int) -> None:
        """Note how many simulations were stepped in turn; let go of the program's objects.

        Those that the program has let go of were new in each iteration, and not in turn.
        """
        self._latest = _reference(self._latest())
        if self._turns is not None:
            present = [data for each in self._turns.values() if (data := each()) is not None]
            if len(present) > 1:
                self._watch.note_turns(len(present), frame, now_ns)
            for data in present:
                self._watch.look_for_warnings(data, frame, now_ns)
            self._turns = None

    def _count(self) -> int:
        """Return what changes when the program steps."""
        return self._calls_timed + self.burst_calls + self._pacer.passed

    def _cost_ns(self) -> int:
        own_ns = self._calls_timed * self.cold_ns + self._pacer.passed * self.passed_ns
        return own_ns + self._calls.cost_ns

    def _returning(self, function: Any) -> Any:
        def call(_: Any, *args: Any, **kwargs: Any) -> Any:
            if self._calls.is_observing and len(args) > 1:
                self._watch.look_for_warnings(args[1], sys._getframe(1), self._now_ns())
            return function(*args, **kwargs)

        return engine_function(call, function)

    def _calibrate(self) -> None:
        def nothing(*args: Any, **kwargs: Any) -> None:
            return None

        # by clocks that write into no file: what they time is not the program's
        calls = CallClock(os.devnull, self._now_ns)
        calls.is_own[__file__] = True
        clock = StepClock(os.devnull, calls, Watch(os.devnull, calls), now_ns=self._now_ns)
        call, costs = clock._timing(nothing, "nothing"), []
        # one call more than a burst has: none ends while calls are calibrated
        for to_pass, burst_calls in ((0, BURST_CALLS + 1), (sys.maxsize, 0)):
            timed_ns, nothing_ns = [], []
            for _ in range(5):
                clock._pacer.let_pass(to_pass)
                clock.burst_calls = burst_calls
                begin_ns = self._now_ns()
                for _ in range(CALIBRATION_CALLS // 5):
                    call(None, None)
                middle_ns = self._now_ns()
                for _ in range(CALIBRATION_CALLS // 5):
                    nothing(None, None)
                end_ns = self._now_ns()
                timed_ns.append(middle_ns - begin_ns)
                nothing_ns.append(end_ns - middle_ns)
            cost_ns = max(0, min(timed_ns) - min(nothing_ns))
            costs.append(cost_ns // (CALIBRATION_CALLS // 5))
        self.timed_ns, self.passed_ns = costs
        clock._pacer.let_pass(0)
        clock.burst_calls = BURST_CALLS + 1
        cold_ns = cold_cost_ns(lambda: call(None, None), lambda: nothing(None, None), self._now_ns)
        self.cold_ns = max(self.timed_ns, cold_ns)
        self._pacer.begin()
        self._write_header()

    # Environments

    def install_environment(self, module: ModuleType, class_name: str, method: str) -> None:
        owner = getattr(module, class_name, None)
        original = getattr(owner, method, None)
        if owner is None or original is None:
            return

        def call(*args: Any, **kwargs: Any) -> Any:
            if self.burst_calls:
                begin_ns = self._now_ns()
                self._file.write(ITERATION, begin_ns, begin_ns, 0, 0)
            return original(*args, **kwargs)

        setattr(owner, method, named_like(original, call))

    def _write_header(self) -> None:
        self._file.write_header(
            os.getpid(),
            self._first_ns,
            self._last_ns,
            self._pacer.passed_before,
            self._cost_ns(),
            self.timed_ns,
            self._process_ns,
        )

    def end(self) -> None:
        """Write what the last burst left; called when the process ends by itself."""
        self.collections.end()  # what Python frees when it ends is not the program's
        if self.burst_calls:
            self._pass_on()
            self._pacer.let_pass(0)
        else:  # the last of these calls may have ended any time ago, but not before it could
            period_ns = max(1, self._burst_period_ns - self.cold_ns)
            passed_ns = self._pacer.passed_since * period_ns
            self._pass_on(min(self._burst_end_ns + passed_ns, self._now_ns()))
        self._calls_timed += self.burst_calls
        self._others.bursts.end()
        latest = self._latest()
        if latest is not None:
            self._watch.look_for_warnings(latest, None, self._last_ns)
        self._end_turns(None, self._last_ns)
        if self._calls.is_observing and self._last_ns:
            self._observe(False)
        self.burst_calls = 0
        self._write_header()


def _timestep_ns(model: Any) -> int:
    try:
        return int(1e9 * model.opt.timestep)
    except (AttributeError, TypeError):
        return 0


def _timers(data: Any) -> list[float] | None:
    try:
        return [float(value) for value in data.timer.duration]
    except (AttributeError, TypeError):
        return None


def _reference(value: Any) -> Callable[[], Any]:
    """Return what gives an object for as long as the program has it.

    What is no simulation, and cannot be referred to so, is given for ever.
    """
    try:
        return weakref.ref(value)
    except TypeError:
        return lambda: value
