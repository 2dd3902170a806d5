"""How much does `mjbench run` slow a program, and do its samples cover the program's time?

    python -m benchmarks.studies.observing [PROGRAM …] [--seconds S] [--rate HZ]

runs each program under `mjbench run` twice: for 20 seconds as it is, and with windows. In every
second window, the program is left alone: the profiler and mjbench are stopped, and the program
calls the engine's own functions. Both windows of a pair follow each other, so other work on the
machine changes both alike.

A program is a model's name, for a loop around `mj_step` with a small observation; or `processes`,
for a loop that waits for four processes, each of which steps the humanoid 20 times. The table has,
for each program, what observing costs with its 95 % interval, what `mjbench run` itself says that
it costs, and the time of the samples of the main loop as a share of the loop's own.

The cost leaves out the first seconds, in which the profiler reads the program's libraries. The
profiler makes up for the samples that it missed while it was stopped, so it is asked for half of
the usual rate. The step clock spends in half of the time what it may spend in all of it; so the
cost is rather too high than too low.
"""

import contextlib
import itertools
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import tally_command
from benchmarks.studies.programs import side
from mjbench.errors import MachineError
from mjbench.measuring import stats
from mjbench.simulation import models
from mjbench.status import ExitCode

if TYPE_CHECKING:
    import psutil

    from mjbench.program.records import ProgramRow

# The engine's step takes about 2, 20 and 300 µs in the models.
PROCESSES = "processes"
PROGRAMS = ("cartpole", "humanoid", "pile", PROCESSES)
# Until the profiler has read libraries, and its rate is settled; seconds of a window, and
# between two, for the program to see that one has ended.
_START_S, _WINDOW_S, _TRANSIT_S = 10.0, 0.25, 0.02
# Seconds of the run in which the program is never left alone.
_ORDINARY_S = 20.0
_PROGRAMS = Path(__file__).with_name("programs")


@dataclass(frozen=True)
class Observed:
    """A program under `mjbench run`.

    Attributes:
      alone_s: seconds of a step in windows in which it was left alone.
      observed_s: seconds of a step in the other window of each pair.
      cost_share: what the run says that observing costs.
      coverage: time of the samples of the loop over its own time.
    """

    alone_s: Sequence[float]
    observed_s: Sequence[float]
    cost_share: float
    coverage: float


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Measure each program, and print the table; return the exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("programs", nargs="*", default=PROGRAMS)
    parser.add_argument("--seconds", type=float, default=200.0, help="of the windows of a program")
    parser.add_argument(
        "--rate", type=int, help="samples per second; by default the usual rate of mjbench run"
    )
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        print(f"{'program':10} {'costs':>7} {'interval':>18} {'it says':>8} {'samples / time':>15}")
        for name in options.programs:
            print(_line(name, observe(name, options.seconds, options.rate)), flush=True)
        return ExitCode.OK

    return tally_command.run("observing", action, "nothing was stored")


def _line(name: str, observed: Observed) -> str:
    """Return the line of a program."""
    slowdown = stats.speedup(observed.observed_s, observed.alone_s)
    ends = [100 * (end - 1) for end in (slowdown.low, slowdown.high) if end is not None]
    interval = " to ".join(f"{end:+.1f}" for end in ends) or "too few windows"
    return (
        f"{name:10} {100 * (slowdown.median - 1):+5.1f} % {interval:>16} %"
        f" {100 * observed.cost_share:6.1f} % {observed.coverage:15.3f}"
    )


def observe(name: str, seconds: float, rate_hz: int | None = None) -> Observed:
    """Run a program under `mjbench run` as it is, and with windows in which it is left alone.

    Args:
      name: a model's, or `PROCESSES`.
      seconds: of all windows.
      rate_hz: samples per second; None for the usual rate.

    Raises:
      InputError: there is no such model.
      MachineError: `mjbench run` failed.
    """
    from mjbench.program.py_spy import DEFAULT_RATE_HZ, MANY_RATE_HZ

    usual_hz = MANY_RATE_HZ if name == PROCESSES else DEFAULT_RATE_HZ
    rate = ["--sample-rate", str(rate_hz)] if rate_hz else []
    ordinary = _run(name, rate, lambda observers, of_program: _let_run(of_program))
    half = ["--sample-rate", str(math.ceil((rate_hz or usual_hz) / 2))]
    divided = _run(
        name, half, lambda observers, of_program: _change_sides(observers, of_program, seconds)
    )
    pairs = pairs_of(divided.windows)
    if not pairs:
        raise MachineError(f"{name}: no window had a block of steps; use more --seconds")
    sampled_s = sum(loop.time.seconds for loop in ordinary.row.loops if loop.time.in_main)
    return Observed(
        [alone_s for alone_s, _ in pairs],
        [observed_s for _, observed_s in pairs],
        ordinary.row.cost_share,
        sampled_s / ordinary.total_s,
    )


def program_of(name: str) -> Path:
    """Return the file of a program."""
    return _PROGRAMS / ("observed_processes.py" if name == PROCESSES else "observed_model.py")


@dataclass(frozen=True)
class Window:
    """A stretch of the program on one side: which, and seconds of a step."""

    which: int
    step_s: float


def pairs_of(windows: Sequence[Window]) -> list[tuple[float, float]]:
    """Return seconds of a step, alone and observed, of windows that follow each other."""
    return [
        (alone.step_s, observed.step_s)
        for alone, observed in itertools.pairwise(windows)
        if (alone.which, observed.which) == (side.ALONE, side.OBSERVED)
    ]


@dataclass(frozen=True)
class _Run:
    """One run of a program: its windows, seconds of its loop, and what mjbench has seen."""

    windows: Sequence[Window]
    total_s: float
    row: "ProgramRow"


def _run(
    name: str, options: Sequence[str], spend: Callable[["_Observers", side.Side], None]
) -> _Run:
    """Run a program under `mjbench run`, until `spend` returns."""
    import msgspec

    from mjbench.program.records import ProgramRow

    path = models.resolve("humanoid" if name == PROCESSES else name).path
    with tempfile.TemporaryDirectory() as folder:
        file, document = Path(folder) / "side", Path(folder) / "run.json"
        file.write_bytes(bytes([side.IN_TRANSIT]))
        command = [sys.executable, "-m", "mjbench", "run", "--json", str(document), *options]
        command += ["--results", folder, str(program_of(name)), str(path), str(file)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        of_program = side.Side(file)
        try:
            spend(_Observers.of(process.pid), of_program)
        finally:
            of_program.change(side.ENDED)
            output, errors = process.communicate()
        if process.returncode:
            raise MachineError(f"mjbench run failed: {errors.decode(errors='replace')[-500:]}")
        *windows, (total_s,) = (line.split() for line in output.decode().splitlines())
        (row,) = json.loads(document.read_text())["results"]
        return _Run(
            [Window(int(which), float(each_s) / int(nstep)) for which, each_s, nstep in windows],
            float(total_s),
            msgspec.convert(row, ProgramRow),
        )


def _let_run(of_program: side.Side) -> None:
    """Let a program run under mjbench for some seconds."""
    of_program.change(side.OBSERVED)
    time.sleep(_ORDINARY_S)


@dataclass(frozen=True)
class _Observers:
    """The process of `mjbench run`, and those that it started."""

    run: "psutil.Process"

    @classmethod
    def of(cls, pid: int) -> "_Observers":
        import psutil

        return cls(psutil.Process(pid))

    @contextlib.contextmanager
    def are_stopped(self) -> Iterator[None]:
        """While the block runs, observers do not."""
        import psutil

        children = self.run.children(recursive=True)
        profilers = [child for child in children if child.name().startswith("py-spy")]
        try:
            for profiler in profilers:
                profiler.suspend()
            while any(each.status() != psutil.STATUS_STOPPED for each in profilers):
                time.sleep(0.0005)
            self.run.suspend()
            yield
        finally:
            for process in (*profilers, self.run):
                process.resume()


def _change_sides(observers: _Observers, of_program: side.Side, seconds: float) -> None:
    """Change the side of the program from window to window.

    Args:
      observers: to be stopped where the program is left alone.
      of_program: the side that it is on.
      seconds: of all windows.
    """
    time.sleep(_START_S)
    for _ in range(round(seconds / (2 * _WINDOW_S))):
        with observers.are_stopped():
            _spend_window(of_program, side.ALONE)
        _spend_window(of_program, side.OBSERVED)


def _spend_window(of_program: side.Side, which: int) -> None:
    of_program.change(which)
    time.sleep(_WINDOW_S)
    of_program.change(side.IN_TRANSIT)
    time.sleep(_TRANSIT_S)


if __name__ == "__main__":
    sys.exit(main())
