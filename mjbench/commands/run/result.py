"""What the run file and `mjbench run --json` hold for one program."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from mjbench.bounds import AnyInt, NonNegativeFloat, NonNegativeInt, PositiveFloat
from mjbench.commands.run.activities import Place
from mjbench.commands.run.gil_waits import GilWait
from mjbench.commands.run.launch import UncaughtException
from mjbench.commands.run.loop_time import LineTime, LoopTime
from mjbench.commands.run.physics_cost import PhysicsCost
from mjbench.commands.run.remedies.remedy import Remedy
from mjbench.commands.run.sampling import ProcessorUse
from mjbench.commands.run.single_calls import SingleCall
from mjbench.commands.run.step_times import StepTimes
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
      single_calls: that step many times and that no loop runs, such as one long rollout; the
        longest first.
      queued_s: for which its main thread could run, and had no core; None where that is not known.
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
    single_calls: Sequence[SingleCall] = ()
    queued_s: NonNegativeFloat | None = None

    @property
    def has_crashed(self) -> bool:
        """Whether an error ended it: then nothing else matters."""
        return self.crash is not None or self.exception is not None

    def step_error(self, time: LoopTime) -> float:
        """Return the standard error of the time of steps in a loop, as a share of it."""
        steps = (each.step for each in self.steps if each.pid in time.pids)
        return max((each.mean_error for each in steps if each is not None), default=0.0)

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
