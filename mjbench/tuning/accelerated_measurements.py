"""What a search for settings of MJX or Warp asks for: C's runs, and attempts in fresh processes."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from mjbench.comparison.accelerated_run import CHILD_MEMORY_SHARE
from mjbench.errors import UnavailableError
from mjbench.instrument import isolate, machine
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths.accelerated import accelerated_path
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.tuning.accelerated_attempts import (
    EngineBaselineRequest,
    LaunchRequest,
    Unsuited,
)
from mjbench.tuning.records import Attempt, BatchFacts, Program
from mjbench.tuning.reference import TrialPlan
from mjbench.tuning.settings import Setting

Settings = tuple[Setting, ...]


class EngineOnThisMachine:
    """Measures an engine on one model here; its files last as long as the pool."""

    def __init__(
        self, pool: WorkerPool, source: ModelSource, engine: str, nbatch: int, limit_s: float
    ):
        """Measure nothing yet.

        Args:
          limit_s: seconds of silence after which a process is killed; compilers get more.
        """
        self._source = ModelSource(source.name, source.path.resolve())
        self._engine, self._nbatch, self._limit_s = engine, nbatch, limit_s
        self._file: Path = pool.new_file(".pickle")

    def baseline(self, plan: TrialPlan) -> BatchFacts:
        """Draw trials and run C; launches use them from then on.

        Raises:
          InputError: the model cannot be loaded, diverges, or is not for this engine.
          MachineError: its process crashed or hung.
        """
        messages: list[BatchFacts] = []
        request = EngineBaselineRequest(self._source, self._engine, plan, self._nbatch, self._file)
        self._run("run_baseline", request, messages.append).check()
        return messages[0]

    def launch(
        self,
        settings: Sequence[Settings],
        on_attempt: Callable[[Attempt], None],
        stop_after_s: float | None = None,
        has_errors: bool = True,
    ) -> Program:
        """Try settings, one after the other, in a fresh process; return the present program.

        A setting that ends the process fails, no more.

        Args:
          stop_after_s: seconds after which no other is begun; None for no limit.
          has_errors: whether to measure transfer errors, beside times.

        Raises:
          UnavailableError: the model is not for this engine.
          MachineError: the present settings crash, hang or diverge.
        """
        programs: list[Program] = []

        def receive(message: Program | Attempt) -> None:
            if isinstance(message, Program):
                programs.append(message)
            else:
                on_attempt(message)

        end_s = time.monotonic() + (float("inf") if stop_after_s is None else stop_after_s)
        first = 0
        while True:
            request = LaunchRequest(
                self._source,
                self._engine,
                self._file,
                tuple(settings),
                first,
                self._nbatch,
                has_errors,
                end_s - time.monotonic(),
                self._limit_s,
            )
            ended = self._run("run_launch", request, receive)
            if ended.status == Status.OK:
                return programs[0]
            if ended.activity is None or ended.activity.index is None:
                ended.check()
                raise AssertionError("an end that is not ok raises")
            first = ended.activity.index + 1
            on_attempt(Attempt(settings[first - 1], ended.status, ended.detail))
            if first == len(settings):
                return programs[0]

    def _run(self, task: str, request: object, on_message: Callable[..., None]) -> isolate.Ended:
        """Run a task of `accelerated_attempts` in a child, within limits of time and memory."""

        def receive(message: object) -> None:
            if isinstance(message, Unsuited):
                raise UnavailableError(message.reason)
            on_message(message)

        return isolate.run(
            f"mjbench.tuning.accelerated_attempts:{task}",
            request,
            receive,
            self._limit_s,
            environment=accelerated_path(self._engine).environment(),
            memory_bytes=int(CHILD_MEMORY_SHARE * machine.available_memory_bytes()),
        )
