"""What the run file and `mjbench run --json` hold for one program."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.bounds import AnyInt, NonNegativeInt, PositiveFloat
from mjbench.commands.run import physics_cost, sampled_loops
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.gil_waits import GilWait
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.launch import ProgramObservation, UncaughtException
from mjbench.commands.run.loop_time import LineTime, LoopTime
from mjbench.commands.run.physics_cost import PhysicsCost
from mjbench.commands.run.remedies import listing, trials, wrong_results
from mjbench.commands.run.remedies.remedy import Remedy
from mjbench.commands.run.sampling import ProcessorUse
from mjbench.commands.run.source_loops import SourceLoop
from mjbench.commands.run.step_times import StepTimes
from mjbench.host import machine
from mjbench.status import Status


@dataclass(frozen=True)
class LoopReport:
    """A loop, and what to do about it.

    Attributes:
      time: where the loop's time goes.
      remedies: what to do, the most important first.
    """

    time: LoopTime
    remedies: Sequence[Remedy]


def others_busy_s(
    time: LoopTime, calls: Sequence[CallTime], of_main: Collection[SourceLoop]
) -> float:
    """Return the seconds of a loop for which other processes or threads step, at least.

    What they step before or after the loop does not count. When each call was made is not known, so
    it is taken to be as likely at any time between the first and the last.

    Args:
      of_main: loops of the program's main thread, which does not step while it waits.
    """
    loop_s = time.seconds / len(time.threads)
    by_thread = defaultdict[tuple[int, int], float](float)
    for call in calls:
        is_other = call.pid not in time.pids or call.loop not in of_main
        if is_other and call.activity == Activity.PHYSICS:
            span_s = 1e-9 * (call.last_ns - call.first_ns)
            by_thread[call.pid, call.thread] += call.seconds * min(1.0, loop_s / max(1e-9, span_s))
    busy_s = by_thread.values()
    return max([0.0, *busy_s, sum(busy_s) / machine.usable_cores()])


@dataclass(frozen=True)
class ProgramRow:
    """Where a program's time goes.

    Attributes:
      program: name of the file or module.
      status: `ok`; `unavailable` where the profiler could take no samples.
      detail: why not, in one line; empty when ok.
      exit_code: of the program.
      was_ended: whether mjbench ended it, since its seconds were over.
      wall_s: from its start to its end.
      rate_hz: samples per second.
      samples: taken of all threads.
      processor: time that the program and those who observed it used; None where it is not known.
      loops: that step, or wait for processes that do; the program's own first.
      steps: of each process that stepped.
      wrong: what makes its results wrong, whether or not the loop was sampled.
      memory_growth_bytes: by how much the memory of the process that grew most has grown since
        shortly after its first step; None where that is not known.
      crash: the line of Python that ran when a process of it crashed; None where none has.
      exception: that ended it; None where none has.
      physics: what costs in its steps; None where its first loop is not nearly all physics, or its
        model could not be stepped again.
      gil_waits: threads that wait for the GIL, those that wait longest first; none where JAX runs,
        whose waits look alike.
      outside_loops: lines that take time outside the loops, such as imports and set-up, with all
        that they call; shares are of `wall_s`.
      untimed_processes: that step, and whose steps were not timed, since the disk is full.
    """

    record_type: ClassVar[str] = "program"
    program: str
    status: Status
    detail: str
    exit_code: AnyInt
    was_ended: bool
    wall_s: PositiveFloat
    rate_hz: NonNegativeInt
    samples: NonNegativeInt
    loops: Sequence[LoopReport]
    steps: Sequence[StepTimes]
    wrong: Sequence[Remedy] = ()
    processor: ProcessorUse | None = None
    memory_growth_bytes: AnyInt | None = None
    crash: Place | None = None
    exception: UncaughtException | None = None
    physics: PhysicsCost | None = None
    gil_waits: Sequence[GilWait] = ()
    outside_loops: Sequence[LineTime] = ()
    untimed_processes: NonNegativeInt = 0

    @classmethod
    def of(cls, name: str, observation: ProgramObservation) -> "ProgramRow":
        steps = [step for step in observation.steps if step.step is not None]
        calls, incidents = observation.calls.calls, observation.calls.incidents
        times = sampled_loops.loop_times(
            observation.threads,
            observation.pid,
            {step.pid for step in steps},
            calls,
            {step.pid: step.collections_s for step in steps},
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
        asked = listing.trials(times, findings, incidents)
        measured = trials.measure(observation.models, asked)
        physics = None
        if times and times[0].is_mostly_physics:
            most = sorted(observation.steps, key=lambda each: -(each.nstep or 0))
            stages = next((each.stages for each in most if each.stages), {})
            physics = physics_cost.measure(observation.models, stages)
        loops = []
        for time in times:
            busy_s = others_busy_s(time, calls, of_main)
            listed = listing.remedies(time, findings, measured, incidents, busy_s)
            loops.append(LoopReport(time, listed))
        return cls(
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
            untimed_processes=len(stepping.intersection(observation.untimed_pids)),
        )

    @property
    def cost_share(self) -> float:
        """What observing cost the program, as a share of its time.

        That is the step clock, and processor time on cores that the program could use.
        """
        clocks = [step.cost_share for step in self.steps] or [
            sum(call.clock_s for call in report.time.calls) / report.time.seconds
            for report in self.loops
        ]
        clock = max(clocks, default=0.0)
        displaced = self.processor.displaced_share if self.processor else 0.0
        return clock + displaced
