"""What to do about a loop as a whole: about an activity, models that are built in it, and steps."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import mujoco

from mjbench import formats
from mjbench.commands.run import single_calls
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import ArgumentChange, Incident
from mjbench.commands.run.hook import argument_types, call_clock
from mjbench.commands.run.loop_time import FEW_SAMPLES, LEAST_REPEATS, LineTime, LoopTime
from mjbench.commands.run.remedies.call_savings import (
    count_of,
    drawing,
    seconds_of,
    share_of,
    share_with_python,
    steps_of,
)
from mjbench.commands.run.remedies.remedy import LEAST_GAIN, Basis, Remedy, RemedyKind
from mjbench.commands.run.remedies.remedy_pairs import MeasuredRatios, RemedyPair, TimedWay
from mjbench.commands.run.thread_pools import ThreadPools
from mjbench.host import machine
from mjbench.simulation import engine_clock

# What to do about waiting in which nobody works.
_MESSAGES_ADVICE: Mapping[Activity, str] = {
    Activity.PROCESSES: "the loop waits and no process works meanwhile: give each process more work"
    " for a message, or use threads (rollout)",
    Activity.THREADS: "the loop waits and no thread works meanwhile: let each thread take more"
    " steps for each wait; `mjbench compare MODEL --paths python_loop,threads,batch_step` says what"
    " threads and mujoco.batch.Batch gain",
}
# What to do where the line that waits calls Gymnasium.
_VECTOR_ADVICE = (
    "the loop waits and no process works meanwhile: SyncVectorEnv steps the environments without"
    " messages; `mjbench env` times both"
)
_UNPICKLING_ADVICE = (
    "processes unpickle for {share} of the loop what they are sent: give each a model and other"
    " data once (initializer= of a pool), and send only what differs"
)
_COLLECTION_ADVICE = (
    "call gc.disable() before the loop, and gc.collect() where a pause does no harm"
)
# Images of a simulated second that a video in real time shows.
VIDEO_HZ = 60
_COUNT_SLACK = 1.02
# What to do where JAX compiles again, by what differs in an argument.
_RECOMPILED_ADVICE: Mapping[str, str] = {
    argument_types.WEAK_TYPE: "create it with a dtype, such as jnp.full(n, x, dtype=jnp.float32)",
    argument_types.DEVICE: "write it into the array that was there, such as ctrl.at[:].set(x), so"
    " that it keeps its type and its device",
    argument_types.DTYPE: "give it one dtype in all calls",
    argument_types.SHAPE: "give it one shape in all calls, or pad it",
    argument_types.VALUE: "give what varies as an array, and the rest as one value in all calls",
}
_BUILDING_ADVICE = (
    "build and compile the model once before the loop: change the compiled model, or keep a pool"
    " of bodies"
)
_CLOCK_ADVICE = (
    f"turn off {engine_clock.TIMER_NAME}: {engine_clock.OFF_CODE}, after creating MjData"
)
_BEFORE_CALLBACKS = " and before setting callbacks of your own, which it removes"


def of_samples(
    loop: LoopTime,
    activity: Activity,
    place: Place | None,
    text: str,
    share: float,
    kind: RemedyKind = RemedyKind.ACTIVITY,
) -> Remedy:
    """Return what to do about a share that samples show, which is saved at most."""
    return Remedy(kind, activity, place, text, share, loop.error(share))


def _main_line(loop: LoopTime, activity: Activity) -> LineTime | None:
    lines = [line for line in loop.lines if activity in line.activities]
    return max(lines, key=lambda line: line.activities[activity], default=None)


def _of_activity(
    loop: LoopTime, activity: Activity, text: str, share: float, kind: RemedyKind
) -> Remedy:
    """Return what to do about an activity as a whole, at the line where most of it is."""
    most = _main_line(loop, activity)
    return of_samples(loop, activity, most.place if most else None, text, share, kind)


def of_collection(loop: LoopTime) -> Iterator[Remedy]:
    """Yield what saves garbage collections, each of which was timed."""
    activity = Activity.COLLECTION
    if share := loop.activities.get(activity):
        remedy = _of_activity(loop, activity, _COLLECTION_ADVICE, share, RemedyKind.COLLECTION)
        yield replace(remedy, basis=Basis.TIMED, gain_error=0.0, share=share)


def of_messages(loop: LoopTime, others_busy_s: float) -> Iterator[Remedy]:
    """Yield what to do about the share of a loop in which it waits, and nobody else steps.

    Loops of workers wait for the program's own loop: what is said of that holds for them, too.
    """
    if not loop.in_main:
        return
    for activity, text in _MESSAGES_ADVICE.items():
        if share := loop.activities.get(activity):
            idle = min(share, max(0.0, 1 - others_busy_s / loop.seconds))
            line = _main_line(loop, activity)
            if activity == Activity.PROCESSES and line and line.package == "gymnasium":
                text = _VECTOR_ADVICE
            elif activity == Activity.PROCESSES and 2 * loop.unpickling_share > idle:
                share_text = formats.whole_percent(loop.unpickling_share)
                text = _UNPICKLING_ADVICE.format(share=share_text)
            yield _of_activity(loop, activity, text, idle, RemedyKind.ACTIVITY)


def of_pools(loop: LoopTime, pools: ThreadPools | None) -> Iterator[Remedy]:
    """Yield how many threads libraries should have in each of several processes."""
    if pools is None or pools.speedup is None or set(pools.pids).isdisjoint(loop.pids):
        return
    activity = max(pools.variables, key=lambda each: loop.activities.get(each, 0.0))
    share = loop.activities.get(activity, 0.0)
    library = "BLAS" if activity == Activity.NUMPY else "OpenMP"
    text = (
        f"{len(pools.pids)} processes × {pools.threads} threads of {library} on"
        f" {pools.usable_cores} cores: set {pools.variables[activity]}=1 before Python starts"
    )
    if share:
        after = 1 / pools.speedup
        remedy = _of_activity(loop, activity, text, 1 - after, RemedyKind.THREADS)
        yield replace(
            remedy,
            basis=Basis.RERUN,
            share=share,
            gain_error=after * pools.relative_error,
            effect="nothing but rounding",
        )


def of_building(loop: LoopTime) -> Remedy | None:
    """Return what to do where samples show more of models that are built than calls that load.

    Models that are built before the first steps, or beside each other, are the set-up of a loop.
    """
    line = loop.building
    loading = [call for call in loop.calls if call.activity == Activity.LOADING]
    if line is None or loop.samples < FEW_SAMPLES or count_of(loading) < LEAST_REPEATS:
        return None
    places = {call.place.position for call in loading}
    is_call = len(places) == 1 or line.place.position in places
    if is_call and line.activities.get(Activity.BUILDING, 0.0) < LEAST_GAIN:
        return None
    return of_samples(loop, Activity.BUILDING, line.place, _BUILDING_ADVICE, line.share)


def of_recompilations(loop: LoopTime, incidents: Sequence[Incident]) -> Iterator[Remedy]:
    """Yield what makes JAX compile a function again, which was compiled before."""
    for incident in incidents:
        is_here = any(
            call.activity == Activity.COMPILING and call.place.position == incident.place.position
            for call in loop.calls
        )
        if incident.name != call_clock.RECOMPILED or not is_here:
            continue
        times = "" if incident.count == 1 else f" {incident.count:,} times"
        seconds = f"for {formats.plain(incident.seconds, 2)} s"
        compiled = f"JAX compiles this function again{times}, {seconds}"
        if incident.is_unfinished:
            compiled += " so far: the run ended before it had compiled it"
        share = min(1.0, incident.seconds / loop.seconds)
        yield Remedy(
            RemedyKind.CALL,
            Activity.COMPILING,
            incident.place,
            f"{compiled}, {_why_recompiled(incident.changes)}",
            share,
            None,
            basis=Basis.BOUND if incident.is_unfinished else Basis.TIMED,
            share=share,
            effect="nothing but rounding",
        )


def _why_recompiled(changes: Sequence[ArgumentChange]) -> str:
    if not changes:
        return "although its arguments are of the same types: JAX_EXPLAIN_CACHE_MISSES=1 says why"
    differing = " and ".join(
        f"{each.argument} is {each.now}, and was {each.before}" for each in changes
    )
    return f"since {differing}: {_RECOMPILED_ADVICE[changes[0].kind]}"


def of_frames(loop: LoopTime, timestep_s: float | None) -> Iterator[Remedy]:
    """Yield how many images a video needs, where more are drawn."""
    drawn = [call for call in loop.calls if call.callee == "render"]
    simulated_s = (timestep_s or 0.0) * sum(call.all_steps for call in loop.calls)
    if not drawn or not simulated_s:
        return
    rate = count_of(drawn) / simulated_s
    # counts are estimated, and 59.9 frames may be 60
    every = int(_COUNT_SLACK * rate / VIDEO_HZ)
    if every < 2:
        return
    share = share_of(loop, drawing(loop))
    yield Remedy(
        RemedyKind.CALL,
        Activity.RENDERING,
        max(drawn, key=lambda call: call.seconds).place,
        f"{rate:,.0f} images are drawn for a simulated second: for a video of {VIDEO_HZ} a second,"
        f" draw one in {every}",
        share * (1 - 1 / every),
        None,
        basis=Basis.TIMED,
        share=share,
        effect="the number of images",
    )


def of_chunks(loop: LoopTime) -> Iterator[Remedy]:
    """Yield what calls save whose chunks leave threads without work."""
    for call in loop.calls:
        single = single_calls.of_call(call, machine.usable_cores())
        if single is None or not single.idle_threads or not single.chunk_for_all:
            continue
        assert single.chunk is not None, "otherwise no thread is known to be idle"
        share = share_of(loop, [call])
        # of those that work at once now, and then
        now = single.nthread - single.idle_threads
        then = min(single.nthread, max(now, single.usable_cores))
        yield Remedy(
            RemedyKind.CALL,
            Activity.PHYSICS,
            call.place,
            single.idle_sentence,
            share * (1 - now / then),
            None,
            share=share,
            effect="nothing",
        )


# -- steps -----------------------------------------------------------------------------------------


def no_timer(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    def steps(data: mujoco.MjData) -> None:
        for _ in range(10):
            mujoco.mj_step(model, data, pair.steps)

    return TimedWay(steps), TimedWay(steps, has_timer=False)


def batch(model: mujoco.MjModel, pair: RemedyPair) -> tuple[TimedWay, TimedWay]:
    """Return simulations in turn, and as a batch, from the model's own start."""
    from mujoco.batch import Batch

    datas = [mujoco.MjData(model) for _ in range(pair.simulations)]
    of_all = Batch(model, pair.simulations)

    def in_turn(data: mujoco.MjData) -> None:
        for each in datas:
            mujoco.mj_step(model, each)

    return TimedWay(in_turn), TimedWay(lambda data: of_all.step())


def step_pairs(loops: Sequence[LoopTime], incidents: Sequence[Incident]) -> Iterator[RemedyPair]:
    for incident in incidents:
        if incident.name == call_clock.IN_TURN:
            yield _turns_pair(incident)
    for loop in loops:
        if seconds_of(steps_of(loop.calls)) > LEAST_GAIN * loop.seconds:
            yield _timer_pair(loop)


def _timer_pair(loop: LoopTime) -> RemedyPair:
    steps = steps_of(loop.calls)
    nstep = sum(call.all_steps for call in steps) / max(1.0, count_of(steps))
    return RemedyPair(no_timer, steps=max(1, round(nstep)))


def _turns_pair(incident: Incident) -> RemedyPair:
    return RemedyPair(batch, simulations=max(2, incident.count), on_threads=True)


def of_timer(loop: LoopTime, measured: MeasuredRatios) -> Iterator[Remedy]:
    has_callbacks = any(call.is_callback for call in loop.calls)
    share = share_with_python(loop, steps_of(loop.calls))
    ratio = measured.ratios.get(_timer_pair(loop)) if share else None
    if ratio is not None and (gain := ratio.saved * share) >= engine_clock.MIN_GAIN:
        yield Remedy(
            RemedyKind.CLOCK,
            Activity.PHYSICS,
            None,
            _CLOCK_ADVICE + (_BEFORE_CALLBACKS if has_callbacks else ""),
            gain,
            gain * ratio.relative_error,
            basis=Basis.PAIRED,
            share=share,
            effect="nothing but mjData.timer, which stays empty",
        )


def of_turns(
    loop: LoopTime, measured: MeasuredRatios, incidents: Sequence[Incident]
) -> Iterator[Remedy]:
    for incident in incidents:
        calls = [
            call for call in steps_of(loop.calls) if call.place.position == incident.place.position
        ]
        if incident.name != call_clock.IN_TURN or not calls:
            continue
        share, ratio = share_of(loop, calls), measured.ratios.get(_turns_pair(incident))
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
