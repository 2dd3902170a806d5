"""A setting of the whole process that several blocks change at the same time, in any order."""

import os
import threading
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

Change = TypeVar("Change")


class ProcessWide(Generic[Change]):
    """The changes of a setting that are active; after the last one the setting is as before.

    Blocks in different threads need not nest: one that ends leaves the changes of the others.
    """

    def __init__(self, apply: Callable[[Sequence[Change]], None]):
        """Begin without a change; `apply` sets what active ones ask for, one call at a time."""
        self._apply = apply
        self._active: tuple[Change, ...] = ()
        self._lock = lock = threading.RLock()
        if hasattr(os, "register_at_fork"):  # a child must not inherit a lock that is taken
            os.register_at_fork(
                before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release
            )

    @property
    def active(self) -> tuple[Change, ...]:
        return self._active

    def begin(self, change: Change) -> None:
        """Make a change active, as the last one; one that cannot be applied is not active."""
        with self._lock:
            try:
                self._set((*self._active, change))
            except BaseException:
                self.end(change)
                raise

    def end(self, change: Change) -> None:
        """End a change; nothing happens if it is not active."""
        with self._lock:
            if any(each is change for each in self._active):
                self._set(tuple(each for each in self._active if each is not change))

    def _set(self, active: tuple[Change, ...]) -> None:
        self._active = active
        self._apply(active)
