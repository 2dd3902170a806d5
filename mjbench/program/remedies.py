"""What to do first: what would make a program faster, and by how much.

What is known of calls that were timed comes from `call_remedies`. Other lines are known from
samples, and their share is an upper bound.
"""

import contextlib
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from mjbench.errors import InputError
from mjbench.loop import lint
from mjbench.loop.lint import Finding
from mjbench.loop.lint_rules import ALLOCATIONS, NEW_ARRAY
from mjbench.program import call_remedies
from mjbench.program.activities import STANDARD_LIBRARY, WAITING, Activity, Place
from mjbench.program.calls import Incident
from mjbench.program.hook import call_clock
from mjbench.program.loop_time import FEW_SAMPLES, LineTime, LoopTime, shares_of
from mjbench.program.remedy import LEAST_GAIN, Basis, Remedy, RemedyKind
from mjbench.program.remedy_table import LINE_REMEDIES, LineRemedy
from mjbench.program.replacements import MeasuredRatios
from mjbench.program.source_loops import loop_within_step
from mjbench.program.step_times import StepTimes
from mjbench.program.trials import Question

# What to do about an activity, where nothing more is known; others have remedies of their calls, or
# are no cost by themselves. Modules are imported once, wherever that is.
_ADVICE: Mapping[Activity, str] = {
    Activity.PYTHON: "do less in Python here: compute with whole arrays, or less often",
    Activity.BINDINGS: "look names up, and take views of the engine's arrays, once before the loop",
    Activity.NUMPY: "compute less often, or on fewer and larger arrays",
    Activity.ALLOCATION: "write into slices of an array that was created before the loop",
    Activity.POLICY: "the policy takes this long: batch its inputs, or use a smaller one",
    Activity.RENDERING: "render fewer frames, or smaller ones; EGL on a GPU is fastest",
    Activity.LOGGING: "write less often, and more at a time",
    Activity.PROCESSES: "give each process more work for a message, or use threads (rollout)",
    Activity.THREADS: "the loop waits for another thread of the program. A step needs no GIL, but"
    " the Python around it does: let each thread take more steps for each wait; `mjbench compare"
    " MODEL --paths python_loop,threads,batch_step` says what threads and mujoco.batch.Batch gain",
    Activity.SLEEPING: "the program sleeps: leave it out where nobody watches; to keep real time,"
    " sleep until begin + i × timestep, so that no delay adds up",
    Activity.COLLECTION: "call gc.freeze() after set-up, or gc.disable() in the loop",
    Activity.LOADING: "load or compile models before the loop",
}
_BUILDING_ADVICE = (
    "build and compile the model once before the loop: change the compiled model, or keep a pool"
    " of bodies"
)
# A line that is one call.
_ONE_CALL = re.compile(r"([\w\s,]+ = )?[\w.]+\([\w\s.,=]*\)$")
# A line that looks up names, or takes views of the engine's arrays.
_READS_VIEWS = re.compile(
    r"\b(data|d)\.(q|x|c|act|sensor|site|geom|body|joint|ten|subtree|mocap)\w*|\.(joint|body|geom|site)\("
)
# What a line calls, and the functions that only create an array.
_CALLED, _CREATE = re.compile(r"(\w+)\("), {*ALLOCATIONS, "append", "asarray", "copy"}
# Activities that are changed line by line; each of the others is one thing to change.
_OF_LINES = {Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY, Activity.ALLOCATION}
# Of calls whose line does little else.
_WITH_THEIR_LINE = (Activity.COPYING, Activity.STARTING)


def remedies(
    loop: LoopTime,
    findings: Sequence[Finding] = (),
    measured: MeasuredRatios | None = None,
    incidents: Sequence[Incident] = (),
    others_busy_s: float = 0.0,
) -> list[Remedy]:
    """Return what to do about a loop, by gain.

    Args:
      others_busy_s: seconds for which another process or thread steps meanwhile: no other way of
        waiting for it saves them.
    """
    known = measured or MeasuredRatios({})
    listed = [
        *_savings(loop, findings, known, others_busy_s),
        *call_remedies.of_turns(loop, known, incidents),
    ]
    if any(incident.name == call_clock.SOFTWARE_GL for incident in incidents):
        listed = [
            replace(each, text=f"{each.text}; here the processor draws (software rendering)")
            if each.activity == Activity.RENDERING
            else each
            for each in listed
        ]
    worthwhile = [each for each in listed if each.gain is not None and each.gain >= LEAST_GAIN]
    return sorted(worthwhile, key=lambda remedy: remedy.rank)


def findings_of(files: Sequence[str]) -> list[Finding]:
    """Return lint's findings in files; those that cannot be checked have none."""
    findings: list[Finding] = []
    for file in files:
        with contextlib.suppress(InputError):
            findings += lint.check(file)
    return findings


def copies(steps: Sequence[StepTimes], cores: int) -> Remedy | None:
    """Return what to do with cores that the program leaves idle; None where it uses several."""
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


def _savings(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios, others_busy_s: float
) -> Iterator[Remedy]:
    of_calls = list(call_remedies.of_calls(loop, findings, measured))
    whole = (loop.activities.keys() & _ADVICE.keys()) - _OF_LINES
    if any(remedy.activity == Activity.STARTING for remedy in of_calls):
        whole -= {Activity.PROCESSES}  # the loop also waits for processes to begin
    if (building := _of_building(loop)) is not None:
        # a model that is built is compiled, too, and has an MjData of its own
        of_model = {Activity.LOADING, Activity.COPYING}
        of_calls = [remedy for remedy in of_calls if remedy.activity not in of_model]
        whole -= of_model
        yield building
    yield from of_calls
    yield from call_remedies.of_steps(loop, measured)
    if loop.samples < FEW_SAMPLES:
        if Activity.COLLECTION in loop.activities:
            yield _of_activity(loop, Activity.COLLECTION)
        return
    unexplained = {each: share for each, share in loop.activities.items() if each in _OF_LINES}
    for activity in whole:
        if not loop.is_timed(activity) or not any(r.activity == activity for r in of_calls):
            remedy = _of_activity(loop, activity)
            if activity in WAITING and remedy.gain is not None:
                gain = min(remedy.gain, 1 - others_busy_s / loop.seconds)
                remedy = replace(remedy, gain=gain, share=remedy.gain)
            yield remedy
    for lines in _functions(loop):
        if not _avoidable(lines[0]):
            continue
        if _is_spread(loop, lines):
            yield _of_function(loop, lines)
        else:
            for line in lines:
                if _avoidable(line) >= LEAST_GAIN:
                    yield from _of_line(loop, line, _findings_at(line.place, findings), measured)
        for line in lines:
            for activity in line.activities.keys() & _OF_LINES:
                unexplained[activity] -= line.activities[activity]
    for activity, share in unexplained.items():
        if activity != Activity.BINDINGS:  # what no line shows is the calls themselves
            yield _remedy(loop, RemedyKind.ACTIVITY, activity, None, _ADVICE[activity], share)


def questions_of_lines(loops: Sequence[LoopTime], findings: Sequence[Finding]) -> list[Question]:
    lines = [line for loop in loops for line in loop.lines if _avoidable(line) >= LEAST_GAIN]
    return [
        Question(remedy.trial)
        for line in lines
        for remedy, _ in _line_remedies(line.place, _findings_at(line.place, findings))
        if remedy.trial is not None
    ]


def _findings_at(place: Place, findings: Sequence[Finding]) -> list[Finding]:
    return [
        each
        for each in findings
        if (each.file, each.line) == place.position and each.ns_per_step is not None
    ]


def _of_activity(loop: LoopTime, activity: Activity) -> Remedy:
    """Return what to do about an activity as a whole, at the line where most of it is."""
    lines = [line for line in loop.lines if activity in line.activities]
    most = max(lines, key=lambda line: line.activities[activity], default=None)
    is_collection = activity == Activity.COLLECTION
    kind = RemedyKind.COLLECTION if is_collection else RemedyKind.ACTIVITY
    place = most.place if most else None
    return _remedy(loop, kind, activity, place, _ADVICE[activity], loop.activities[activity])


def _of_building(loop: LoopTime) -> Remedy | None:
    """Return what to do where samples show more of models that are built than calls that load."""
    line = loop.building
    if line is None or loop.samples < FEW_SAMPLES:
        return None
    loading = [call for call in loop.calls if call.activity == Activity.LOADING]
    is_call = any(call.place.position == line.place.position for call in loading)
    if is_call and line.activities.get(Activity.BUILDING, 0.0) < LEAST_GAIN:
        return None
    kind, activity = RemedyKind.ACTIVITY, Activity.BUILDING
    return _remedy(loop, kind, activity, line.place, _BUILDING_ADVICE, line.share)


def _functions(loop: LoopTime) -> Iterator[list[LineTime]]:
    by_function: dict[tuple[str, str], list[LineTime]] = defaultdict(list)
    for line in loop.lines:
        by_function[line.place.file, line.place.function].append(line)
    for lines in by_function.values():
        yield sorted(lines, key=_avoidable, reverse=True)


def _is_spread(loop: LoopTime, lines: Sequence[LineTime]) -> bool:
    """Return whether no line stands out; the lines of the loop itself are always named."""
    is_loop = any(loop.loop.holds(line.place.position) for line in lines)
    return not is_loop and _avoidable(lines[0]) < sum(map(_avoidable, lines)) / 2


def _avoidable(line: LineTime) -> float:
    return sum(share for activity, share in line.activities.items() if activity in _OF_LINES)


def _main_cost(lines: Sequence[LineTime]) -> Activity:
    parts = (part for line in lines for part in line.activities.items() if part[0] in _OF_LINES)
    return next(iter(shares_of(parts, 1.0)), Activity.PYTHON)


def _of_line(
    loop: LoopTime, line: LineTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    """Yield what to do about a line: what lint says of it, and about what that leaves."""
    activity, share = _main_cost([line]), _avoidable(line)
    of_line = [call for call in loop.calls if call.place.position == line.place.position]
    is_one_call = bool(of_line) and _ONE_CALL.match(line.place.text)
    has_remedy = any(call.is_callback or call.activity in _WITH_THEIR_LINE for call in of_line)
    if is_one_call or has_remedy:
        return  # what samples saw beside the call makes it, or frees its result
    for line_remedy, matching in _line_remedies(line.place, findings):
        known = _gain_of_line(loop, line, line_remedy, len(matching), share, measured)
        if known is None:
            continue
        gain, basis, error = known
        text = matching[0].message if matching else line_remedy.text
        remedy = _remedy(loop, RemedyKind.LINE, activity, line.place, text, gain)
        yield replace(
            remedy,
            gain_error=remedy.gain_error if error is None else error,
            code=line_remedy.code,
            effect=line_remedy.effect,
            basis=basis,
            share=share,
        )
        share -= gain
    text = _ADVICE[activity]
    if line.package and line.package not in (STANDARD_LIBRARY, "numpy"):
        text = f"time in {line.package}"
        if Activity.PHYSICS in line.activities:
            text = f"{text} beside physics; `mjbench env` takes an environment apart"
    elif activity == Activity.BINDINGS and not _READS_VIEWS.search(line.place.text):
        text = "the calls of the engine themselves: make fewer of them, each for more"
    yield _remedy(loop, RemedyKind.LINE, activity, line.place, text, share)


def _line_remedies(
    place: Place, findings: Sequence[Finding]
) -> Iterator[tuple[LineRemedy, Sequence[Finding]]]:
    codes = set[str]()
    for remedy in LINE_REMEDIES:
        matching = [each for each in findings if each.code == remedy.code]
        applies = bool(matching) if remedy.code else not codes
        if applies and remedy.code not in codes and remedy.line.search(place.text):
            codes.add(remedy.code)
            yield remedy, matching


def _gain_of_line(
    loop: LoopTime,
    line: LineTime,
    remedy: LineRemedy,
    count: int,
    share: float,
    measured: MeasuredRatios,
) -> tuple[float, Basis, float | None] | None:
    """Return what a line saves, and its error: that of its findings in each step, or its share.

    Where a loop within a step runs the line, only its samples say how often it runs. They say
    nothing of an array that is a part of what the line computes: None.
    """
    text = line.place.text
    only_creates = " @ " not in text and set(_CALLED.findall(text)) <= _CREATE
    is_part = remedy.code == NEW_ARRAY and not only_creates
    ratio = None if remedy.trial is None else measured.ratios.get(Question(remedy.trial))
    nstep = sum(call.calls for call in call_remedies.steps_of(loop))
    if ratio is None:
        return None if is_part else (share, Basis.BOUND, None)
    is_within = loop_within_step(line.place.position, loop.lines_to_step) is not None
    if not count or not nstep or is_within:
        gain = share * ratio.saved
        return None if is_part else (gain, Basis.PAIRED, gain * ratio.relative_error)
    gain = min(share, count * ratio.certainly_saved_s * nstep / loop.seconds)
    return gain, Basis.PAIRED, gain * ratio.relative_error


def _of_function(loop: LoopTime, lines: Sequence[LineTime]) -> Remedy:
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
