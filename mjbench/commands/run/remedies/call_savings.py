"""What it saves to replace calls in a loop, or to move them out of it.

What a call takes was timed in this very program. What mjbench suggests in its place is timed on the
program's own model (`remedy_pairs`). Where a call moves out of the loop, its time is the gain.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mjbench.commands.lint.check import Finding
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.loop_time import FEW_SAMPLES, LoopTime
from mjbench.commands.run.remedies.remedy import Basis
from mjbench.commands.run.remedies.remedy_pairs import MeasuredRatios, RemedyPair, TimeRatio
from mjbench.commands.run.source_loops import loop_within_step

# The most that a pair stands for.
_MOST_GAIN = 0.99
# What Python does to make a call, on its own line.
_BESIDE_CALLS = (Activity.BINDINGS, Activity.PYTHON)


@dataclass(frozen=True)
class Saving:
    """Shares of the loop's time; the error is over the gain, and None where it was not measured."""

    gain: float
    share: float
    basis: Basis
    relative_error: float | None = None


@dataclass(frozen=True)
class CallsInLoop:
    """Calls of a loop that a remedy is about, from one line; `finding` is what lint says of it."""

    calls: Sequence[CallTime]
    loop: LoopTime
    place: Place
    finding: Finding | None = None

    @property
    def count(self) -> float:
        return count_of(self.calls)

    @property
    def share(self) -> float:
        return share_of(self.loop, self.calls)

    @property
    def share_of_lines(self) -> float:
        """The share of their lines, with what else these do."""
        positions = {call.place.position for call in self.calls}
        lines = (line for line in self.loop.lines if line.place.position in positions)
        return sum(line.share for line in lines)

    @property
    def nstep(self) -> float:
        """Steps in the loop, of all simulations."""
        return sum(call.all_steps for call in steps_of(self.loop.calls))


def of_share(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what a pair saves of its calls, and of what Python does to make them."""
    gain = ratio.saved * share_with_python(calls.loop, calls.calls)
    return _paired(gain, calls.share, ratio)


@dataclass(frozen=True)
class CallRemedy:
    """What to do about calls of some functions in a loop.

    Attributes:
      text: `{count}` stands for the number of calls.
      pair: what to measure; None where nothing replaces the call.
      saving: what follows from the ratio that was measured.
      codes: of lint's rules for the same; a finding's own message is shown instead of `text`.
      needs_finding: whether only lint's finding shows the context, such as what is read afterwards.
      is_bound: whether less than the share of the calls is saved, which is shown where no pair was
        timed: the same has to be computed elsewhere.
      overlaps: whether the rest of the loop could run meanwhile: no more than that rest is saved.
      is_of_loop: whether it is about all these calls in a loop together.
      is_of_line: whether the rest of the line goes with the call, such as the end of a pool.
      also: activity that goes with the calls, on whatever line.
      applies: whether calls from one line need it, beside the other calls of their loop.
    """

    callees: tuple[str, ...]
    text: str
    effect: str = "nothing"
    pair: Callable[[CallsInLoop], RemedyPair] | None = None
    saving: Callable[[CallsInLoop, RemedyPair, TimeRatio], Saving] = of_share
    codes: tuple[str, ...] = ()
    needs_finding: bool = False
    keeps_first: bool = False
    is_bound: bool = False
    overlaps: bool = False
    is_of_loop: bool = False
    is_of_line: bool = False
    also: Activity | None = None
    applies: Callable[[Sequence[CallTime], Sequence[CallTime]], bool] = lambda calls, of_loop: True

    def saved(self, calls: CallsInLoop, measured: MeasuredRatios) -> Saving | None:
        """Return what it saves; None where only a pair would tell, and none was timed."""
        saving = self._saved_at_most(calls, measured)
        if saving is None:
            return None
        gain = saving.gain
        if self.overlaps:
            waits = [call for call in calls.loop.calls if call.callee in self.callees]
            gain = min(gain, 1 - share_of(calls.loop, waits))
        if self.keeps_first:
            gain *= 1 - 1 / max(1.0, calls.count)
        return replace(saving, gain=gain)

    def _saved_at_most(self, calls: CallsInLoop, measured: MeasuredRatios) -> Saving | None:
        share, basis = calls.share, Basis.BOUND if self.is_bound else Basis.TIMED
        if self.pair is not None:
            pair = self.pair(calls)
            if (ratio := measured.ratios.get(pair)) is not None:
                return self.saving(calls, pair, ratio)
            if not self.is_bound:
                return None
            if pair.functions == ():  # the call is not needed at all
                basis = Basis.TIMED
        if self.is_of_line:
            share = max(share, calls.share_of_lines)
        if self.also is not None:
            share = min(1.0, share + calls.loop.activities.get(self.also, 0.0))
        return Saving(share, share, basis)


def of_call_alone(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what a pair saves that includes what Python does around each call."""
    share = min(1.0, calls.share + calls.loop.activities.get(Activity.BINDINGS, 0.0))
    return _paired(ratio.saved * share, share, ratio)


def of_functions(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what other functions save; the pair has a step with the call, and with the others."""
    loop, nstep = calls.loop, calls.nstep
    calls_s, steps_s = seconds_of(calls.calls), seconds_of(steps_of(loop.calls))
    pair_s = calls_s + calls.count * (steps_s / nstep if nstep else 0.0)
    both = share_with_python(loop, [*calls.calls, *steps_of(loop.calls)])
    per_call = pair_s / (calls_s + steps_s) if calls_s + steps_s else 0.0
    return _paired(ratio.saved * both * per_call, calls.share, ratio)


def of_renderers(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    drawing = [call for call in calls.loop.calls if call.activity == Activity.RENDERING]
    return _of_objects(calls, drawing, 0.0, ratio)


def of_images(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what coarser images save; the pair updates the scene, too."""
    share = share_of(calls.loop, drawing(calls.loop))
    return _paired(ratio.saved * share, share, ratio)


def drawing(loop: LoopTime) -> list[CallTime]:
    """Return the calls that draw images, without those that create a renderer."""
    calls = (call for call in loop.calls if call.activity == Activity.RENDERING)
    return [call for call in calls if call.callee != "Renderer"]


def of_new_data(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what it saves to create an MjData once; the pair leaves out most steps with it."""
    steps = [call for call in calls.loop.calls if call.is_step]
    left_out = 1 - min(1.0, pair.steps * calls.count / max(1.0, calls.nstep))
    return _of_objects(calls, steps, left_out, ratio)


def _of_objects(
    calls: CallsInLoop, users: Sequence[CallTime], left_out: float, ratio: TimeRatio
) -> Saving:
    """Return what it saves to create an object once.

    The pair that was measured holds more than the call: what is done with the new object, whose
    memory is used for the first time, and the time in which it is freed. In the program, that is
    all that samples do not see on other lines, but for the share of `users` that the pair leaves
    out. It is no less than the time that the pair saves each time: some of them may use no such
    object.
    """
    stands_for = _stands_for(calls.loop, [*calls.calls, *users])
    if calls.loop.samples < FEW_SAMPLES:
        gain = min(stands_for, ratio.saved * calls.share / max(1e-9, ratio.created_share))
    else:
        # the line of the call also frees the object; the rest is of users, and calls them
        of_users = max(0.0, stands_for - max(calls.share, calls.share_of_lines))
        least = min(stands_for, calls.count * ratio.certainly_saved_s / calls.loop.seconds)
        gain = max(least, ratio.saved * (stands_for - left_out * of_users))
    return _paired(gain, calls.share, ratio)


def of_rays(calls: CallsInLoop, pair: RemedyPair, ratio: TimeRatio) -> Saving:
    """Return what one call saves in place of a loop of calls: all that this loop does goes, too.

    How much that is, few samples do not tell: then half of what they do not see, give or take half.
    """
    loop, position = calls.loop, calls.place.position
    inner = loop_within_step(position, loop.lines_to_step)
    shares = {line.place.position: line.share for line in loop.lines}
    of_calls = max(calls.share, shares.pop(position, 0.0))
    others = sum(share for each, share in shares.items() if inner is not None and inner.holds(each))
    share = of_calls + others
    if not ratio.saved:
        return _paired(0.0, share, ratio)
    gain = of_calls * ratio.saved + others
    error = of_calls * ratio.saved * ratio.relative_error
    if loop.samples < FEW_SAMPLES and inner is not None:
        unseen = max(0.0, 1 - share_of(loop, loop.calls) - others)
        gain, error = gain + unseen / 2, math.hypot(error, unseen / 4)
    return Saving(gain, share, Basis.PAIRED, error / gain if gain else 0.0)


def _paired(gain: float, share: float, ratio: TimeRatio) -> Saving:
    return Saving(gain, share, Basis.PAIRED, ratio.relative_error)


def share_with_python(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    """Return the share of calls with what Python does to make them, as pairs have it, too."""
    return share_of(loop, calls) if loop.samples < FEW_SAMPLES else _stands_for(loop, calls)


def _stands_for(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    """Return the share of a loop that calls stand for: all that is not seen on other lines."""
    if not calls:
        return 0.0
    own = {call.place.position for call in calls}
    elsewhere = sum(
        part
        for line in loop.lines
        for activity, part in line.activities.items()
        if not loop.is_timed(activity)
        and not (activity in _BESIDE_CALLS and line.place.position in own)
    )
    elsewhere += loop.activities.get(Activity.COLLECTION, 0.0)
    others = [call for call in loop.calls if call.place.position not in own]
    return min(_MOST_GAIN, max(share_of(loop, calls), 1 - elsewhere - share_of(loop, others)))


def steps_of(calls: Sequence[CallTime]) -> list[CallTime]:
    return [call for call in calls if call.callee == "mj_step"]


def count_of(calls: Sequence[CallTime]) -> float:
    return sum(call.calls for call in calls)


def seconds_of(calls: Sequence[CallTime]) -> float:
    return sum(call.seconds for call in calls)


def share_of(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    return min(1.0, seconds_of(calls) / loop.seconds)
