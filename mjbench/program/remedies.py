"""What to do first: what would make a program faster, by what it would gain at most.

Every gain is measured in this very program: it is the share of the loop's time that samples saw
there. What replaces it takes time, too, so the gain is an upper bound. `confirm` measures some
remedies in full, by running the program again.
"""

import enum
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.errors import InputError
from mjbench.loop import lint
from mjbench.loop.lint import Finding
from mjbench.program.activities import STANDARD_LIBRARY, Activity, Place
from mjbench.program.attribution import LineTime, LoopTime
from mjbench.program.step_times import StepTimes
from mjbench.simulation import package_timer

# Rules of lint about what a program computes, not about its time.
WRONG_RESULTS = ("MJB001",)
# Smaller gains are not worth a line.
LEAST_GAIN = 0.01


class RemedyKind(enum.StrEnum):
    """What a remedy changes."""

    RESULT = "wrong result"
    """The program computes or stores what it does not mean."""
    LINE = "line"
    """A line of the user's code."""
    CLOCK = "package's timer"
    """A step reads the timer of MuJoCo's Python package."""
    COLLECTION = "garbage collection"
    """Python's garbage collector."""
    ACTIVITY = "activity"
    """An activity as a whole."""
    COPIES = "copies"
    """How many copies of the program run at once; not listed before it is measured."""


@dataclass(frozen=True)
class Remedy:
    """One thing to do.

    Attributes:
      kind: what it changes.
      activity: whose time it saves; None for a wrong result.
      place: where; None for the whole loop.
      text: what to do.
      gain: share of the loop's time that it saves at most; None for a wrong result.
      gain_error: standard error of that share.
      code: of the lint rule that it follows; "" for none.
      confirmed: the share that it saved when the program ran again with and without it, and its
        error; None where that was not tried.
    """

    kind: RemedyKind
    activity: Activity | None
    place: Place | None
    text: str
    gain: float | None
    gain_error: float | None
    code: str = ""
    confirmed: "Confirmed | None" = None

    @property
    def is_certain(self) -> bool:
        """Whether it is more than chance; where it was tried, whether it helped."""
        if self.confirmed is not None:
            return self.confirmed.is_certain
        return self.gain is None or self.gain > 2 * (self.gain_error or 0.0)

    @property
    def rank(self) -> tuple[int, float]:
        """Where it stands: wrong results, then by gain; last what did not help when tried."""
        if self.gain is None:
            return 0, 0.0
        if self.kind == RemedyKind.COPIES:  # it makes no copy faster
            return 3, 0.0
        if self.confirmed is None:
            return 1, -self.gain
        return (1, -self.confirmed.gain) if self.confirmed.is_certain else (2, -self.gain)


@dataclass(frozen=True)
class Confirmed:
    """What a remedy saved in runs of the program with and without it.

    Attributes:
      gain: share of a step's time; negative where it is slower.
      low: lower end of its interval, of 95 %.
      high: upper end.
      runs: of each kind.
    """

    gain: float
    low: float
    high: float
    runs: int

    @property
    def is_certain(self) -> bool:
        """Whether the remedy certainly saves time."""
        return self.low > 0


# What to do about an activity, where nothing more is known.
_ADVICE: Mapping[Activity, str] = {
    Activity.PYTHON: "do less in Python here: compute with whole arrays, or less often",
    Activity.BINDINGS: "read views of the engine's arrays once, before the loop",
    Activity.NUMPY: "compute less often, or on fewer and larger arrays",
    Activity.ALLOCATION: "write into arrays that were created before the loop (out=)",
    Activity.POLICY: "the policy takes this long: batch its inputs, or use a smaller one",
    Activity.RENDERING: "render fewer frames, or smaller ones",
    Activity.LOGGING: "write less often, and more at a time",
    Activity.PROCESSES: "give each process more work for a message, or use threads (rollout)",
    Activity.THREADS: "the loop waits for another thread of the program",
    Activity.SLEEPING: "the program sleeps: leave it out where nobody watches",
    Activity.COLLECTION: "call gc.freeze() after set-up, or gc.disable() in the loop",
    Activity.IMPORT: "import before the loop",
    Activity.LOADING: "load or compile models before the loop",
}
# Activities that are changed line by line; each of the others, but physics, is one thing to change.
_OF_LINES = {Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY, Activity.ALLOCATION}
_STEP_ADVICE = "call mj_step(model, data, nstep) where nothing happens between steps"
_CLOCK_ADVICE = f"turn off {package_timer.NAME}: {package_timer.OFF_CODE}, after creating MjData"


def remedies(loop: LoopTime, steps: Sequence[StepTimes]) -> list[Remedy]:
    """Return what to do about a loop: wrong results first, then by gain.

    Lint checks the user's own files that run in the loop.

    Args:
      loop: where its time goes.
      steps: of all processes.
    """
    findings = _findings(loop.own_files)
    listed = [*_wrong(findings), *_savings(loop, steps, findings)]
    worthwhile = [each for each in listed if each.gain is None or each.gain >= LEAST_GAIN]
    return sorted(worthwhile, key=lambda remedy: remedy.rank)


def copies(steps: Sequence[StepTimes], cores: int) -> Remedy | None:
    """Return what to do with cores that the program leaves idle; None where it uses several.

    Args:
      steps: of all processes.
      cores: that the program may use.
    """
    if cores < 2 or sum(each.step is not None for each in steps) != 1:
        return None
    text = f"run {cores} processes at once, such as environments of a vectorised one"
    bound = 1 - 1 / cores
    return Remedy(RemedyKind.COPIES, Activity.PHYSICS, None, text, bound, None)


def first(listed: Sequence[Remedy]) -> Remedy | None:
    """Return the most important remedy that is certain: not by chance, and not refuted.

    Copies of the program are none: they do more, and each no faster.
    """
    certain = (each for each in listed if each.is_certain and each.kind != RemedyKind.COPIES)
    return next(certain, None)


def _findings(files: Sequence[str]) -> Mapping[tuple[str, int], Finding]:
    """Return lint's findings by file and line."""
    findings: dict[tuple[str, int], Finding] = {}
    for file in files:
        try:
            of_file = lint.check(file)
        except InputError:
            continue
        for finding in of_file:
            findings.setdefault((file, finding.line), finding)
    return findings


def _wrong(findings: Mapping[tuple[str, int], Finding]) -> Iterator[Remedy]:
    """Yield what makes a result wrong, whatever it costs."""
    for (file, line), finding in findings.items():
        if finding.code in WRONG_RESULTS:
            place = Place(file, line, "")
            yield Remedy(RemedyKind.RESULT, None, place, finding.message, None, None, finding.code)


def _savings(
    loop: LoopTime, steps: Sequence[StepTimes], findings: Mapping[tuple[str, int], Finding]
) -> Iterator[Remedy]:
    """Yield what saves time, in any order."""
    if loop.engine_clock >= package_timer.MIN_GAIN:
        share = loop.engine_clock
        yield _remedy(loop, RemedyKind.CLOCK, Activity.PHYSICS, None, _CLOCK_ADVICE, share)
    if Activity.COLLECTION not in loop.activities:
        yield from _collections(loop, steps)
    unexplained = {each: share for each, share in loop.activities.items() if each in _OF_LINES}
    for activity in loop.activities.keys() - _OF_LINES - {Activity.PHYSICS}:
        yield _of_activity(loop, activity)
    for lines in _functions(loop):
        if not _avoidable(lines[0]):
            continue
        if _is_spread(loop, lines):
            yield _of_function(loop, lines)
        else:
            lines = [line for line in lines if _avoidable(line) >= LEAST_GAIN]
            for line in lines:
                yield _of_line(loop, line, findings.get((line.place.file, line.place.line)))
        for line in lines:
            for activity in line.activities.keys() & _OF_LINES:
                unexplained[activity] -= line.activities[activity]
    for activity, share in unexplained.items():
        yield _remedy(loop, RemedyKind.ACTIVITY, activity, None, _ADVICE[activity], share)


def _of_activity(loop: LoopTime, activity: Activity) -> Remedy:
    """Return what to do about an activity as a whole, at the line where most of it is."""
    lines = [line for line in loop.lines if activity in line.activities]
    most = max(lines, key=lambda line: line.activities[activity], default=None)
    is_collection = activity == Activity.COLLECTION
    kind = RemedyKind.COLLECTION if is_collection else RemedyKind.ACTIVITY
    place = None if most is None else most.place
    return _remedy(loop, kind, activity, place, _ADVICE[activity], loop.activities[activity])


def _functions(loop: LoopTime) -> Iterator[list[LineTime]]:
    """Yield the lines of each function, those with most to save first."""
    by_function: dict[tuple[str, str], list[LineTime]] = defaultdict(list)
    for line in loop.lines:
        by_function[line.place.file, line.place.function].append(line)
    for lines in by_function.values():
        yield sorted(lines, key=_avoidable, reverse=True)


def _is_spread(loop: LoopTime, lines: Sequence[LineTime]) -> bool:
    """Return whether no line of a function stands out, so that the function is named as a whole.

    The lines of the loop itself are always named.
    """
    is_loop = any(
        line.place.file == loop.loop.file and loop.loop.first <= line.place.line <= loop.loop.last
        for line in lines
    )
    return not is_loop and _avoidable(lines[0]) < sum(map(_avoidable, lines)) / 2


def _avoidable(line: LineTime) -> float:
    """Return the share of a line that is its own to save."""
    return sum(share for activity, share in line.activities.items() if activity in _OF_LINES)


def _main_cost(lines: Sequence[LineTime]) -> Activity:
    """Return what lines spend most time on, physics aside."""
    total: dict[Activity, float] = defaultdict(float)
    for line in lines:
        for activity, share in line.activities.items():
            if activity in _OF_LINES:
                total[activity] += share
    return max(total, key=lambda activity: total[activity], default=Activity.PYTHON)


def _of_line(loop: LoopTime, line: LineTime, finding: Finding | None) -> Remedy:
    """Return what to do about a line."""
    activity, share = _main_cost([line]), _avoidable(line)
    if finding is not None and finding.ns_per_step is not None:
        remedy = _remedy(loop, RemedyKind.LINE, activity, line.place, finding.message, share)
        return replace(remedy, code=finding.code)
    text = _ADVICE[activity]
    if line.package and line.package != STANDARD_LIBRARY:
        text = f"time in {line.package}"
        if Activity.PHYSICS in line.activities:
            text = f"{text} beside physics; `mjbench env` takes an environment apart"
    elif line.main_activity == Activity.PHYSICS and activity == Activity.BINDINGS:
        text = _STEP_ADVICE
    return _remedy(loop, RemedyKind.LINE, activity, line.place, text, share)


def _of_function(loop: LoopTime, lines: Sequence[LineTime]) -> Remedy:
    """Return what to do about a function whose time many lines share."""
    activity, share = _main_cost(lines), sum(map(_avoidable, lines))
    place = replace(lines[0].place, text="")
    text = f"{place.function}() as a whole: {_ADVICE[activity]}"
    return _remedy(loop, RemedyKind.LINE, activity, place, text, share)


def _remedy(
    loop: LoopTime,
    kind: RemedyKind,
    activity: Activity,
    place: Place | None,
    text: str,
    share: float,
) -> Remedy:
    return Remedy(kind, activity, place, text, share, loop.error(share))


def _collections(loop: LoopTime, steps: Sequence[StepTimes]) -> Iterator[Remedy]:
    """Yield the garbage collector, as the step clock timed it.

    The interpreters of some systems do not name their functions, so samples do not show it.
    """
    seconds = sum(step.collections_s for step in steps if step.pid in loop.pids)
    span_s = sum(step.span_s for step in steps if step.pid in loop.pids)
    if span_s and seconds:
        share = min(1.0, seconds / span_s)
        text = _ADVICE[Activity.COLLECTION]
        yield _remedy(loop, RemedyKind.COLLECTION, Activity.COLLECTION, None, text, share)
