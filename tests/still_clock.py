"""A clock for tests of what takes time."""

from typing import Any


class StillClock:
    """A clock that only the test moves."""

    def __init__(self, now: Any = 0) -> None:
        self.now = now

    def __call__(self) -> Any:
        return self.now

    def move(self, by: Any) -> None:
        self.now += by
