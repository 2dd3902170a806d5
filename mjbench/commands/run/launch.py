"""Run the user's program as it is, with the step clock inside and the sampling profiler beside it.

Standard input, output and error, the arguments, the folder and the exit code are the program's own;
so are Ctrl-C and other signals, which reach it as they would without mjbench. The environment has
two more variables.
"""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from mjbench.commands.lint.python_source import NOTEBOOK_SUFFIX, save_as_python
from mjbench.commands.run import (
    activities,
    call_times,
    gil_waits,
    py_spy,
    recorded_models,
    step_times,
)
from mjbench.commands.run.activities import Place
from mjbench.commands.run.call_times import ProgramCalls
from mjbench.commands.run.gil_waits import GilWait
from mjbench.commands.run.py_spy import Frame, ThreadSamples
from mjbench.commands.run.recorded_models import RecordedModel
from mjbench.commands.run.sampling import ProcessorClock, ProcessorUse, Profiling
from mjbench.commands.run.step_times import StepTimes
from mjbench.commands.run.thread_pools import ThreadPools
from mjbench.errors import (
    InputError,
    MachineError,
    file_argument,
    is_of_model,
    one_line,
    shown,
    with_help,
)
from mjbench.host import files

# Seconds between looks at the program: until Python has started it, and then.
_START_LOOK_S, _LOOK_S = 0.01, 0.03
# Seconds for the step clock to begin its file, which Python does before the program.
_START_S = 10.0
# Seconds for the program to end after Ctrl-C, and again after SIGTERM; and after a signal that ends
# the run, too.
_END_S, _INTERRUPTED_S = 2.0, 0.3
_ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_SIGNALS = (*_ENDING_SIGNALS, "SIGUSR1", "SIGUSR2")
# A frame of a stack that Python's `faulthandler` writes.
_FAULT_LINE = re.compile(r'File "(.+)", line (\d+) in (.+)$', re.MULTILINE)
_HOOK = Path(__file__).with_name("hook")


@dataclass(frozen=True)
class Program:
    """A program to run."""

    arguments: Sequence[str]
    interpreter: str = sys.executable

    @property
    def name(self) -> str:
        return self.arguments[1] if self.arguments[0] == "-m" else Path(self.arguments[0]).name

    @property
    def command(self) -> list[str]:
        """What is run; a file whose name begins with a dash is no option of Python."""
        first, *others = self.arguments
        return [self.interpreter, first if first == "-m" else file_argument(first), *others]


@dataclass(frozen=True)
class UncaughtException:
    """What ended a program.

    Attributes:
      text: its type and its message.
      place: the user's line that raised it.
      is_of_model: whether MuJoCo refuses the model.
    """

    text: str
    place: Place | None
    is_of_model: bool = False


@dataclass(frozen=True)
class ProgramObservation:
    """What was seen of a program.

    Attributes:
      was_ended: as that of `result.ProgramRow`.
      was_interrupted: whether a signal to mjbench ended the run.
      problem: why there are no samples, in one line; empty where there are.
      untimed_pids: processes whose steps were not timed, since the disk is full.
    """

    wall_s: float
    pid: int
    threads: Sequence[ThreadSamples]
    steps: Sequence[StepTimes]
    rate_hz: int
    exit_code: int = 0
    was_ended: bool = False
    was_interrupted: bool = False
    processor: ProcessorUse | None = None
    problem: str = ""
    calls: ProgramCalls = ProgramCalls()  # noqa: RUF009 - it is frozen
    models: Sequence[RecordedModel] = ()
    crash: Place | None = None
    exception: UncaughtException | None = None
    gil_waits: Sequence[GilWait] = ()
    pools: ThreadPools | None = None
    queued_s: float | None = None
    untimed_pids: Collection[int] = ()


def check(program: Program) -> None:
    """Refuse a program that is not there, before anything is started."""
    first = program.arguments[0]
    if first == "-m":
        if len(program.arguments) == 1:
            raise InputError("-m needs the name of a module")
    elif not os.path.exists(first):  # noqa: PTH110 - False for a name that no file can have
        raise InputError(f"no such file: {shown(first)}")
    elif first.endswith(NOTEBOOK_SUFFIX):
        raise InputError(f"{shown(first)}: {save_as_python(first)}")
    py_spy.program()


def run(
    program: Program,
    seconds: float | None = None,
    rate_hz: int | None = None,
    most_s: float = math.inf,
    ends_on_signal: bool = False,
    environment: Mapping[str, str] | None = None,
) -> ProgramObservation:
    """Run a program to its end, and return what was seen.

    Args:
      environment: further variables, of a second run, whose input and output are nobody's.
      ends_on_signal: whether Ctrl-C, SIGTERM and SIGHUP end the run within a second, and the
        program with it; by default they are the program's, which may go on.
      seconds: after its first step, for which it runs before it is ended as by Ctrl-C; None to let
        it run. A program of MJX counts as stepping from the first function that JAX has compiled.
    """
    with files.temporary_folder() as folder:
        running: list[subprocess.Popen[bytes]] = []
        received: list[signal.Signals] = []
        with _noting_signals(received) if ends_on_signal else _passing_signals_to(running):
            begin = ProcessorClock.now()
            process = _start(program, folder, environment)
            running.append(process)
            was_ended, first_ns = False, None
            try:
                profiling = _start_profiler(process, folder, rate_hz, received)
                while process.poll() is None:
                    time.sleep(_START_LOOK_S if profiling is None else _LOOK_S)
                    first_ns = first_ns or _first_step_ns(folder)
                    if profiling is not None:
                        profiling.look()
                    has_stepped = seconds is not None and _stepped_s(folder, first_ns) > seconds
                    is_late = time.monotonic() - begin.time_s > most_s
                    if received or (not was_ended and (has_stepped or is_late)):
                        was_ended = True
                        _end(process, received)
            except BaseException:  # nobody would wait for it any more
                _end(process)
                raise
        end, processor = ProcessorClock.now(), None
        if profiling is not None:
            processor = end.use(begin, profiling)
            profiling.sampler.finish(is_hurried=bool(received))
        seen = _observation(folder, process.pid, profiling, begin.time_s, end.time_s)
        code = process.returncode
        return replace(
            seen,
            exit_code=code if code >= 0 else 128 - code,
            was_ended=was_ended or bool(received),
            was_interrupted=bool(received),
            models=() if received else seen.models,  # which would be stepped for seconds
            processor=processor,
        )


def _observation(
    folder: Path, pid: int, profiling: Profiling | None, begin_s: float, end_s: float
) -> ProgramObservation:
    """Return what the profiler and the clocks have seen."""
    waits: Sequence[GilWait] = ()
    pools: ThreadPools | None = None
    threads: Sequence[ThreadSamples] = ()
    problem = py_spy.TOO_SHORT
    if profiling is not None:
        threads, problem = profiling.samples(end_s)
        pools = profiling.crowded(threads)
        waits = gil_waits.gil_waits(profiling.thread_times.times(), threads, profiling.holders())
    return ProgramObservation(
        wall_s=end_s - begin_s,
        pid=pid,
        threads=threads,
        steps=step_times.read_all(folder),
        rate_hz=py_spy.DEFAULT_RATE_HZ if profiling is None else profiling.rate_hz,
        problem=problem,
        calls=call_times.read_all(folder, step_times.read_headers(folder), end_s),
        models=recorded_models.read_all(folder),
        crash=_crash(folder),
        exception=_exception(folder / f"{pid}.exception"),
        gil_waits=waits,
        pools=pools,
        queued_s=None if profiling is None else profiling.thread_times.queued_s(pid),
        untimed_pids=step_times.untimed_pids(folder),
    )


def _crash(folder: Path) -> Place | None:
    """Return the innermost line of the user's code on the stack that `faulthandler` has written."""
    files = sorted(folder.glob("*.fault"))
    places = (_innermost_own(file.read_text(encoding="utf-8", errors="replace")) for file in files)
    return next(filter(None, places), None)


def _exception(file: Path) -> UncaughtException | None:
    """Return what ended the program, as `hook.start` notes it."""
    if not file.exists():
        return None
    text = file.read_text(encoding="utf-8", errors="replace")
    raised = one_line(text.partition("\n")[0])
    return UncaughtException(with_help(raised), _innermost_own(text), is_of_model(raised))


def _innermost_own(text: str) -> Place | None:
    """Return the first line of the user's code in a stack, innermost first; of none, of any."""
    stack = [Frame(function, path, int(line)) for path, line, function in _FAULT_LINE.findall(text)]
    own = [frame for frame in stack if activities.is_own(frame)]
    return next(map(activities.place_of, own or stack), None)


def _start(
    program: Program, folder: Path, variables: Mapping[str, str] | None
) -> "subprocess.Popen[bytes]":
    path = os.pathsep.join(filter(None, [str(_HOOK), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "PYTHONPATH": path, "MJBENCH_STEP_CLOCK": str(folder)}
    stream = None if variables is None else subprocess.DEVNULL
    try:
        return subprocess.Popen(
            program.command,
            env={**environment, **(variables or {})},
            stdin=stream,
            stdout=stream,
            stderr=stream,
        )
    except OSError as error:
        raise MachineError(
            f"cannot start {shown(program.interpreter)}: {error.strerror}"
        ) from error


def _start_profiler(
    process: "subprocess.Popen[bytes]",
    folder: Path,
    rate_hz: int | None,
    received: Sequence[signal.Signals],
) -> Profiling | None:
    """Start the profiler once Python runs; None where the program ends before."""
    file, begin_s = folder / f"{process.pid}.steps", time.monotonic()
    while not file.exists() and time.monotonic() - begin_s < _START_S:
        if process.poll() is not None or received:
            return None
        time.sleep(_START_LOOK_S)
    return Profiling.begin(process.pid, folder, rate_hz)


def _first_step_ns(folder: Path) -> int | None:
    first_ns = [header.first_ns for header in step_times.read_headers(folder).values()]
    return min(filter(None, first_ns), default=None)


def _stepped_s(folder: Path, first_ns: int | None) -> float:
    """Return for how long a program has stepped; one of MJX may never call `mj_step`."""
    begin_ns = first_ns or call_times.first_compiled_ns(folder)
    return (time.perf_counter_ns() - begin_ns) / 1e9 if begin_ns else 0.0


def _end(process: "subprocess.Popen[bytes]", received: Sequence[signal.Signals] = ()) -> None:
    """End the program and what it started as Ctrl-C does; by force where that does not do.

    Args:
      received: signals to mjbench; from the first on, there is little time.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        # a terminal sends Ctrl-C to both
        has_had_it = number == signal.SIGINT and number in received and _is_foreground()
        if not has_had_it:
            _send(process, number)
        begin_s = time.monotonic()
        while time.monotonic() - begin_s < (_INTERRUPTED_S if received else _END_S):
            if process.poll() is not None:
                return
            time.sleep(_LOOK_S)
    _kill(process)


def _kill(process: "subprocess.Popen[bytes]") -> None:
    _send(process, signal.SIGKILL)
    process.wait()


def _send(process: "subprocess.Popen[bytes]", number: int) -> None:
    """Send a signal to the program and to all that it started, as a terminal does."""
    import psutil

    with contextlib.suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                child.send_signal(number)
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(number)


@contextlib.contextmanager
def _passing_signals_to(running: "Sequence[subprocess.Popen[bytes]]") -> Iterator[None]:
    """While the block runs, signals are the programs': mjbench passes them on."""

    def pass_on(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT and _is_foreground():
            return  # the terminal has sent it to the program, too
        for process in running:
            process.send_signal(number)

    with _handling(_SIGNALS, pass_on):
        yield


@contextlib.contextmanager
def _noting_signals(received: list[signal.Signals]) -> Iterator[None]:
    with _handling(_ENDING_SIGNALS, lambda number, _: received.append(signal.Signals(number))):
        yield


@contextlib.contextmanager
def _handling(
    names: Sequence[str], handle: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Let a function handle signals, unless they are ignored, or go to another thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    earlier = {number: signal.getsignal(number) for number in numbers}
    try:
        for number, handler in earlier.items():
            if handler != signal.SIG_IGN:
                signal.signal(number, handle)
        yield
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)


def _is_foreground() -> bool:
    with contextlib.suppress(OSError), open("/dev/tty", "rb", buffering=0) as terminal:  # noqa: PTH123
        return os.tcgetpgrp(terminal.fileno()) == os.getpgrp()
    return False
