"""Launch targets until a stop rule has enough: the one loop of launches.

A launch is a fresh process, or one for each of two sides, which measures some of the targets once.
`verdict` launches a baseline and a candidate, `race` ways of stepping, and `env.vectors` vectorised
forms.
"""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from mjbench.errors import Failure, MachineError
from mjbench.paired.time_limit import ENDING_ERRORS, ending_of
from mjbench.status import Status

LaunchT = TypeVar("LaunchT")


class UnableError(MachineError):
    """A target cannot go on: it cannot run, ended its process, or returned something wrong."""

    def __init__(self, position: int, status: Status, detail: str):
        super().__init__(detail)
        self.position, self.status, self.detail = position, status, detail


class Targets(ABC, Generic[LaunchT]):
    """What is launched; each target has a position."""

    def prepare(self) -> None:
        """Do what comes before the first launch; see `launch` for what this may raise."""

    @abstractmethod
    def launch(self, positions: Sequence[int]) -> LaunchT:
        """Measure the targets at these positions once, in fresh processes.

        Raises:
          UnableError: one of them cannot go on, but others can.
          InputError: none can.
          MachineError: a process crashed, hung or failed.
          OutOfTimeError: the time limit does not allow it.
        """

    def close(self) -> None:
        """End processes and remove files that are left."""


class StopRule(ABC, Generic[LaunchT]):
    """Which targets are launched next; it keeps what launches gave."""

    @abstractmethod
    def next_targets(self) -> Sequence[int]:
        """Return the positions of the targets of the next launch; none to end.

        Raises:
          OutOfTimeError: the time limit allows none, and there is no answer yet.
        """

    @abstractmethod
    def add(self, launch: LaunchT) -> None:
        """Take a launch into account."""

    def withdraw(self, error: UnableError) -> None:
        """Go on without a target; raise the error where nothing can be measured without it."""
        raise error


def launch(
    targets: Targets[LaunchT], rule: StopRule[LaunchT], on_launch: Callable[[], None] = lambda: None
) -> Failure:
    """Launch targets until a rule ends it, something fails, time is up, or Ctrl-C is pressed.

    A failure to close the targets hides neither an earlier failure nor a fault of the program.

    Args:
      on_launch: called after each launch, when the rule has taken it into account; what it raises
        ends the launches as their own errors do.

    Returns:
      How it ended: `OK` with an empty line where the rule ended it.
    """
    ended: BaseException | None = None
    try:
        _launch_all(targets, rule, on_launch)
    except ENDING_ERRORS as error:
        ended = error
    except BaseException:
        with contextlib.suppress(*ENDING_ERRORS):
            targets.close()
        raise
    try:
        targets.close()
    except ENDING_ERRORS as error:
        if ended is None or isinstance(error, KeyboardInterrupt):
            ended = error
    return Failure(Status.OK, "") if ended is None else ending_of(ended)


def _launch_all(
    targets: Targets[LaunchT], rule: StopRule[LaunchT], on_launch: Callable[[], None]
) -> None:
    targets.prepare()
    while positions := rule.next_targets():
        try:
            rule.add(targets.launch(positions))
        except UnableError as error:
            rule.withdraw(error)
        on_launch()
