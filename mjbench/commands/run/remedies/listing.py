"""What to do about a loop, the most important first: what would make it faster, and by how much.

What is known of calls that were timed counts. Other lines are known from samples, and their share
is an upper bound.
"""

import contextlib
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

from mjbench.commands.lint import check as lint
from mjbench.commands.lint.check import Finding
from mjbench.commands.lint.restarts import SETTLED_RESET
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime, Incident
from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.loop_parts import ONE_CALL
from mjbench.commands.run.loop_time import FEW_SAMPLES, LEAST_REPEATS, LineTime, LoopTime, shares_of
from mjbench.commands.run.remedies import line_remedies, loop_remedies
from mjbench.commands.run.remedies.call_remedies import CALL_REMEDIES
from mjbench.commands.run.remedies.call_savings import CallRemedy, CallsInLoop, count_of, seconds_of
from mjbench.commands.run.remedies.loop_remedies import of_samples
from mjbench.commands.run.remedies.remedy import LEAST_GAIN, Remedy, RemedyKind
from mjbench.commands.run.remedies.remedy_pairs import MeasuredRatios, RemedyPair
from mjbench.commands.run.thread_pools import ThreadPools
from mjbench.errors import InputError

# Activities that samples tell by the text of a line.
_OF_LINES = {Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY}
# Rules whose findings are about calls that are timed, or about simulations in turn.
_BY_CALLS = {"MJB006"}.union(*(remedy.codes for remedy in CALL_REMEDIES))
# Of calls whose line does little else.
_WITH_THEIR_LINE = (Activity.COPYING, Activity.STARTING)


def findings_of(files: Sequence[str]) -> list[Finding]:
    """Return lint's findings in files; those that cannot be checked have none."""
    findings: list[Finding] = []
    for file in files:
        with contextlib.suppress(InputError):
            findings += lint.check(file)
    return findings


def pairs(
    loops: Sequence[LoopTime], findings: Sequence[Finding], incidents: Sequence[Incident] = ()
) -> list[RemedyPair]:
    """Return what to measure on the program's model: only what could be worth a line."""
    asked = [*loop_remedies.step_pairs(loops, incidents)]
    for loop in loops:
        asked += [
            remedy.pair(calls)
            for remedy, calls in _calls(loop, findings)
            if remedy.pair is not None and calls.share >= LEAST_GAIN
        ]
        asked += [
            remedy.pair
            for line in loop.lines
            if _avoidable(line) >= LEAST_GAIN
            for remedy, _ in line_remedies.line_remedies(line.place, findings)
        ]
        asked += [
            pair
            for code, pair in line_remedies.LOOP_PAIRS.items()
            if _lines_of(loop.lines_on_stack, _of_whole(code, findings))
        ]
    return list(dict.fromkeys(asked))


def remedies(
    loop: LoopTime,
    findings: Sequence[Finding] = (),
    measured: MeasuredRatios | None = None,
    incidents: Sequence[Incident] = (),
    others_busy_s: float = 0.0,
    pools: ThreadPools | None = None,
    timestep_s: float | None = None,
) -> list[Remedy]:
    """Return what to do about a loop, by gain.

    Args:
      others_busy_s: seconds for which another process or thread steps meanwhile: no other way of
        waiting for it saves them.
    """
    measured = measured or MeasuredRatios({})
    recompilations = list(loop_remedies.of_recompilations(loop, incidents))
    explained = {(Activity.COMPILING, each.place) for each in recompilations}
    savings = _savings(loop, findings, measured, others_busy_s)
    listed = [
        *recompilations,
        *(each for each in savings if (each.activity, each.place) not in explained),
        *loop_remedies.of_turns(loop, measured, incidents),
        *loop_remedies.of_pools(loop, pools),
        *loop_remedies.of_chunks(loop),
        *loop_remedies.of_frames(loop, timestep_s),
    ]
    worthwhile = [each for each in listed if each.gain is not None and each.gain >= LEAST_GAIN]
    return sorted(worthwhile, key=lambda remedy: remedy.rank)


def first(listed: Sequence[Remedy]) -> Remedy | None:
    """Return the most important remedy that is more than chance."""
    return next((each for each in listed if each.is_certain), None)


def _savings(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios, others_busy_s: float
) -> Iterator[Remedy]:
    of_calls = list(_of_calls(loop, findings, measured))
    if (building := loop_remedies.of_building(loop)) is not None:
        # a model that is built is compiled, too, and has an MjData of its own
        of_model = {Activity.LOADING, Activity.COPYING}
        of_calls = [remedy for remedy in of_calls if remedy.activity not in of_model]
        yield building
    yield from of_calls
    yield from loop_remedies.of_timer(loop, measured)
    yield from loop_remedies.of_collection(loop)
    if loop.samples < FEW_SAMPLES:
        return
    if not any(remedy.activity == Activity.STARTING for remedy in of_calls):
        # otherwise the loop also waits for processes to begin
        yield from loop_remedies.of_messages(loop, others_busy_s)
    yield from _of_lines(loop, findings, measured)


# -- calls that were timed -------------------------------------------------------------------------


def _calls(loop: LoopTime, findings: Sequence[Finding]) -> Iterator[tuple[CallRemedy, CallsInLoop]]:
    """Yield the remedies that apply, each with its calls from one line; the first row counts."""
    said = set[tuple[Sequence[str], Place]]()
    for remedy in CALL_REMEDIES:
        by_place: dict[Place, list[CallTime]] = defaultdict(list)
        for call in loop.calls:
            if call.callee in remedy.callees:
                by_place[call.place].append(call)
        if remedy.needs_finding:
            by_place = {
                place: calls
                for place, calls in by_place.items()
                if _finding_of(remedy, place, loop, findings) is not None
            }
        if remedy.is_of_loop and by_place:
            place = max(by_place, key=lambda each: seconds_of(by_place[each]))
            by_place = {place: [call for calls in by_place.values() for call in calls]}
            created = [call for call in loop.calls if call.callee == "MjData"]
            if by_place[place][0].activity == Activity.LOADING and created:
                # an MjData of each new model is created once, too
                by_place[place] += created if _are_of_new_models(loop, created) else []
        for place, calls in by_place.items():
            is_said = (remedy.callees, place) in said
            if is_said or _are_of_new_models(loop, calls) or not remedy.applies(calls, loop.calls):
                continue
            finding = _finding_of(remedy, place, loop, findings)
            if finding is not None:
                said.update((remedy.callees, call.place) for call in calls)
                place_of_finding = Place(finding.file, finding.line, "")
                yield remedy, CallsInLoop(calls, loop, place_of_finding, finding)
            elif count_of(calls) >= LEAST_REPEATS:
                yield remedy, CallsInLoop(calls, loop, place)


def _are_of_new_models(loop: LoopTime, calls: Sequence[CallTime]) -> bool:
    """Return whether all create an MjData, of models that the loop loads about as often."""
    loaded = sum(call.calls for call in loop.calls if call.activity == Activity.LOADING)
    created = sum(call.calls for call in loop.calls if call.callee == "MjData")
    is_of_each_model = loaded >= LEAST_REPEATS and 2 * loaded >= created
    return is_of_each_model and all(call.callee == "MjData" for call in calls)


def _finding_of(
    remedy: CallRemedy, place: Place, loop: LoopTime, findings: Sequence[Finding]
) -> Finding | None:
    for finding in findings:
        if finding.code not in remedy.codes or finding.file != place.file:
            continue
        in_loop = loop.loop.first <= finding.line <= loop.loop.last
        if finding.line == place.line or (call_clock.COMPILE in remedy.callees and in_loop):
            return finding
    return None


def _of_calls(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    for remedy, calls in _calls(loop, findings):
        saving, finding = remedy.saved(calls, measured), calls.finding
        if saving is None:
            continue
        error = saving.relative_error
        text = remedy.text if finding is None else finding.message
        yield Remedy(
            RemedyKind.CALL,
            calls.calls[0].activity,
            calls.place,
            text.replace("{count}", f"{round(calls.count):,}"),
            saving.gain,
            None if error is None else saving.gain * error,
            "" if finding is None else finding.code,
            basis=saving.basis,
            share=saving.share,
            effect=remedy.effect,
        )


# -- lines that samples show -----------------------------------------------------------------------


def _of_lines(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    """Yield what to do about each line that has a remedy of its own, and each that lint finds."""
    yield from _of_findings(loop, findings)
    yield from _of_whole_loops(loop, findings, measured)
    joined: list[Remedy] = []
    for line in sorted(loop.lines, key=lambda line: line.place.position):
        if _avoidable(line) >= LEAST_GAIN and not _is_of_calls(loop, line):
            for each in _of_line(loop, line, findings, measured):
                i = next((i for i, one in enumerate(joined) if _continues(one, each)), None)
                if i is None:
                    joined.append(each)
                else:
                    joined[i] = _joined(joined[i], each)
    yield from joined


def _continues(first: Remedy, then: Remedy) -> bool:
    """Return whether two remedies are one, on lines of a function that follow each other."""
    before, after = first.place, then.place
    assert before is not None and after is not None, "lines have remedies here"
    last = first.last_line or before.line
    is_next = last < after.line <= last + 1 and before.file == after.file
    return is_next and (first.text, first.basis) == (then.text, then.basis)


def _joined(first: Remedy, then: Remedy) -> Remedy:
    assert then.place is not None and first.gain is not None and then.gain is not None
    return replace(
        first,
        gain=first.gain + then.gain,
        gain_error=math.hypot(first.gain_error or 0.0, then.gain_error or 0.0),
        share=(first.share or 0.0) + (then.share or 0.0),
        last_line=then.place.line,
    )


def _of_findings(loop: LoopTime, findings: Sequence[Finding]) -> Iterator[Remedy]:
    """Yield what lint says of lines whose remedy no row of a table knows, with their share."""
    by_line = {(each.file, each.line, each.code): each for each in reversed(findings)}
    for finding in reversed(by_line.values()):
        lines = _lines_of(loop.lines, [finding])
        has_row = finding.code in line_remedies.LOOP_PAIRS or line_remedies.has_row(finding, lines)
        if not lines or finding.is_wrong_result or finding.code in _BY_CALLS or has_row:
            continue
        # a step on the line of a finding about one line stays, but where it is about the step
        is_whole = finding.last_line or finding.code == SETTLED_RESET
        left = None if is_whole else Activity.PHYSICS
        parts = [part for line in lines for part in line.activities.items() if part[0] != left]
        shares = shares_of(parts, 1.0)
        share = min(1.0, sum(shares.values()))
        if share:
            place = Place(finding.file, finding.line, lines[0].place.function)
            remedy = of_samples(
                loop, next(iter(shares)), place, finding.message, share, RemedyKind.LINE
            )
            yield replace(remedy, code=finding.code, share=share, last_line=finding.last_line)


def _of_whole_loops(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    """Yield what to do about loops that one call replaces, which are one thing to do."""
    for code, pair in line_remedies.LOOP_PAIRS.items():
        of_code = _of_whole(code, findings)
        if not (lines := _lines_of(loop.lines_on_stack, of_code)):
            continue
        first = min(lines, key=lambda line: line.place.position).place
        of_file = [each for each in of_code if each.file == first.file]
        saving = line_remedies.saved_with_steps(lines, measured.ratios.get(pair), loop.samples)
        error = saving.relative_error
        begin, end = of_file[0].line, max(each.last_line or each.line for each in of_file)
        yield Remedy(
            RemedyKind.LINE,
            Activity.PHYSICS,
            Place(first.file, begin, first.function),
            of_file[0].message,
            saving.gain,
            None if error is None else saving.gain * error,
            code,
            basis=saving.basis,
            share=saving.share,
            effect="nothing but rounding",
            last_line=end if end > begin else None,
        )


def _of_whole(code: str, findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings that one call replaces their loop."""
    of_code = (each for each in findings if each.code == code and each.instead)
    return sorted(of_code, key=lambda each: each.line)


def _lines_of(lines: Sequence[LineTime], findings: Sequence[Finding]) -> list[LineTime]:
    return [
        line
        for line in lines
        if any(
            each.file == line.place.file
            and each.line <= line.place.line <= (each.last_line or each.line)
            for each in findings
        )
    ]


def _avoidable(line: LineTime) -> float:
    return sum(share for activity, share in line.activities.items() if activity in _OF_LINES)


def _is_of_calls(loop: LoopTime, line: LineTime) -> bool:
    """Return whether what samples saw beside a timed call makes it, or frees its result."""
    of_line = [call for call in loop.calls if call.place.position == line.place.position]
    is_one_call = bool(of_line) and ONE_CALL.match(line.place.text) is not None
    return is_one_call or any(
        call.is_callback or call.activity in _WITH_THEIR_LINE for call in of_line
    )


def _of_line(
    loop: LoopTime, line: LineTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    share = _avoidable(line)
    parts = (part for part in line.activities.items() if part[0] in _OF_LINES)
    activity = next(iter(shares_of(parts, 1.0)))
    for row, matching in line_remedies.line_remedies(line.place, findings):
        saving = line_remedies.saved(loop, line, row, len(matching), share, measured)
        if saving is None:
            continue
        gain, error = saving.gain, saving.relative_error
        yield replace(
            of_samples(loop, activity, line.place, matching[0].message, gain, RemedyKind.LINE),
            gain_error=loop.error(gain) if error is None else gain * error,
            code=row.code,
            effect="nothing",
            basis=saving.basis,
            share=share,
        )
        share -= gain
