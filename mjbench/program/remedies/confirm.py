"""Measure what remedies save: run the program with and without each, in turns."""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.errors import InputError, MjbenchError
from mjbench.host import files, machine
from mjbench.loop import lint_fixes
from mjbench.measuring import stats
from mjbench.program import launch
from mjbench.program.hook import step_clock
from mjbench.program.launch import Program
from mjbench.program.remedies.remedy import Confirmed, Remedy, RemedyKind
from mjbench.program.step_times import StepTimes

# Runs of each kind: the interval of a median needs six at least.
ROUNDS = 8
# Seconds of stepping of a run.
RUN_S = 2.0

_CHANGES = {
    RemedyKind.CLOCK: step_clock.NO_ENGINE_CLOCK,
    RemedyKind.COLLECTION: step_clock.NO_COLLECTION,
}

# Runs a program once; returns its steps. Arguments: change, and the file to run in its place.
Run = Callable[[str, Path | None], Sequence[StepTimes]]
Advance = Callable[[int, str], None]


@dataclass(frozen=True)
class Rerun:
    """One way of running the program again."""

    change: str = ""
    source: Path | None = None
    copies: int = 1

    @property
    def name(self) -> str:
        if self.copies > 1:
            return f"{self.copies} copies at once"
        return self.change or "the program again"


def confirm(
    program: Program, remedies: Sequence[Remedy], advance: Advance, run: Run | None = None
) -> list[Remedy]:
    """Return the remedies, with what those saved that can be applied without the user.

    Args:
      advance: called before each run with the number of runs done, and what runs.
    """
    run = run or functools.partial(launch.time_steps, program, RUN_S)
    with files.temporary_folder() as folder:
        original, fixed = _sources(program, folder)
        reruns = [_rerun(remedy, program, original, fixed) for remedy in remedies]
        unchanged = Rerun(source=original)
        distinct = list(dict.fromkeys([unchanged, *(rerun for rerun in reruns if rerun)]))
        if len(distinct) == 1:
            return list(remedies)
        seconds = _seconds_per_step(distinct, run, advance)
    return [
        remedy
        if rerun is None or not len(seconds[rerun]) == ROUNDS == len(seconds[unchanged])
        else replace(remedy, confirmed=_confirmed(seconds[unchanged], seconds[rerun]))
        for remedy, rerun in zip(remedies, reruns, strict=True)
    ]


def most_runs(remedies: Sequence[Remedy]) -> int:
    """Return how often `confirm` runs a program, at most; copies that run at once count once."""
    kinds = {remedy.kind for remedy in remedies} & {*_CHANGES, RemedyKind.COPIES}
    has_fixes = any(remedy.code and remedy.gain is not None for remedy in remedies)
    return ROUNDS * (1 + len(kinds) + has_fixes)


def _sources(program: Program, folder: Path) -> tuple[Path | None, Path | None]:
    file = Path(program.arguments[0])
    if program.arguments[0] == "-m" or not file.is_file():
        return None, None
    try:
        result = lint_fixes.fix(str(file))
    except InputError:
        return file, None
    if not result.fixed:
        return file, None
    fixed = folder / file.name
    fixed.write_bytes(result.after.data)
    return file, fixed


def _rerun(
    remedy: Remedy, program: Program, original: Path | None, fixed: Path | None
) -> Rerun | None:
    """Return how to run with a remedy; None where mjbench cannot apply it."""
    if remedy.kind in _CHANGES:
        return Rerun(_CHANGES[remedy.kind], original)
    if remedy.kind == RemedyKind.COPIES:
        return Rerun(source=original, copies=machine.usable_cores())
    is_own = remedy.place is not None and Path(remedy.place.file).name == program.name
    if remedy.code and remedy.gain is not None and is_own and fixed is not None:
        return Rerun(source=fixed)
    return None


def _seconds_per_step(
    reruns: Sequence[Rerun], run: Run, advance: Advance
) -> dict[Rerun, list[float]]:
    seconds: dict[Rerun, list[float]] = {rerun: [] for rerun in reruns}
    for number in range(ROUNDS):
        # every other round goes backward: a drift of the machine favours none
        for i, rerun in enumerate(reruns if number % 2 == 0 else reruns[::-1]):
            advance(number * len(reruns) + i, rerun.name)
            if len(seconds[rerun]) < number:
                continue  # it has failed
            try:
                steps = _run_copies(run, rerun)
            except MjbenchError:
                continue
            rate = sum(each.steps_per_s or 0.0 for each in steps)
            if rate > 0:
                seconds[rerun].append(1 / rate)
    return seconds


def _run_copies(run: Run, rerun: Rerun) -> list[StepTimes]:
    with ThreadPoolExecutor(rerun.copies) as pool:
        running = [pool.submit(run, rerun.change, rerun.source) for _ in range(rerun.copies)]
        return [each for done in running for each in done.result()]


def _confirmed(unchanged_s: Sequence[float], changed_s: Sequence[float]) -> Confirmed:
    speedup = stats.speedup(unchanged_s, changed_s)
    assert speedup.low is not None and speedup.high is not None, "there are enough rounds"
    return Confirmed(
        gain=1 - 1 / speedup.median,
        low=1 - 1 / speedup.low,
        high=1 - 1 / speedup.high,
        runs=len(changed_s),
    )
