"""When a measurement of several models is a failure as a whole: when every model failed."""

from collections.abc import Sequence
from typing import Protocol

from mjbench.errors import InputError, MachineError
from mjbench.status import Status


class Outcome(Protocol):
    """How the measurement of a model ended: a record of one."""

    @property
    def model(self) -> str:
        """Its name."""

    @property
    def status(self) -> Status:
        """How it ended."""

    @property
    def detail(self) -> str:
        """One line; empty when ok."""


def check_any(outcomes: Sequence[Outcome]) -> None:
    """Refuse outcomes without any success.

    Raises:
      InputError: the first model's cause is its input, or nothing was to be measured.
      MachineError: it is something else.
    """
    if any(outcome.status == Status.OK for outcome in outcomes):
        return
    if not outcomes:
        raise InputError("name a model")
    first = outcomes[0]
    is_input = first.status in (Status.INPUT, Status.UNAVAILABLE)
    kind = InputError if is_input else MachineError
    detail = first.detail.removeprefix(f"{first.model}: ")
    raise kind(f"{first.model}: {detail or first.status}")
