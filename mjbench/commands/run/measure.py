"""From what was seen of a program to its record: remedies and its physics are timed on the way."""

import math
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace

from mjbench.commands.run import launch, physics_cost, sampled_loops, single_calls
from mjbench.commands.run.activities import Activity
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.launch import Program, ProgramObservation
from mjbench.commands.run.loop_time import LoopTime
from mjbench.commands.run.remedies import listing, remedy_pairs, wrong_results
from mjbench.commands.run.result import LoopReport, ProgramRow
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.host import machine
from mjbench.status import Status

# Seconds of steps in a second run.
SECOND_S = 8.0


def observed(
    program: Program,
    seconds: float | None,
    rate_hz: int | None = None,
    most_s: float = math.inf,
    ends_on_signal: bool = False,
) -> ProgramObservation:
    """Run a program as `launch.run` does; with too many threads, a second time with fewer."""
    seen = launch.run(program, seconds, rate_hz, most_s, ends_on_signal)
    if seen.pools is None or seen.was_interrupted or not _steps_per_s(seen):
        return seen
    second = launch.run(
        program,
        min(SECOND_S, math.inf if seconds is None else seconds),
        rate_hz,
        min(most_s, 2 * SECOND_S),
        ends_on_signal,
        seen.pools.environment,
    )
    speedup = _steps_per_s(second) / _steps_per_s(seen)
    error = math.hypot(_relative_error(second), _relative_error(seen))
    return replace(seen, pools=replace(seen.pools, speedup=speedup or None, relative_error=error))


def _steps_per_s(seen: ProgramObservation) -> float:
    return sum(each.steps_per_s or 0.0 for each in seen.steps)


def _relative_error(seen: ProgramObservation) -> float:
    """Return the standard error of steps per second; processes are slow together."""
    iterations = [each.iteration for each in seen.steps if each.iteration is not None]
    return max((each.mean_error for each in iterations), default=0.0)


def record(name: str, observation: ProgramObservation) -> ProgramRow:
    """Return what an observation means, with remedies timed on the program's own model."""
    steps = [step for step in observation.steps if step.step is not None]
    calls = sampled_loops.with_sampled_loops(observation.threads, observation.calls.calls)
    incidents = observation.calls.incidents
    times = sampled_loops.loop_times(
        observation.threads,
        observation.pid,
        {step.pid for step in steps},
        calls,
        {step.pid: step.collections_s for step in steps},
        {each.pid: each.step.mean_error for each in steps if each.step is not None},
    )
    stepping = {pid for time in times for pid in time.pids} or {observation.pid}
    of_main = {time.loop for time in times if time.in_main}
    in_loops = {file for time in times for file in time.own_files}
    files = sorted(
        file
        for file in in_loops | {call.place.file for call in calls}
        if not file_owners.package_of(file)
    )
    findings = listing.findings_of(files)
    asked = listing.pairs(times, findings, incidents)
    measured = remedy_pairs.measure(observation.models, asked)
    physics, single = None, single_calls.single_calls(calls, machine.usable_cores())
    if times[0].is_half_physics if times else single:
        most = sorted(observation.steps, key=lambda each: -each.nstep)
        stages = next((each.stages for each in most if each.stages), {})
        physics = physics_cost.measure(observation.models, stages)
    loops = []
    for time in times:
        busy_s = others_busy_s(time, times, calls, of_main)
        timesteps_s = (each.timestep_s for each in steps if each.pid in time.pids)
        listed = listing.remedies(
            time,
            findings,
            measured,
            incidents,
            busy_s,
            observation.pools,
            next(filter(None, timesteps_s), None),
        )
        loops.append(LoopReport(time, listed))
    return ProgramRow(
        program=name,
        status=Status.UNAVAILABLE if observation.problem and not times else Status.OK,
        detail=observation.problem,
        exit_code=observation.exit_code,
        was_ended=observation.was_ended,
        wall_s=observation.wall_s,
        rate_hz=observation.rate_hz,
        samples=sum(len(thread.stacks) for thread in observation.threads),
        loops=loops,
        steps=steps,
        wrong=wrong_results.wrong_results(
            findings, observation.calls, files, measured.computes_forces
        ),
        processor=observation.processor,
        memory_growth_bytes=observation.calls.memory_growth_bytes,
        crash=observation.crash,
        exception=observation.exception,
        gil_waits=() if any(call.is_of_jax for call in calls) else observation.gil_waits,
        outside_loops=sampled_loops.outside_loops(
            observation.threads, observation.pid, times, observation.wall_s, calls
        ),
        physics=physics,
        single_calls=single,
        queued_s=observation.queued_s,
        untimed_processes=len(stepping.intersection(observation.untimed_pids)),
    )


def others_busy_s(
    time: LoopTime,
    times: Sequence[LoopTime],
    calls: Sequence[CallTime],
    of_main: Collection[SourceLoop],
) -> float:
    """Return the seconds of a loop for which other processes work, or threads step, at least.

    What they step before or after the loop does not count. When each call was made is not known, so
    it is taken to be as likely at any time between the first and the last.

    Args:
      times: loops of all processes.
      of_main: loops of the program's main thread, which does not step while it waits.
    """
    loop_s = time.seconds_of_thread
    by_thread = defaultdict[tuple[int, int], float](float)
    for call in calls:
        is_other = call.pid not in time.pids or call.loop not in of_main
        if is_other and call.activity == Activity.PHYSICS:
            span_s = 1e-9 * (call.last_ns - call.first_ns)
            by_thread[call.pid, call.thread] += call.seconds * min(1.0, loop_s / max(1e-9, span_s))
    working_s = [
        min(loop_s, other.seconds_of_thread * (1 - other.waiting_share))
        for other in times
        if set(other.pids).isdisjoint(time.pids)
    ]
    busy_s = by_thread.values()
    return max([0.0, *working_s, *busy_s, sum(busy_s) / machine.usable_cores()])
