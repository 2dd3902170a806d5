"""Notice other mjbench that measure on this machine at the same time: they disturb each other.

They are found by their command lines, at the beginning and at the end of a measurement. A process
of another user that the system hides is not noticed, nor is a program that imports mjbench.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from mjbench.errors import one_line

# Environment variable with which no other mjbench is noticed; the tests set it.
IGNORE_VARIABLE = "MJBENCH_IGNORE_OTHERS"
# Commands that measure nothing themselves.
_QUIET = frozenset({"lint", "models", "paths", "releases", "show", "sweep"})
# How often a process that waits looks again, in seconds.
_POLL_S = 1.0


@dataclass(frozen=True)
class Neighbour:
    """Another process that measures.

    Attributes:
      command: its command, or the target of a check-up.
    """

    pid: int
    command: str


def describe(others: Sequence[Neighbour]) -> str:
    return ", ".join(f"mjbench {other.command}, process {other.pid}" for other in others)


def measuring_now() -> list[Neighbour]:
    """Return the other mjbench that measure now; those that wait for this one do not."""
    if os.environ.get(IGNORE_VARIABLE):
        return []
    return select(psutil.process_iter(["cmdline", "create_time"]), psutil.Process())


def select(processes: Iterable[psutil.Process], me: psutil.Process) -> list[Neighbour]:
    """Return which processes are other mjbench that measure.

    One with --wait that began later is left out: it waits for this one, which must not wait for it.
    """
    others = []
    is_noticed = bool(mjbench_words(me.cmdline()))  # a program that imports mjbench is not
    for process in processes:
        words = mjbench_words(process.info["cmdline"] or [])
        began = (process.info["create_time"] or 0.0, process.pid)
        waits_for_me = is_noticed and "--wait" in words and began > (me.create_time(), me.pid)
        if words and process.pid != me.pid and not waits_for_me:
            others.append(Neighbour(process.pid, one_line(words[0], limit=40)))
    return others


def mjbench_words(command_line: Sequence[str]) -> list[str]:
    """Return the words after `mjbench` in a process's command line; none where it measures nothing.

    It is `mjbench …`, `python …/bin/mjbench …` or `python -m mjbench …`.
    """
    words = list(command_line)
    if words and "python" in Path(words[0]).name.lower():
        words = list(itertools.dropwhile(lambda word: word.startswith("-"), words[1:]))
    if not words or Path(words[0]).name != "mjbench" or len(words) == 1:
        return []
    return [] if words[1] in _QUIET or words[1].startswith("-") else words[1:]


def wait_for_others(
    on_wait: Callable[[Sequence[Neighbour]], None],
    look: Callable[[], Sequence[Neighbour]] = measuring_now,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Wait until no other mjbench measures; say for which, if any."""
    others = look()
    if others:
        on_wait(others)
    while others:
        sleep(_POLL_S)
        others = look()
