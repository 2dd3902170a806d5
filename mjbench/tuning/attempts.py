"""Try settings one after the other in a child; one that ends the child costs only its own row.

Searches in C and of MJX and Warp share this: `launch` in the parent, `try_each` in the child.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVarTuple

from mjbench.errors import failure_of
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.tuning.records import Attempt
from mjbench.tuning.settings import Settings, label

_Arguments = TypeVarTuple("_Arguments")


def launch(
    task: Callable[[*_Arguments, Channel], None],
    arguments: Callable[[Sequence[Settings], float], tuple[*_Arguments]],
    settings: Sequence[Settings],
    stop_after_s: float,
    on_message: Callable[[Any], None],
    limit_s: float,
    **options: Any,
) -> None:
    """Have a task try settings in a fresh process; after one that ends it, go on in another.

    Args:
      arguments: of the task, from the settings that are left, and the seconds that are.
      on_message: called with what the task sends, and the `Attempt` of a setting that ended it.
      options: of `isolate.run`.
    """
    end_s = time.monotonic() + stop_after_s
    while True:
        given = arguments(settings, end_s - time.monotonic())
        ended = isolate.run(task, given, on_message, limit_s, **options)
        if ended.position is None:  # it ended well, or without a setting to blame
            ended.check()
            return
        on_message(Attempt(settings[ended.position], ended.status, ended.detail))
        settings = settings[ended.position + 1 :]
        if not settings:
            return


def try_each(
    settings: Sequence[Settings],
    end_s: float,
    channel: Channel,
    attempt: Callable[[Settings], Attempt],
    refusals: tuple[type[Exception], ...],
) -> None:
    """Send an `Attempt` for each setting that is begun by `end_s`, of `perf_counter`.

    Args:
      refusals: what `attempt` raises for settings that are rejected.
    """
    for number, each in enumerate(settings):
        if time.perf_counter() > end_s:
            break
        channel.doing(f"trying {label(each)}", number)
        try:
            tried = attempt(each)
        except refusals as error:
            failure = failure_of(error)
            tried = Attempt(each, failure.status, failure.detail)
        channel.send(tried)
