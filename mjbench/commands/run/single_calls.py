"""Calls outside loops that step many times, such as one long rollout: what each step takes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.bounds import NonNegativeFloat, NonNegativeInt, PositiveInt
from mjbench.commands.run.activities import Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook.call_clock import THREADED_ROLLOUT
from mjbench.formats import count_of, duration, plain

# Without `chunk_size`, `mujoco.rollout` divides the simulations into this many chunks per thread.
_CHUNKS_OF_THREAD = 10


@dataclass(frozen=True)
class SingleCall:
    """A call that steps, on a line that no loop runs.

    Attributes:
      function: such as `rollout` or `Batch.rollout`.
      seconds: of all calls from this line.
      nstep: of a simulation, in all these calls.
      nthread: that it steps on.
      chunk: simulations that a thread takes at a time; None where the engine does not say.
      has_sensors: whether it returns sensor data of each step.
      usable_cores: of the machine.
    """

    function: str
    place: Place
    seconds: NonNegativeFloat
    nbatch: PositiveInt
    nstep: PositiveInt
    nthread: PositiveInt
    chunk: PositiveInt | None
    has_sensors: bool
    usable_cores: PositiveInt

    @property
    def idle_threads(self) -> NonNegativeInt:
        """Threads that get no chunk."""
        return max(0, self.nthread - math.ceil(self.nbatch / self.chunk)) if self.chunk else 0

    @property
    def chunk_for_all(self) -> NonNegativeInt:
        """Simulations of a chunk with which no thread is idle; 0 where there are too few."""
        return self.nbatch // self.nthread

    def sentence(self, wall_s: float) -> str:
        step = duration(1e9 * self.seconds / (self.nbatch * self.nstep))
        chunks = f", in chunks of {self.chunk}" if self.chunk and self.nthread > 1 else ""
        text = (
            f"{self.function} at {self.place} takes {plain(self.seconds, 2)} s of the program's"
            f" {plain(wall_s, 2)} s: {step} a step, of {count_of(self.nbatch, 'simulation')} ×"
            f" {count_of(self.nstep, 'step')}, on {self.nthread} of"
            f" {count_of(self.usable_cores, 'core')}{chunks}"
        )
        return ". ".join([text, *self._advice(), *self._instant()])

    @property
    def idle_sentence(self) -> str:
        smaller = f": chunk_size={self.chunk_for_all} uses all" if self.chunk_for_all else ""
        get = "gets" if self.idle_threads == 1 else "get"
        return f"{self.idle_threads} of its {self.nthread} threads {get} no chunk{smaller}"

    def _advice(self) -> Iterator[str]:
        if self.idle_threads:
            yield self.idle_sentence
        elif self.nthread < min(self.usable_cores, self.nbatch):
            threads = min(self.usable_cores, self.nbatch)
            is_batch = self.function.startswith("Batch")
            how = "Batch(…, nthread=0)" if is_batch else f"A list of {threads} MjData"
            yield f"{how} uses {threads} threads"

    def _instant(self) -> Iterator[str]:
        if self.has_sensors:
            yield "Row k of its sensor data is of the state before step k, that of states after it"


def single_calls(calls: Sequence[CallTime], usable_cores: int) -> list[SingleCall]:
    """Return the calls that step and that no loop runs, the longest first."""
    single = [of_call(call, usable_cores) for call in calls if call.loop is None]
    return sorted(filter(None, single), key=lambda each: -each.seconds)


def of_call(call: CallTime, usable_cores: int) -> SingleCall | None:
    """Return what a call comes to; None where it does not step on threads."""
    if not call.steps or call.threads is None:
        return None
    return SingleCall(
        function="rollout" if call.callee == THREADED_ROLLOUT else call.callee,
        place=call.place,
        seconds=max(0.0, call.seconds),
        nbatch=max(1, round(call.all_steps / call.steps)),
        nstep=max(1, round(call.steps)),
        nthread=max(1, call.threads.count),
        chunk=_chunk(call),
        has_sensors=call.threads.has_sensors,
        usable_cores=usable_cores,
    )


def _chunk(call: CallTime) -> int | None:
    assert call.threads is not None, "it steps on threads"
    if call.callee.startswith("Batch"):
        return None
    nbatch = round(call.all_steps / call.steps)
    usual = max(1, nbatch // (_CHUNKS_OF_THREAD * max(1, call.threads.count)))
    return call.threads.chunk_size or usual
