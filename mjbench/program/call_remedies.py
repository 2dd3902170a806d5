"""What to do about calls of MuJoCo and JAX in a loop, and what that saves.

`remedy_table` declares the remedies. What a call takes was timed in this very program. What mjbench
suggests in its place is timed on the program's own model (`replacements`). Where a call moves out
of the loop, its time is the gain.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.host import machine
from mjbench.loop.lint import Finding
from mjbench.program.activities import Activity, Place
from mjbench.program.calls import CallTime, Incident
from mjbench.program.hook import call_clock
from mjbench.program.loop_time import FEW_SAMPLES, LEAST_REPEATS, LoopTime
from mjbench.program.remedy import LEAST_GAIN, Basis, Remedy, RemedyKind
from mjbench.program.remedy_table import CALL_REMEDIES, CallRemedy, count_of
from mjbench.program.replacements import MeasuredRatios, TimeRatio
from mjbench.program.source_loops import loop_within_step
from mjbench.program.trials import ROLLOUTS, Question, Trial
from mjbench.simulation import package_timer

# The most that a pair stands for; steps after a new MjData that tell what its memory costs them.
_MOST_GAIN, _MOST_STEPS = 0.99, 50
# Rays of a pair where nothing steps between them, and at most.
_USUAL_RAYS, _MOST_RAYS = 32, 1000

# Trials of what takes the place of a call. Where they could not be made, its time is a bound; an
# unknown part of other calls stays.
_OF_REPLACED_CALLS = (Trial.FUNCTIONS, Trial.NEW_DATA_OR_COPY, Trial.RENDERER)
# What Python does to make a call, on its own line.
_BESIDE_CALLS = (Activity.BINDINGS, Activity.PYTHON)
_CLOCK_ADVICE = f"turn off {package_timer.NAME}: {package_timer.OFF_CODE}, after creating MjData"
_BEFORE_CALLBACKS = " and before setting callbacks of your own, which it removes"
_TRIALS_OF_COPIES = {
    call_clock.COPY_OF_DATA: Trial.COPY_OR_COPY,
    call_clock.DEEP_COPY_OF_DATA: Trial.DEEP_COPY_OR_COPY,
}


def questions(
    loops: Sequence[LoopTime], findings: Sequence[Finding], incidents: Sequence[Incident] = ()
) -> list[Question]:
    """Return what to measure on the program's model: only what could be worth a line."""
    asked = [_batch(incident) for incident in incidents if incident.name == call_clock.IN_TURN]
    for loop in loops:
        if _steps_s(loop) > LEAST_GAIN * loop.seconds:
            asked.append(_no_timer(loop))
        asked += [
            _question(context)
            for context in _contexts(loop, findings)
            if context.remedy.trial is not None and _share(loop, context.calls) >= LEAST_GAIN
        ]
    return list(dict.fromkeys(asked))


@dataclass(frozen=True)
class _Context:
    remedy: CallRemedy
    calls: Sequence[CallTime]
    place: Place
    finding: Finding | None
    nstep: float


def _contexts(loop: LoopTime, findings: Sequence[Finding]) -> Iterator[_Context]:
    for remedy in CALL_REMEDIES:
        by_place: dict[Place, list[CallTime]] = defaultdict(list)
        for call in loop.calls:
            if call.callee in remedy.callees:
                by_place[call.place].append(call)
        if remedy.is_of_loop and by_place:
            place = max(by_place, key=lambda each: sum(call.seconds for call in by_place[each]))
            by_place = {place: [call for calls in by_place.values() for call in calls]}
        for place, calls in by_place.items():
            if _are_of_new_models(loop, calls) or not remedy.applies(calls, loop.calls):
                continue
            finding = _finding_of(remedy, place, loop, findings)
            repeats = count_of(calls) >= LEAST_REPEATS
            if finding is not None or (repeats and not remedy.needs_finding):
                at = place if finding is None else Place(finding.file, finding.line, "")
                nstep = sum(call.all_steps for call in steps_of(loop))
                yield _Context(remedy, calls, at, finding, nstep)


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


@dataclass(frozen=True)
class _Saving:
    """Shares of the loop's time; the error is over the gain, and None where it was not measured."""

    gain: float
    share: float
    basis: Basis
    relative_error: float | None = None


def of_calls(
    loop: LoopTime, findings: Sequence[Finding], measured: MeasuredRatios
) -> Iterator[Remedy]:
    for context in _contexts(loop, findings):
        remedy, calls, finding = context.remedy, context.calls, context.finding
        saving = _saving(loop, context, measured)
        if saving is None:
            continue
        count, gain = count_of(calls), saving.gain
        if remedy.overlaps:
            waits = [call for call in loop.calls if call.callee in remedy.callees]
            gain = min(gain, 1 - _share(loop, waits))
        if remedy.keeps_first and count > 1:
            gain *= 1 - 1 / count
        text = finding.message if finding is not None else remedy.text
        yield Remedy(
            RemedyKind.CALL,
            calls[0].activity,
            context.place,
            text.replace("{count}", f"{round(count):,}"),
            gain,
            None if saving.relative_error is None else gain * saving.relative_error,
            finding.code if finding is not None else "",
            basis=saving.basis,
            share=saving.share,
            effect=remedy.effect,
        )


def _saving(loop: LoopTime, context: _Context, measured: MeasuredRatios) -> _Saving | None:
    remedy, share = context.remedy, _share(loop, context.calls)
    if remedy.trial is None:
        if remedy.is_of_line:
            lines = [line for line in loop.lines if line.place.position == context.place.position]
            share = max([share, *(line.share for line in lines)])
        return _Saving(share, share, Basis.BOUND if remedy.is_bound else Basis.TIMED)
    question = _question(context)
    ratio = measured.ratios.get(question)
    if ratio is None:
        if remedy.trial not in _OF_REPLACED_CALLS:
            return None
        is_deleted = remedy.trial == Trial.FUNCTIONS and not question.functions
        return _Saving(share, share, Basis.TIMED if is_deleted else Basis.BOUND)
    if remedy.trial == Trial.RAYS:
        return _saving_of_rays(loop, context, ratio)
    if remedy.trial == Trial.ONE_CALL:  # the pair includes what Python does around each call
        share = min(1.0, share + loop.activities.get(Activity.BINDINGS, 0.0))
    gain = _gain_of_pair(loop, context, ratio, share)
    return _Saving(gain, share, Basis.PAIRED, ratio.relative_error)


def _gain_of_pair(loop: LoopTime, context: _Context, ratio: TimeRatio, share: float) -> float:
    calls, trial = context.calls, context.remedy.trial
    if trial in (Trial.FUNCTIONS, Trial.INVERSE):
        return _gain_of_functions(loop, calls, ratio)
    if trial in _OF_REPLACED_CALLS:
        return _gain_of_objects(loop, context, ratio)
    return ratio.saved * (share if trial == Trial.ONE_CALL else _share_with_python(loop, calls))


def _question(context: _Context) -> Question:
    remedy, finding, calls = context.remedy, context.finding, context.calls
    assert remedy.trial is not None, "only calls that are replaced have a question"
    if remedy.trial == Trial.FUNCTIONS:
        functions = () if finding is None else tuple(finding.instead)
        return Question(remedy.trial, functions, steps=int(context.nstep > 0))
    if remedy.trial in (Trial.ONE_CALL, Trial.INVERSE, Trial.UNCENTERED):
        return Question(remedy.trial)
    if remedy.trial in ROLLOUTS:
        steps = max(1.0, sum(call.steps for call in calls))
        simulations = sum(call.all_steps for call in calls) / steps
        steps_of_call = steps / max(1.0, count_of(calls))
        return Question(
            remedy.trial, simulations=max(1, round(simulations)), steps=max(1, round(steps_of_call))
        )
    if remedy.trial == Trial.RAYS:
        of_step = count_of(calls) / context.nstep if context.nstep else _USUAL_RAYS
        return Question(remedy.trial, simulations=min(_MOST_RAYS, max(1, round(of_step))))
    if remedy.trial == Trial.RENDERER:
        frame = next((call.frame for call in calls if call.frame), None)
        backend = calls[0].backend
        return Question(remedy.trial, frame=frame or (240, 320), backend=backend)
    after_each = round(context.nstep / max(1.0, count_of(calls)))
    after_each = min(_MOST_STEPS, after_each)
    if finding is not None and finding.code == "MJB005":
        return Question(Trial.NEW_DATA_OR_RESET, steps=after_each)
    trial = _TRIALS_OF_COPIES.get(max(calls, key=lambda call: call.seconds).callee, remedy.trial)
    return Question(trial, steps=after_each)


def _gain_of_objects(loop: LoopTime, context: _Context, ratio: TimeRatio) -> float:
    """Return what it saves to create an object once.

    The pair that was measured holds more than the call: what is done with the new object, whose
    memory is used for the first time, and the time in which it is freed. In the program, that is
    all that samples do not see on other lines, but for the steps that the pair leaves out.
    """
    question = _question(context)
    is_frame = question.trial == Trial.RENDERER
    beside = [
        call
        for call in loop.calls
        if (call.activity == Activity.RENDERING if is_frame else call.is_step)
    ]
    stands_for = _stands_for(loop, [*context.calls, *beside])
    if loop.samples < FEW_SAMPLES:
        return min(stands_for, ratio.saved * _share(loop, context.calls) / ratio.created_share)
    created = count_of(context.calls)
    left_out = 0.0 if is_frame else 1 - min(1.0, question.steps * created / max(1.0, context.nstep))
    of_steps = stands_for - _share(loop, context.calls)  # with what Python does to call them
    return ratio.saved * (stands_for - left_out * of_steps)


def _stands_for(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    """Return the share of a loop that calls stand for: all that is not seen on other lines."""
    if not calls:
        return 0.0
    own = {call.place.position for call in calls}
    timed = _share(loop, calls)
    elsewhere = sum(
        part
        for line in loop.lines
        for activity, part in line.activities.items()
        if not loop.is_timed(activity)
        and not (activity in _BESIDE_CALLS and line.place.position in own)
    )
    elsewhere += loop.activities.get(Activity.COLLECTION, 0.0)
    others = [call for call in loop.calls if call.place.position not in own]
    return min(_MOST_GAIN, max(timed, 1 - elsewhere - _share(loop, others)))


def _gain_of_functions(loop: LoopTime, calls: Sequence[CallTime], ratio: TimeRatio) -> float:
    """Return what other functions save; the pair has a step with the call, and with the others."""
    nstep = sum(call.all_steps for call in steps_of(loop))
    calls_s, steps_s = sum(call.seconds for call in calls), _steps_s(loop)
    pair_s = calls_s + count_of(calls) * (steps_s / nstep if nstep else 0.0)
    both = _share_with_python(loop, [*calls, *steps_of(loop)])
    return ratio.saved * both * pair_s / (calls_s + steps_s)


def _saving_of_rays(loop: LoopTime, context: _Context, ratio: TimeRatio) -> _Saving:
    """Return what one call saves in place of a loop of calls: all that this loop does goes, too.

    How much that is, few samples do not tell: then half of what they do not see, give or take half.
    """
    position = context.place.position
    inner = loop_within_step(position, loop.lines_to_step)
    shares = {line.place.position: line.share for line in loop.lines}
    of_calls = max(_share(loop, context.calls), shares.pop(position, 0.0))
    others = sum(share for each, share in shares.items() if inner is not None and inner.holds(each))
    share = of_calls + others
    if not ratio.saved:
        return _Saving(0.0, share, Basis.PAIRED)
    gain = of_calls * ratio.saved + others
    error = of_calls * ratio.saved * ratio.relative_error
    if loop.samples < FEW_SAMPLES and inner is not None:
        unseen = max(0.0, 1 - _share(loop, loop.calls) - others)
        gain, error = gain + unseen / 2, math.hypot(error, unseen / 4)
    return _Saving(gain, share, Basis.PAIRED, error / gain if gain else 0.0)


def _share_with_python(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    """Return the share of calls with what Python does to make them, as pairs have it, too."""
    return _share(loop, calls) if loop.samples < FEW_SAMPLES else _stands_for(loop, calls)


def _no_timer(loop: LoopTime) -> Question:
    steps = steps_of(loop)
    nstep = sum(call.all_steps for call in steps) / max(1.0, count_of(steps))
    return Question(Trial.NO_TIMER, steps=max(1, round(nstep)))


def of_steps(loop: LoopTime, measured: MeasuredRatios) -> Iterator[Remedy]:
    has_callbacks = any(call.is_callback for call in loop.calls)
    share = _share_with_python(loop, steps_of(loop))
    ratio = measured.ratios.get(_no_timer(loop)) if share else None
    gain = loop.engine_clock if ratio is None else ratio.saved * share
    if gain >= package_timer.MIN_GAIN:
        yield Remedy(
            RemedyKind.CLOCK,
            Activity.PHYSICS,
            None,
            _CLOCK_ADVICE + (_BEFORE_CALLBACKS if has_callbacks else ""),
            gain,
            loop.error(gain) if ratio is None else gain * ratio.relative_error,
            basis=Basis.BOUND if ratio is None else Basis.PAIRED,
            share=share,
            effect="nothing but mjData.timer, which stays empty",
        )


def of_turns(
    loop: LoopTime, measured: MeasuredRatios, incidents: Sequence[Incident]
) -> Iterator[Remedy]:
    for incident in incidents:
        calls = [call for call in steps_of(loop) if call.place.position == incident.place.position]
        if incident.name != call_clock.IN_TURN or not calls:
            continue
        share, ratio = _share(loop, calls), measured.ratios.get(_batch(incident))
        saved = 1 - 1 / machine.usable_cores() if ratio is None else ratio.saved
        yield Remedy(
            RemedyKind.CALL,
            Activity.PHYSICS,
            incident.place,
            f"{incident.count} simulations are stepped in turn: mujoco.batch.Batch steps them at"
            " once, on all cores (mujoco.rollout in releases without it)",
            share * saved,
            None if ratio is None else share * saved * ratio.relative_error,
            basis=Basis.BOUND if ratio is None else Basis.PAIRED,
            share=share,
            effect="nothing",
        )


def _batch(incident: Incident) -> Question:
    return Question(Trial.BATCH, simulations=max(2, incident.count))


def steps_of(loop: LoopTime) -> list[CallTime]:
    return [call for call in loop.calls if call.callee == "mj_step"]


def _steps_s(loop: LoopTime) -> float:
    return sum(call.seconds for call in steps_of(loop))


def _share(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    return min(1.0, sum(call.seconds for call in calls) / loop.seconds)
