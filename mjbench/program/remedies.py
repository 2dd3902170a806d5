"""What to do first: what would make a program faster, and by how much.

A remedy belongs to a call in a context, such as an MjData that is created in a loop.
`CALL_REMEDIES` declares them. What a call takes was timed in this very program, and what mjbench
suggests in its place is timed on the program's own model (`replacements`). Where a call moves out
of the loop, its time is the gain. Other lines are known from samples, and their share is an upper
bound.
"""

import enum
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.errors import InputError
from mjbench.instrument import machine
from mjbench.loop import lint
from mjbench.loop.lint import Finding
from mjbench.loop.lint_rules import NAMED_ACCESS
from mjbench.program.activities import STANDARD_LIBRARY, Activity, Place
from mjbench.program.attribution import FEW_SAMPLES, LineTime, LoopTime
from mjbench.program.calls import CallTime, Incident, ProgramCalls
from mjbench.program.hook import call_clock
from mjbench.program.replacements import Measured, Question, Trial
from mjbench.program.source_loops import lines_reading, loop_is_one_call
from mjbench.program.step_times import StepTimes
from mjbench.simulation import package_timer

# Smaller gains are not worth a line.
LEAST_GAIN = 0.03
# The most that a pair stands for; steps after a new MjData that tell what its memory costs them.
_MOST_GAIN, _MOST_STEPS = 0.99, 50
# Pairs that hold steps.
_WITH_STEPS = (Trial.NEW_DATA_OR_COPY, Trial.NEW_DATA_OR_RESET)
# A call in a loop that is made less often than this belongs to the set-up.
_LEAST_REPEATS = 3


class RemedyKind(enum.StrEnum):
    """What a remedy changes."""

    RESULT = "wrong result"
    """The program computes or stores what it does not mean."""
    CALL = "call"
    """A call of MuJoCo or JAX."""
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


class Basis(enum.StrEnum):
    """Where a gain comes from."""

    TIMED = "timed"
    """The calls were timed one by one, and would not be made any more."""
    PAIRED = "paired"
    """Both ways were timed in turns on the program's own model and states."""
    BOUND = "at most"
    """It is the share of what would change; what replaces it takes time, too."""


@dataclass(frozen=True)
class Remedy:
    """One thing to do.

    Attributes:
      kind: what it changes.
      activity: whose time it saves; None for a wrong result.
      place: where; None for the whole loop.
      text: what to do.
      gain: share of the loop's time that it saves; None for a wrong result.
      gain_error: standard error of that share.
      code: of the lint rule that it follows; "" for none.
      confirmed: the share that it saved when the program ran again with and without it, and its
        error; None where that was not tried.
      basis: where the gain comes from.
      share: of the loop's time that the calls or lines take now; None for a wrong result.
      effect: what it changes in results.
    """

    kind: RemedyKind
    activity: Activity | None
    place: Place | None
    text: str
    gain: float | None
    gain_error: float | None
    code: str = ""
    confirmed: "Confirmed | None" = None
    basis: Basis = Basis.BOUND
    share: float | None = None
    effect: str = ""

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


@dataclass(frozen=True)
class CallRemedy:
    """What to do about calls of some functions in a loop.

    Attributes:
      callees: the functions, as the call clock names them.
      text: what to do; `{count}` stands for the number of calls.
      effect: what that changes in results.
      trial: that measures what replaces the call; None where nothing does.
      codes: of lint's rules for the same; a finding's own message is shown instead of `text`.
      needs_finding: whether only lint's finding shows the context, such as what is read afterwards.
      keeps_first: whether one call remains.
      is_bound: whether the same has to be computed elsewhere, so that less is saved.
    """

    callees: tuple[str, ...]
    text: str
    effect: str = "nothing"
    trial: Trial | None = None
    codes: tuple[str, ...] = ()
    needs_finding: bool = False
    keeps_first: bool = False
    is_bound: bool = False


# What to do about a call in a loop. A call that stands in none of them is what the program is for.
CALL_REMEDIES = (
    CallRemedy(
        callees=("mj_forward",),
        text="mj_forward computes what the next mj_step computes again",
        trial=Trial.FUNCTIONS,
        codes=("MJB007",),
        needs_finding=True,
    ),
    CallRemedy(
        callees=("MjData", "copy of MjData"),
        text="create one MjData before the loop, and use mj_copyData or mj_setState in it",
        trial=Trial.NEW_DATA_OR_COPY,
        codes=("MJB005", "MJB010"),
    ),
    CallRemedy(
        callees=(
            "from_xml_path",
            "from_xml_string",
            "from_binary_path",
            "from_file",
            "from_string",
            "compile",
            "copy of MjModel",
        ),
        text="compile the model once before the loop: change the compiled model, or keep a pool of"
        " bodies and move those that are not needed away",
        effect="nothing, if the model is the same",
        codes=("MJB011",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=("Renderer",),
        text="create one Renderer before the loop; each creates a graphics context",
        trial=Trial.RENDERER,
        codes=("MJB012",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=(call_clock.COMPILE,),
        text="JAX compiles {count} times here: call jax.jit once, before the loop, and give what"
        " varies as an argument",
        effect="nothing but rounding",
        codes=("MJB013",),
        keeps_first=True,
    ),
    CallRemedy(
        callees=(call_clock.THREADED_ROLLOUT,),
        text="rollout starts threads for each call: keep a pool, rollout.Rollout(nthread=n), and"
        " give it initial_warmstart where one call continues another",
        trial=Trial.POOL,
        codes=("MJB014",),
    ),
    CallRemedy(
        callees=(call_clock.PROCESS_START,),
        text="processes are started {count} times here: start them once, before the loop, and send"
        " them work; threads (mujoco.rollout) need no start",
    ),
    CallRemedy(
        callees=tuple(f"{call_clock.CALLBACK} {name}" for name in call_clock.CALLBACKS),
        text="MuJoCo calls this Python function in each step, and simulations on threads wait for"
        " each other there: where it sets controls, write data.ctrl before mj_step",
        effect="nothing where it reads only the state before the step; with Runge-Kutta, MuJoCo"
        " calls it four times a step",
        is_bound=True,
    ),
    CallRemedy(
        callees=(call_clock.EAGER_MJX,),
        text="{count} steps of MJX outside a compiled function: jax.jit one function that steps by"
        " jax.lax.scan, with jax.vmap over simulations",
        effect="nothing but rounding",
    ),
)
# What to do about an activity, where nothing more is known.
_ADVICE: Mapping[Activity, str] = {
    Activity.PYTHON: "do less in Python here: compute with whole arrays, or less often",
    Activity.BINDINGS: "look names up, and take views of the engine's arrays, once before the loop",
    Activity.NUMPY: "compute less often, or on fewer and larger arrays",
    Activity.ALLOCATION: "write into slices of an array that was created before the loop",
    Activity.POLICY: "the policy takes this long: batch its inputs, or use a smaller one",
    Activity.RENDERING: "render fewer frames, or smaller ones; EGL on a GPU is fastest",
    Activity.LOGGING: "write less often, and more at a time",
    Activity.PROCESSES: "give each process more work for a message, or use threads (rollout)",
    Activity.THREADS: "the loop waits for another thread of the program",
    Activity.SLEEPING: "the program sleeps: leave it out where nobody watches",
    Activity.COLLECTION: "call gc.freeze() after set-up, or gc.disable() in the loop",
    Activity.IMPORT: "import before the loop",
    Activity.LOADING: "load or compile models before the loop",
    Activity.BUILDING: "build and compile the model once before the loop: change the compiled"
    " model, or keep a pool of bodies",
}
# A line that is a call of the engine.
_ENGINE_CALL = re.compile(r"(mujoco\.)?mj_\w+\([\w\s.,=]*\)$")
# A line that looks up names, or takes views of the engine's arrays.
_READS_VIEWS = re.compile(
    r"\b(data|d)\.(q|x|c|act|sensor|site|geom|body|joint|ten|subtree|mocap)\w*|\.(joint|body|geom|site)\("
)
# Activities that are changed line by line; each of the others, but physics, is one thing to change.
_OF_LINES = {Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY, Activity.ALLOCATION}
# Activities that are no cost by themselves, or whose calls have remedies of their own.
_OF_CALLS = {Activity.PHYSICS, Activity.COPYING, Activity.COMPILING, Activity.REST}
_CLOCK_ADVICE = f"turn off {package_timer.NAME}: {package_timer.OFF_CODE}, after creating MjData"
_ONE_CALL_ADVICE = "nothing happens between these steps: call mj_step(model, data, nstep) once"
_ONE_CALL = Question(Trial.ONE_CALL)
_NAMED_ACCESS = Question(Trial.NAMED_ACCESS)

# Fields of MjData that a step computes only for sensors that need them.
_FORCES = ("cfrc_ext", "cfrc_int", "cacc")
# What the engine's warnings mean, by name.
_WARNINGS: Mapping[str, str] = {
    "BADQPOS": "the simulation diverged, and MuJoCo reset it",
    "BADQVEL": "the simulation diverged, and MuJoCo reset it",
    "BADQACC": "the simulation diverged, and MuJoCo reset it",
    "BADCTRL": "a control was not a number, and MuJoCo set all controls to zero",
    "CONTACTFULL": "contacts were dropped for want of memory: raise <size memory>",
    "CNSTRFULL": "constraints were dropped for want of memory: raise <size memory>",
    "INERTIA": "the inertia matrix is almost singular",
}


def questions(
    loops: Sequence[LoopTime], findings: Sequence[Finding], incidents: Sequence[Incident] = ()
) -> list[Question]:
    """Return what to measure on the program's model: only what could be worth a line."""
    asked: dict[Question, None] = {}
    for incident in incidents:
        if incident.name == call_clock.IN_TURN:
            asked[_batch(incident)] = None
    if any(finding.code == NAMED_ACCESS for finding in findings):
        asked[_NAMED_ACCESS] = None
    for loop in loops:
        if _steps_s(loop) > LEAST_GAIN * loop.seconds:
            asked[_no_timer(loop)] = None
            if any(loop_is_one_call(loop.loop.file, call.place.line) for call in _steps(loop)):
                asked[_ONE_CALL] = None
        for context in _contexts(loop, findings):
            if context.remedy.trial is not None and _share(loop, context.calls) >= LEAST_GAIN:
                asked[_question(context)] = None
    return list(asked)


def remedies(
    loop: LoopTime,
    findings: Sequence[Finding] = (),
    measured: Measured | None = None,
    incidents: Sequence[Incident] = (),
) -> list[Remedy]:
    """Return what to do about a loop, by gain.

    Args:
      loop: where its time goes.
      findings: of lint, in the program's own files.
      measured: on the program's model.
      incidents: that the program showed when it ran.
    """
    known = measured or Measured({})
    listed = [*_savings(loop, findings, known), *_of_turns(loop, known, incidents)]
    if any(incident.name == call_clock.SOFTWARE_GL for incident in incidents):
        listed = [_with_software_gl(remedy) for remedy in listed]
    worthwhile = [each for each in listed if each.gain is not None and each.gain >= LEAST_GAIN]
    return sorted(worthwhile, key=lambda remedy: remedy.rank)


def wrong_results(
    findings: Sequence[Finding],
    calls: ProgramCalls,
    files: Sequence[str] = (),
    computes_forces: bool | None = None,
) -> list[Remedy]:
    """Return what makes a program's results wrong, whatever it costs.

    Args:
      findings: of lint, in the program's own files.
      calls: of the program, with what it showed when it ran.
      files: the program's own.
      computes_forces: whether a step of its model computes what `_FORCES` names; None if unknown.
    """
    listed = list(_unfilled(calls, files) if computes_forces is False else ())
    for incident in calls.incidents:
        if not incident.is_wrong:
            continue
        if incident.name == call_clock.SHARED_DATA:
            text = "two threads step one MjData at the same time: give each thread its own"
        elif incident.name == call_clock.HALVES:
            text = (
                "mj_step2 integrates by Euler, although the model asks for Runge-Kutta: call"
                " mj_step, or choose another integrator"
            )
        else:
            meaning = _WARNINGS.get(incident.name, "the engine warned")
            times = "once" if incident.count == 1 else f"{incident.count:,} times"
            text = f"{meaning} ({times}, warning {incident.name})"
        listed.append(_wrong(incident.place, text))
    halves = {i.place.file for i in calls.incidents if i.name == call_clock.HALVES}
    for finding in findings:
        if not finding.is_wrong_result or (finding.code == "MJB008" and finding.file in halves):
            continue
        listed.append(replace(_wrong(_place(finding), finding.message), code=finding.code))
    return listed


def _unfilled(calls: ProgramCalls, files: Sequence[str]) -> Iterator[Remedy]:
    """Yield fields that are read and that nothing computes, by name."""
    if any(call.callee == "mj_rnePostConstraint" for call in calls.calls):
        return
    seen = set()
    for file in files:
        for line, name in lines_reading(file, _FORCES):
            if name not in seen:
                seen.add(name)
                text = (
                    f"{name} stays zero, since no sensor of the model needs it: call"
                    " mj_rnePostConstraint(model, data) before it is read"
                )
                yield _wrong(Place(file, line, ""), text)


def _wrong(place: Place, text: str) -> Remedy:
    return Remedy(RemedyKind.RESULT, None, place, text, None, None)


def _place(finding: Finding) -> Place:
    return Place(finding.file, finding.line, "")


def findings_of(files: Sequence[str]) -> list[Finding]:
    """Return lint's findings in files; those that cannot be checked have none."""
    findings: list[Finding] = []
    for file in files:
        try:
            findings += lint.check(file)
        except InputError:
            continue
    return findings


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


def _savings(loop: LoopTime, findings: Sequence[Finding], measured: Measured) -> Iterator[Remedy]:
    """Yield what saves time, in any order."""
    of_calls = list(_of_calls(loop, findings, measured))
    yield from of_calls
    yield from _of_steps(loop, measured)
    if loop.samples < FEW_SAMPLES:
        if Activity.COLLECTION in loop.activities:
            yield _of_activity(loop, Activity.COLLECTION)
        return
    unexplained = {each: share for each, share in loop.activities.items() if each in _OF_LINES}
    for activity in loop.activities.keys() - _OF_LINES - _OF_CALLS:
        if not loop.is_timed(activity) or not any(r.activity == activity for r in of_calls):
            yield _of_activity(loop, activity)
    for lines in _functions(loop):
        if not _avoidable(lines[0]):
            continue
        if _is_spread(loop, lines):
            yield _of_function(loop, lines)
        else:
            for line in lines:
                if _avoidable(line) >= LEAST_GAIN:
                    yield from _of_line(loop, line, _finding_at(line.place, findings), measured)
        for line in lines:
            for activity in line.activities.keys() & _OF_LINES:
                unexplained[activity] -= line.activities[activity]
    for activity, share in unexplained.items():
        if activity != Activity.BINDINGS:  # what no line shows is the calls themselves
            yield _remedy(loop, RemedyKind.ACTIVITY, activity, None, _ADVICE[activity], share)


@dataclass(frozen=True)
class _Context:
    """Calls that a remedy is for.

    Attributes:
      remedy: what to do about them.
      calls: from one line.
      place: where to change the program.
      finding: of lint for the same; None without one.
      nstep: steps of the loop, all together.
    """

    remedy: CallRemedy
    calls: Sequence[CallTime]
    place: Place
    finding: Finding | None
    nstep: float


def _contexts(loop: LoopTime, findings: Sequence[Finding]) -> Iterator[_Context]:
    """Yield the calls of a loop that have a remedy, by line."""
    for remedy in CALL_REMEDIES:
        by_place: dict[Place, list[CallTime]] = defaultdict(list)
        for call in loop.calls:
            if call.callee in remedy.callees:
                by_place[call.place].append(call)
        for place, calls in by_place.items():
            finding = _finding_of(remedy, place, loop, findings)
            repeats = sum(call.calls for call in calls) >= _LEAST_REPEATS
            if finding is not None or (repeats and not remedy.needs_finding):
                at = place if finding is None else _place(finding)
                nstep = sum(call.all_steps for call in _steps(loop))
                yield _Context(remedy, calls, at, finding, nstep)


def _finding_of(
    remedy: CallRemedy, place: Place, loop: LoopTime, findings: Sequence[Finding]
) -> Finding | None:
    """Return lint's finding about calls from a line.

    JAX compiles where a function is first called, not where lint finds it.
    """
    for finding in findings:
        if finding.code not in remedy.codes or finding.file != place.file:
            continue
        in_loop = loop.loop.first <= finding.line <= loop.loop.last
        if finding.line == place.line or (call_clock.COMPILE in remedy.callees and in_loop):
            return finding
    return None


def _of_calls(loop: LoopTime, findings: Sequence[Finding], measured: Measured) -> Iterator[Remedy]:
    """Yield what to do about calls that were timed one by one."""
    for context in _contexts(loop, findings):
        remedy, calls, finding = context.remedy, context.calls, context.finding
        count, share = sum(call.calls for call in calls), _share(loop, calls)
        gain, basis = share, Basis.BOUND if remedy.is_bound else Basis.TIMED
        if remedy.trial == Trial.FUNCTIONS:
            gain, basis = _gain_of_functions(loop, calls, _question(context), measured)
        elif remedy.trial == Trial.POOL:
            # what threads cost to start is the same in any state, unlike the steps
            saved_s = measured.saved_s(_question(context))
            if saved_s is None:
                continue  # most of the call is its steps
            gain, basis = min(share, saved_s * count / loop.seconds), Basis.PAIRED
        elif remedy.trial is not None:
            saved = measured.saved(_question(context))
            basis = Basis.BOUND
            if saved is not None:
                whole = [*calls, *_beside(loop, remedy.trial)]
                gain, basis = saved * _stands_for(loop, whole), Basis.PAIRED
        if remedy.keeps_first and count > 1:
            gain *= 1 - 1 / count
        text = finding.message if finding is not None else remedy.text
        yield Remedy(
            RemedyKind.CALL,
            calls[0].activity,
            context.place,
            text.replace("{count}", f"{round(count):,}"),
            gain,
            None,
            finding.code if finding is not None else "",
            basis=basis,
            share=share,
            effect=remedy.effect,
        )


def _question(context: _Context) -> Question:
    remedy, finding, calls = context.remedy, context.finding, context.calls
    assert remedy.trial is not None, "only calls that are replaced have a question"
    if remedy.trial == Trial.FUNCTIONS:
        return Question(remedy.trial, () if finding is None else tuple(finding.instead))
    if remedy.trial == Trial.POOL:
        count, steps = sum(call.calls for call in calls), sum(call.steps for call in calls)
        all_steps = sum(call.all_steps for call in calls)
        return Question(
            remedy.trial,
            simulations=max(1, round(all_steps / max(1.0, steps))),
            steps=max(1, round(steps / max(1.0, count))),
        )
    if remedy.trial == Trial.RENDERER:
        frame = next((call.frame for call in calls if call.frame), None)
        backend = calls[0].backend
        return Question(remedy.trial, frame=frame or (240, 320), backend=backend)
    after_each = round(context.nstep / max(1.0, sum(call.calls for call in calls)))
    after_each = min(_MOST_STEPS, after_each)
    if finding is not None and finding.code == "MJB005":
        return Question(Trial.NEW_DATA_OR_RESET, steps=after_each)
    is_copy = all(call.callee.startswith("copy") for call in calls)
    return Question(Trial.COPY_OR_COPY if is_copy else remedy.trial, steps=after_each)


def _beside(loop: LoopTime, trial: Trial) -> list[CallTime]:
    """Return the calls that a pair holds beside those that are replaced."""
    if trial == Trial.RENDERER:
        return [call for call in loop.calls if call.activity == Activity.RENDERING]
    return _steps(loop) if trial in _WITH_STEPS else []


def _stands_for(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    """Return the share of a loop that a pair stands for: all that is not seen on other lines.

    A new MjData also costs where its memory is first used, and where it is freed.
    """
    if not calls:
        return 0.0
    own = {(call.place.file, call.place.line) for call in calls}
    timed = _share(loop, calls)
    elsewhere = sum(
        sum(part for activity, part in line.activities.items() if not loop.is_timed(activity))
        for line in loop.lines
        if (line.place.file, line.place.line) not in own
    )
    others = [call for call in loop.calls if (call.place.file, call.place.line) not in own]
    if Activity.REST in loop.activities:  # nothing says where it was spent
        return timed / max(timed, loop.timed_share)
    return min(_MOST_GAIN, max(timed, 1 - elsewhere - _share(loop, others)))


def _gain_of_functions(
    loop: LoopTime, calls: Sequence[CallTime], question: Question, measured: Measured
) -> tuple[float, Basis]:
    """Return what other functions after a step save.

    The pair that was measured is a step with the call, and a step with the other functions.
    """
    share, saved = _share(loop, calls), measured.saved(question)
    if saved is None:
        return share, Basis.TIMED if not question.functions else Basis.BOUND
    count = sum(call.calls for call in calls)
    step_s = sum(call.seconds for call in _steps(loop))
    nstep = sum(call.all_steps for call in _steps(loop))
    pair_s = count * (step_s / nstep if nstep else 0.0) + sum(call.seconds for call in calls)
    return saved * pair_s / loop.seconds, Basis.PAIRED


def _no_timer(loop: LoopTime) -> Question:
    """Return the question about the timer, for as many steps a call as the loop takes."""
    steps = _steps(loop)
    nstep = sum(call.all_steps for call in steps) / max(1.0, sum(call.calls for call in steps))
    return Question(Trial.NO_TIMER, steps=max(1, round(nstep)))


def _of_steps(loop: LoopTime, measured: Measured) -> Iterator[Remedy]:
    """Yield what to do about the steps themselves."""
    share = _steps_s(loop) / loop.seconds
    saved = measured.saved(_no_timer(loop)) if share else None
    gain = loop.engine_clock if saved is None else saved * _stands_for(loop, _steps(loop))
    if gain >= package_timer.MIN_GAIN:
        yield Remedy(
            RemedyKind.CLOCK,
            Activity.PHYSICS,
            None,
            _CLOCK_ADVICE,
            gain,
            None if saved is not None else loop.error(gain),
            basis=Basis.BOUND if saved is None else Basis.PAIRED,
            share=share,
            effect="nothing; mjData.timer stays empty",
        )
    by_place: dict[Place, list[CallTime]] = defaultdict(list)
    for call in _steps(loop):
        by_place[call.place].append(call)
    for place, calls in by_place.items():
        saved = measured.saved(_ONE_CALL)
        # the pair includes what Python does around each call
        share = _share(loop, calls) + loop.activities.get(Activity.BINDINGS, 0.0)
        if saved is not None and loop_is_one_call(loop.loop.file, place.line):
            yield Remedy(
                RemedyKind.CALL,
                Activity.PHYSICS,
                place,
                _ONE_CALL_ADVICE,
                saved * min(1.0, share),
                None,
                basis=Basis.PAIRED,
                share=share,
                effect="nothing",
            )


def _of_turns(
    loop: LoopTime, measured: Measured, incidents: Sequence[Incident]
) -> Iterator[Remedy]:
    """Yield what to do about several simulations that are stepped in turn."""
    for incident in incidents:
        calls = [call for call in _steps(loop) if call.place == incident.place]
        if incident.name != call_clock.IN_TURN or not calls:
            continue
        share, saved = _share(loop, calls), measured.saved(_batch(incident))
        yield Remedy(
            RemedyKind.CALL,
            Activity.PHYSICS,
            incident.place,
            f"{incident.count} simulations are stepped in turn: mujoco.batch.Batch steps them at"
            " once, on all cores (mujoco.rollout in releases without it)",
            share * (1 - 1 / machine.usable_cores()) if saved is None else share * saved,
            None,
            basis=Basis.BOUND if saved is None else Basis.PAIRED,
            share=share,
            effect="nothing",
        )


def _batch(incident: Incident) -> Question:
    return Question(Trial.BATCH, simulations=max(2, incident.count))


def _with_software_gl(remedy: Remedy) -> Remedy:
    """Return a remedy for rendering that says who draws."""
    if remedy.activity != Activity.RENDERING:
        return remedy
    return replace(remedy, text=f"{remedy.text}; here the processor draws (software rendering)")


def _steps(loop: LoopTime) -> list[CallTime]:
    """Return the calls of `mj_step` in a loop."""
    return [call for call in loop.calls if call.callee == "mj_step"]


def _steps_s(loop: LoopTime) -> float:
    return sum(call.seconds for call in _steps(loop))


def _share(loop: LoopTime, calls: Sequence[CallTime]) -> float:
    return min(1.0, sum(call.seconds for call in calls) / loop.seconds)


def _finding_at(place: Place, findings: Sequence[Finding]) -> Finding | None:
    """Return the finding of a line that is about time."""
    at_line = (each for each in findings if (each.file, each.line) == (place.file, place.line))
    return next((each for each in at_line if each.ns_per_step is not None), None)


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


def _of_line(
    loop: LoopTime, line: LineTime, finding: Finding | None, measured: Measured
) -> Iterator[Remedy]:
    """Yield what to do about a line: what lint says of it, and about what that leaves."""
    activity, share = _main_cost([line]), _avoidable(line)
    if _ENGINE_CALL.match(line.place.text) and any(c.place == line.place for c in loop.calls):
        return  # what samples saw there beside the call is what Python does to make it
    if finding is not None:
        remedy = _remedy(loop, RemedyKind.LINE, activity, line.place, finding.message, share)
        remedy = replace(remedy, code=finding.code, effect="nothing")
        ratio = measured.ratios.get(_NAMED_ACCESS)
        nstep = sum(call.calls for call in _steps(loop))
        if finding.code != NAMED_ACCESS or ratio is None or not nstep:
            yield remedy
            return
        gain = min(share, max(0.0, ratio.saved_s * nstep / loop.seconds))
        yield replace(remedy, gain=gain, gain_error=None, basis=Basis.PAIRED, share=share)
        share -= gain
    text = _ADVICE[activity]
    if line.package and line.package != STANDARD_LIBRARY:
        text = f"time in {line.package}"
        if Activity.PHYSICS in line.activities:
            text = f"{text} beside physics; `mjbench env` takes an environment apart"
    elif activity == Activity.BINDINGS and not _READS_VIEWS.search(line.place.text):
        text = "the calls of the engine themselves: make fewer of them, each for more"
    yield _remedy(loop, RemedyKind.LINE, activity, line.place, text, share)


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
