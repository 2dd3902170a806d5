"""Launches that are measured at the same time, in threads of this process."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from typing import TypeVar

from mjbench.errors import MachineError, one_line
from mjbench.paired.process_pairs import ProcessPair

_T = TypeVar("_T")


def measure(
    pairs: Sequence[ProcessPair], measure_one: Callable[[int, ProcessPair], _T]
) -> list[_T]:
    """Measure launches at the same time; return what each of them gave.

    Where one raises, or Ctrl-C is pressed, the processes of all are killed at once.

    Args:
      pairs: the processes of each launch.
      measure_one: called with the index of a launch and its processes, in a thread of its own.

    Raises:
      MachineError: no thread can be started.
      Exception: what `measure_one` raised first.
    """
    with ThreadPoolExecutor(len(pairs)) as executor:
        measured: list[Future[_T]] = []
        try:
            for i, pair in enumerate(pairs):
                measured.append(_submit(executor, measure_one, i, pair))
            return _results(measured)
        except BaseException:  # such as Ctrl-C: what waits for a process is not to wait longer
            for pair in pairs:
                for process in pair.processes:
                    process.kill()
            raise


def _submit(
    executor: ThreadPoolExecutor,
    measure_one: Callable[[int, ProcessPair], _T],
    index: int,
    pair: ProcessPair,
) -> "Future[_T]":
    try:
        return executor.submit(measure_one, index, pair)
    except RuntimeError as error:
        raise MachineError(f"cannot start a thread: {one_line(error)}") from error


def _results(measured: Sequence["Future[_T]"]) -> list[_T]:
    """Wait for launches; raise the error of the first that fails, not waiting for the others."""
    finished, _ = wait(measured, return_when=FIRST_EXCEPTION)
    for launch in finished:
        launch.result()
    return [launch.result() for launch in measured]
