"""Which changes an environment makes to its model, and which content most steps were taken with."""

import collections
import copy
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from mjbench.simulation.model_guard import ModelGuard


class Moment(StrEnum):
    """When an environment changes its model."""

    RESET = "by a reset"
    STEP = "between steps"


@dataclass(frozen=True)
class ModelChange:
    """A change of the model that an environment makes.

    Attributes:
      field: the first one that differs, such as `opt.gravity`.
    """

    field: str
    moment: Moment
    count: int


class ModelVersions:
    """Numbers the contents that an environment's model has had."""

    def __init__(self) -> None:
        self.moment = Moment.RESET
        self._guard: ModelGuard | None = None
        self._changes: collections.Counter[tuple[str, Moment]] = collections.Counter()
        self._number, self._used = 0, 0
        self._copy: Any = None
        self._best: tuple[int, int, Any] = (0, 0, None)

    def of(self, model: Any) -> int:
        """Return the number of a model's content; note a change."""
        if self._guard is not None:
            changed = self._guard.difference(model)
            if changed is None:
                return self._number
            self._changes[changed, self.moment] += 1
            self._number += 1
        self._close()
        self._guard, self._copy, self._used = ModelGuard(model), copy.copy(model), 0
        return self._number

    def count(self) -> None:
        """Count a step with the current content."""
        self._used += 1

    def _close(self) -> None:
        if self._copy is not None and self._used > self._best[0]:
            self._best = (self._used, self._number - 1, self._copy)

    def most_used(self) -> tuple[int, Any]:
        """Return the number of the content that most steps were taken with, and a copy of it."""
        if self._used > self._best[0]:
            return self._number, self._copy
        return self._best[1:]

    def changes(self) -> list[ModelChange]:
        """Return the changes so far, the most frequent first."""
        return [ModelChange(*key, count) for key, count in self._changes.most_common()]
