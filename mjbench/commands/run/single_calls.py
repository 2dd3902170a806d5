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

    def _advice(self) -> Iterator[str]:
        if self.idle_threads:
            size = self.nbatch // self.nthread
            smaller = f": chunk_size={size} uses all" if size else ""
            yield f"{self.idle_threads} of its {self.nthread} threads get no chunk{smaller}"
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
    single = [
        SingleCall(
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
        for call in calls
        if call.loop is None and call.steps and call.threads is not None
    ]
    return sorted(single, key=lambda each: -each.seconds)


def _chunk(call: CallTime) -> int | None:
    assert call.threads is not None, "it steps on threads"
    if call.callee.startswith("Batch"):
        return None
    nbatch = round(call.all_steps / call.steps)
    usual = max(1, nbatch // (_CHUNKS_OF_THREAD * max(1, call.threads.count)))
    return call.threads.chunk_size or usual
