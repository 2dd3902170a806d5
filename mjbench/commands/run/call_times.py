"""What a program called, on which line, how often and for how long, as the call clock noted it.

`hook/call_clock.py` writes the files, and defines their format.
"""

import contextlib
import json
import struct
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.bounds import AnyFloat, Int64, NonNegativeFloat, NonNegativeInt
from mjbench.commands.run import activities
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.hook import call_clock, file_owners
from mjbench.commands.run.py_spy import Frame
from mjbench.commands.run.source_loops import SourceLoop, program_loop
from mjbench.commands.run.step_times import Header, read_engine

# What callees do, but for functions of the engine: those are physics.
_ACTIVITIES: Mapping[str, Activity] = {
    **dict.fromkeys(("MjData", *call_clock.COPIES_OF_DATA, "copy of MjModel"), Activity.COPYING),
    **dict.fromkeys(("mj_copyData", "mj_getState", "mj_setState"), Activity.COPYING),
    **dict.fromkeys(call_clock.LOADERS, Activity.LOADING),
    **dict.fromkeys(("Renderer", "update_scene", "render"), Activity.RENDERING),
    **dict.fromkeys((call_clock.TRACE, call_clock.COMPILE), Activity.COMPILING),
    call_clock.DISPATCH: Activity.DISPATCH,
    call_clock.DEVICE_WAIT: Activity.DEVICE_WAIT,
    call_clock.TRANSFER: Activity.TRANSFER,
    call_clock.PROCESS_START: Activity.STARTING,
}
# Calls that return an object with memory of its own.
CREATORS = ("MjData", *call_clock.COPIES_OF_DATA, *call_clock.LOADERS, "Renderer")
# What the clock notes that is no call.
_FACTS = (call_clock.SHARED_DATA, call_clock.HALVES, call_clock.COPIED_ENVIRONMENT)


# A thread of one process, and a loop that it runs; None where it runs none.
_Runner = tuple[int, SourceLoop | None]


@dataclass(frozen=True)
class CallThreads:
    """On what a call steps many simulations: as many threads, each with a chunk of them at a time.

    Attributes:
      chunk_size: 0 where the program gives none.
      has_sensors: whether the call returns sensor data.
    """

    count: NonNegativeInt
    chunk_size: NonNegativeInt
    has_sensors: bool


@dataclass(frozen=True)
class CallTime:
    """The calls of one function from one line of the user's code, on one thread.

    Attributes:
      callee: what was called.
      pid: the process.
      thread: as Python numbers it.
      place: the line.
      loop: the outermost loop that runs it; None where none does.
      calls: how many; where they were timed in bursts, with an estimate of those between them. What
        JAX traces counts with what it compiles. Of calls that load models, those count before which
        the process has stepped since the last one: others are its set-up.
      seconds: that they took; likewise.
      first_ns: when the first began that was timed, on the clock of `time.perf_counter_ns`.
      last_ns: when the last ended that was timed.
      steps: of one simulation, summed over calls.
      all_steps: of all simulations.
      clock_s: seconds that timing them took the program.
      frame: of a renderer and what it draws, height and width in pixels; None of other calls.
      backend: of both, `MUJOCO_GL`; "" if that was not set.
      threads: of a call that steps many simulations; None of other calls.
      lines: file and number of the user's lines that led to the first call, innermost first.
    """

    callee: str
    pid: NonNegativeInt
    thread: Int64
    place: Place
    loop: SourceLoop | None
    calls: NonNegativeFloat
    seconds: AnyFloat
    first_ns: Int64
    last_ns: Int64
    steps: NonNegativeFloat
    all_steps: NonNegativeFloat
    clock_s: NonNegativeFloat = 0.0
    frame: tuple[NonNegativeInt, NonNegativeInt] | None = None
    backend: str = ""
    threads: CallThreads | None = None
    lines: Sequence[tuple[str, NonNegativeInt]] = ()

    @property
    def activity(self) -> Activity:
        if self.is_callback:
            return Activity.PYTHON
        return _ACTIVITIES.get(self.callee, Activity.PHYSICS)

    @property
    def is_callback(self) -> bool:
        """Whether it is a Python function that MuJoCo calls in a step."""
        return self.callee.startswith(call_clock.CALLBACK)

    @property
    def runner(self) -> _Runner:
        return self.thread, self.loop

    @property
    def is_of_jax(self) -> bool:
        return self.callee in (call_clock.TRACE, call_clock.COMPILE, *call_clock.FAST_JAX)

    @property
    def is_fast(self) -> bool:
        """Whether it is timed only while steps are."""
        fast = (*call_clock.FAST, *call_clock.FAST_JAX, *call_clock.STEPS)
        return self.callee in fast or self.is_callback

    @property
    def is_step(self) -> bool:
        return self.all_steps > 0 or self.callee == call_clock.EAGER_MJX


@dataclass(frozen=True)
class ArgumentChange:
    """How an argument differs from what a function of JAX was compiled for.

    Attributes:
      argument: its name, such as `d.ctrl`.
      kind: a name of `argument_types`, such as WEAK_TYPE.
      before: its type, such as `float32[2]`, or its value.
      now: likewise.
    """

    argument: str
    kind: str
    before: str
    now: str


@dataclass(frozen=True)
class Incident:
    """What only a run shows: a warning of the engine such as BADQACC, or a name of `call_clock`.

    Attributes:
      count: how often it was seen; of IN_TURN, how many simulations there are.
      seconds: that it took.
      changes: of RECOMPILED, how the arguments of the first differ; empty if they do not.
      is_unfinished: of RECOMPILED, whether the program ended before it.
    """

    name: str
    place: Place
    count: int
    seconds: float = 0.0
    changes: Sequence[ArgumentChange] = ()
    is_unfinished: bool = False

    @property
    def is_wrong(self) -> bool:
        return self.name not in (call_clock.IN_TURN, call_clock.RECOMPILED)


@dataclass(frozen=True)
class ProgramCalls:
    """The calls of all processes of a program.

    Attributes:
      memory_growth_bytes: by how much the memory of the process that grew most has grown since
        shortly after its first step; None where that is not known.
    """

    calls: Sequence[CallTime] = ()
    incidents: Sequence[Incident] = ()
    memory_growth_bytes: int | None = None


def read_all(
    folder: Path, headers: Mapping[int, Header], end_s: float | None = None
) -> ProgramCalls:
    """Return the calls of all processes of a program, which ended at `end_s`, a monotonic time."""
    names = read_engine(folder).warnings
    calls: list[CallTime] = []
    incidents: list[Incident] = []
    growth: list[int] = []
    for file in sorted(folder.glob("*.calls")):
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError, struct.error):
            of_process = _read(file, headers.get(int(file.stem)), names, end_s)
            calls += of_process.calls
            incidents += of_process.incidents
            if of_process.memory_growth_bytes is not None:
                growth.append(of_process.memory_growth_bytes)
    return ProgramCalls(calls, incidents, max(growth, default=None))


def first_compiled_ns(folder: Path) -> int | None:
    """Return when a program of MJX first ran what JAX compiles, on the clock of its files."""
    begin = call_clock.MEMORY.size
    size = begin + call_clock.FIRST_COMPILED.size
    heads = []
    for file in folder.glob("*.calls"):
        with file.open("rb") as stream:
            heads.append(stream.read(size))
    first_ns = (
        call_clock.FIRST_COMPILED.unpack_from(head, begin)[0] for head in heads if len(head) == size
    )
    return min(filter(None, first_ns), default=None)


@dataclass(frozen=True)
class _Slot:
    calls: int
    ns: int
    timed_calls: int
    timed_ns: int
    first_ns: int
    last_ns: int
    steps: int
    all_steps: int
    passed_calls: int
    passed_ns: int
    passed_steps: int


def _read(
    file: Path, header: Header | None, warnings: Mapping[int, str], end_s: float | None
) -> ProgramCalls:
    raw = file.read_bytes()
    slots = [_Slot(*values) for values in call_clock.SLOT.iter_unpack(raw)]
    timed: list[tuple[CallTime, _Slot]] = []
    incidents: list[Incident] = []
    for site in map(json.loads, _lines(file.with_suffix(".sites"))):
        slot, callee, places = slots[site["slot"]], site["callee"], _places(site["stack"])
        if callee.startswith(call_clock.WARNING):
            kind = int(callee.split()[1])
            incidents.append(Incident(warnings.get(kind, str(kind)), places[0], slot.calls))
        elif callee in _FACTS:
            incidents.append(Incident(callee, places[0], slot.calls))
        elif callee == call_clock.IN_TURN:
            simulations = round(slot.all_steps / max(1, slot.calls))
            incidents.append(Incident(callee, places[0], simulations))
        elif callee == call_clock.RECOMPILED:
            changes = [ArgumentChange(*change) for change in site.get("detail", ())]
            is_unfinished = slot.calls < slot.steps
            seconds = 1e-9 * slot.ns
            if is_unfinished and end_s is not None:
                seconds += max(0.0, end_s - 1e-9 * slot.last_ns)
            incidents.append(
                Incident(callee, places[0], slot.steps, seconds, changes, is_unfinished)
            )
        else:
            detail, draws = site.get("detail"), callee in call_clock.DRAWERS
            height, width, backend = detail if detail and draws else (0, 0, "")
            call = CallTime(
                callee=callee,
                pid=int(file.stem),
                thread=site["thread"],
                place=places[0],
                loop=_loop(site["stack"]),
                calls=slot.calls,
                seconds=1e-9 * slot.ns,
                first_ns=slot.first_ns,
                last_ns=slot.last_ns,
                steps=slot.steps,
                all_steps=slot.all_steps,
                frame=(int(height), int(width)) if height and width else None,
                backend=str(backend),
                threads=None
                if draws or not detail
                else CallThreads(int(detail[0]), int(detail[1]), bool(detail[2])),
                lines=[place.position for place in places],
            )
            timed.append((call, slot))
    first_bytes, latest_bytes = call_clock.MEMORY.unpack_from(raw)
    growth = latest_bytes - first_bytes if first_bytes else None
    return ProgramCalls(_without_callbacks(_estimated(timed, header)), incidents, growth)


def _lines(file: Path) -> list[str]:
    """Return the whole lines of a file; the last may have been cut short."""
    *whole, _ = file.read_text(encoding="utf-8").split("\n")
    return whole


def _places(stack: Sequence[tuple[str, int, str]]) -> list[Place]:
    """Return the lines of the user's code, innermost first; the innermost line where none is."""
    own = [frame for frame in stack if not file_owners.package_of(frame[0])] or stack[:1]
    return [activities.place_of(Frame(function, file, line)) for file, line, function in own]


def _loop(stack: Sequence[tuple[str, int, str]]) -> SourceLoop | None:
    """Return the outermost loop on a stack; those of JAX trace and compile, and run nothing."""
    lines = [(file, n) for file, n, _ in reversed(stack) if file_owners.package_of(file) != "jax"]
    running = program_loop(lines)
    if running is None:
        return None
    return replace(running[0], file=activities.shown_path(running[0].file))


def _estimated(timed: Sequence[tuple[CallTime, _Slot]], header: Header | None) -> list[CallTime]:
    """Return the calls with those between bursts, which take no longer than there was time.

    The calls that were timed take what was measured, even where the clock seems to cost more.
    """
    timed = _with_callbacks_between_bursts(timed)
    # callbacks are parts of steps
    fast = [slot for call, slot in timed if call.is_fast and not call.is_callback]
    timed_calls = sum(slot.timed_calls for slot in fast)
    if header is None or not timed_calls:
        return [call for call, _ in timed]
    slow = [slot for call, slot in timed if not call.is_fast and slot.first_ns >= header.first_ns]
    span_ns = max(slot.last_ns for slot in [*fast, *slow]) - header.first_ns
    rest_ns = span_ns - header.cost_ns - sum(slot.ns for slot in slow)
    # a few long calls among those that were timed do not make all of them longer than the time
    rest_ns = max(rest_ns, sum(slot.ns for slot in fast))
    cap = min(1.0, rest_ns / max(1, sum(slot.ns + slot.passed_ns for slot in fast)))
    return [
        replace(
            call,
            calls=call.calls + slot.passed_calls,
            seconds=1e-9 * (slot.ns + slot.passed_ns) * (cap if slot.passed_ns else 1.0),
            steps=call.steps + slot.passed_steps,
            all_steps=call.all_steps + slot.passed_steps,
            clock_s=1e-9 * header.cost_ns * slot.timed_calls / timed_calls,
        )
        if call.is_fast
        else call
        for call, slot in timed
    ]


def _with_callbacks_between_bursts(
    timed: Sequence[tuple[CallTime, _Slot]],
) -> list[tuple[CallTime, _Slot]]:
    """Return the slots, where callbacks were called in steps between bursts as in those timed.

    Those steps are of the same loop and thread: another loop may have no callback, or be timed from
    end to end.
    """
    in_bursts, passed = Counter[_Runner](), Counter[_Runner]()
    for call, slot in timed:
        if call.callee in call_clock.STEPS:
            in_bursts[call.runner] += slot.timed_calls
            passed[call.runner] += slot.passed_calls

    def estimated(call: CallTime, slot: _Slot) -> _Slot:
        ratio = passed[call.runner] / max(1, in_bursts[call.runner])
        return replace(
            slot,
            passed_calls=round(ratio * slot.timed_calls),
            passed_ns=round(ratio * slot.timed_ns),
        )

    return [(call, estimated(call, slot) if call.is_callback else slot) for call, slot in timed]


def _without_callbacks(calls: Sequence[CallTime]) -> list[CallTime]:
    """Return the calls, where the time of a callback is not that of the step as well."""
    callbacks_s, steps_s = defaultdict[_Runner, float](float), defaultdict[_Runner, float](float)
    for call in calls:
        if call.is_callback:
            callbacks_s[call.runner] += call.seconds
        elif call.callee in call_clock.STEPS:
            steps_s[call.runner] += call.seconds
    return [
        replace(
            call,
            seconds=call.seconds * max(0.0, 1 - callbacks_s[call.runner] / steps_s[call.runner]),
        )
        if call.callee in call_clock.STEPS and steps_s[call.runner] > 0
        else call
        for call in calls
    ]
