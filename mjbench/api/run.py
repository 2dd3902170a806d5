"""What `mjbench run` measures: the user's program, and what remedies save."""

import sys
from collections.abc import Sequence
from pathlib import Path

from mjbench.api.session import Item, Items, Measurement, Observer
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.program import launch
from mjbench.program.launch import Program
from mjbench.program.records import ProgramRow
from mjbench.program.remedies import confirm, listing
from mjbench.program.sampling import Sampling
from mjbench.report import flame
from mjbench.store.runs import Record, Run

# Seconds for which a running program is sampled, unless the user says.
_ATTACHED_S = 10.0


def measurement(
    program: Sequence[str],
    seconds: float | None,
    pid: int | None,
    rate_hz: int | None,
    has_native: bool,
    interpreter: str | None,
    flame_graph: Path | None,
    is_confirmed: bool,
) -> Measurement:
    """Return the measurement of a program with its arguments, or of a running one."""
    if bool(program) == (pid is not None):
        raise InputError("give a program to run, or --attach PID")
    to_run = Program(program, interpreter or sys.executable) if program else None
    if to_run is not None:
        launch.check(to_run)
    if is_confirmed and to_run is None:
        raise InputError("--confirm runs the program again, which --attach cannot")
    sampling = Sampling(rate_hz, has_native)

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        if to_run is not None:
            name, seen = to_run.name, launch.run(to_run, seconds, sampling)
        else:
            assert pid is not None, "one of both is given"
            name, seen = f"process {pid}", launch.attach(pid, seconds or _ATTACHED_S, sampling)
        row = ProgramRow.of(name, seen)
        if flame_graph is not None:
            flame.write(flame_graph, seen.threads)
        if is_confirmed and to_run is not None and row.loops:
            yield from _with_confirmed(to_run, row, observer)
        else:
            yield Item([row])

    arguments = {
        "program": program,
        "seconds": seconds,
        "attach": pid,
        "rate_hz": rate_hz,
        "has_native": has_native,
        "confirm": is_confirmed,
    }
    files = [Path(program[0])] if program and Path(program[0]).is_file() else []
    return Measurement("run", arguments, files, items)


def _with_confirmed(program: Program, row: ProgramRow, observer: Observer) -> Items:
    tried = list(row.loops[0].remedies)
    copies = listing.copies(row.steps, machine.usable_cores())
    if copies is not None:
        tried.append(copies)
    most = confirm.most_runs(tried)

    def advance(number: int, name: str) -> None:
        observer(name, number / most)

    try:
        confirmed = confirm.confirm(program, tried, advance)
    except KeyboardInterrupt:
        yield Item([row])
        raise
    yield Item([row.with_remedies(confirmed)])


def exit_code_of(run: Run) -> int | None:
    """Return that of the program, 0 where mjbench ended it; None where it was not measured."""
    codes = [0 if row.was_ended else row.exit_code for row in run.of_type(ProgramRow)]
    return codes[0] if codes else None
