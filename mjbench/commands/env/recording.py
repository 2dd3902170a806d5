"""What an environment asks of the engine in each of its steps, and whether a plain loop can, too.

While an environment is watched, every call that moves its simulation is repeated on another MjData:
`mj_step` from the same state of mjSTATE_INTEGRATION, with the same model, must reach the same state
to the last bit. What is written to the state between calls is noted by field, and so is every
change of the model.
"""

import collections
import copy
import functools
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeInt
from mjbench.simulation import agreement, compat, engine_functions
from mjbench.simulation.agreement import Difference, StateReader
from mjbench.simulation.engine_functions import STEPPING, EngineFunction
from mjbench.simulation.model_guard import ModelGuard

# `mj_step` does a whole step, `mj_step1` begins one, and `mj_step2` ends it.
_STEP, _BEGIN, _END = STEPPING
# Functions by which a program integrates itself.
_INTEGRATORS = ("mj_Euler", "mj_RungeKutta", "mj_implicit", "mj_implicitFast")
_WATCHED = (_STEP, _BEGIN, _END, *_INTEGRATORS)
# Callbacks of the engine that change what a step computes.
_CALLBACKS = ("passive", "control", "contactfilter", "sensor", "act_dyn", "act_gain", "act_bias")


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
    count: NonNegativeInt


@dataclass(frozen=True, eq=False)
class StepTrace:
    """What one step of an environment asked of the engine.

    Attributes:
      start, end: (nstate,) mjSTATE_INTEGRATION at the first call that ends a step, controls
        included, and after the last such call.
      control: (nstep, nu) of every step of the engine.
      calls: functions of the engine in their order, with the steps that each takes.
      entered, written: fields other than ctrl that were written before the first call that ends a
        step, and between later calls.
      follows: whether the step before was of the same episode and the same simulation.
      is_same_model: whether the model was the same at the end of the environment's step.
    """

    version: int
    start: np.ndarray
    end: np.ndarray
    control: np.ndarray
    calls: tuple[tuple[str, int], ...]
    written: frozenset[str]
    entered: frozenset[str]
    follows: bool
    is_same_model: bool

    @property
    def nstep(self) -> int:
        return len(self.control)


@dataclass(frozen=True, eq=False)
class Recording:
    """The steps of an environment, as its engine saw them.

    Attributes:
      steps: one entry per step of the environment; None for one that did not step the engine.
      checked: calls that a plain `mj_step` repeated.
      difference: the first call that it did not repeat to the last bit, and in which step.
      model: a copy of the one that most steps were taken with, which has this version.
      obstacle: why no plain loop can do the same, in one line; empty where one can.
    """

    steps: Sequence[StepTrace | None]
    checked: int
    difference: tuple[int, Difference] | None
    changes: Sequence[ModelChange]
    version: int
    model: mujoco.MjModel | None
    obstacle: str
    other_calls: bool


@dataclass(frozen=True, eq=False)
class _Call:
    name: str
    nstep: int
    before: np.ndarray
    after: np.ndarray


@dataclass(eq=False)
class _OpenStep:
    model: Any = None
    data: Any = None
    reader: StateReader | None = None
    version: int = 0
    calls: list[_Call] = field(default_factory=list)


class EngineWatch:
    """Watches the engine's functions while an environment steps."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()
        self._versions = _ModelVersions()
        self._traces: list[StepTrace | None] = []
        self._current: _OpenStep | None = None
        self._last_data: Any = None
        self._last_row: np.ndarray | None = None
        self._plain_steps = _PlainSteps(mujoco.mj_step)
        self._obstacles: list[str] = []
        self._other_calls = False
        self._reader_of: tuple[Any, StateReader] | None = None

    @contextmanager
    def watching(self) -> Iterator[None]:
        names = engine_functions.names()
        wrappers = {name: functools.partial(self._watched, name) for name in names}
        with engine_functions.replaced(wrappers, engine_functions.bindings()):
            yield

    def begin_episode(self) -> None:
        """Note that the environment was reset: what was written since is no input of a step."""
        self._last_row = self._last_data = None
        self._versions.moment = Moment.RESET

    def run(self, step: Callable[[], Any]) -> Any:
        current = self._current = _OpenStep()
        try:
            outcome = step()
        finally:
            self._current = None
        self._traces.append(self._trace(current))
        if current.calls:
            self._last_data, self._last_row = current.data, current.calls[-1].after
        return outcome

    def _trace(self, step: _OpenStep) -> StepTrace | None:
        ending = [i for i, call in enumerate(step.calls) if call.nstep]
        if not ending:
            return None
        assert step.reader is not None, "it is that of the first call"
        follows = step.data is self._last_data
        afters = [self._last_row if follows else None, *(call.after for call in step.calls)]
        written = [
            set() if after is None else step.reader.differing(after, call.before)
            for after, call in zip(afters, step.calls, strict=False)
        ]
        controls = step.reader.columns.get("ctrl", slice(0, 0))
        self._versions.moment = Moment.STEP
        return StepTrace(
            version=step.version,
            start=step.calls[ending[0]].before,
            end=step.calls[ending[-1]].after,
            control=np.array(
                [call.before[controls] for call in step.calls for _ in range(call.nstep)]
            ),
            calls=tuple((call.name, call.nstep) for call in step.calls),
            entered=frozenset().union(*written[: ending[0] + 1]),
            written=frozenset().union(*written[ending[0] + 1 :]),
            follows=follows,
            is_same_model=self._versions.of(step.model) == step.version,
        )

    def recording(self) -> Recording:
        installed = [
            f"mjcb_{name}"
            for name in _CALLBACKS
            if getattr(mujoco, f"get_mjcb_{name}", lambda: None)() is not None
        ]
        if installed:
            self._obstacles.append(f"installs a callback of the engine, {installed[0]}")
        return Recording(
            tuple(self._traces),
            self._plain_steps.checked,
            self._plain_steps.difference,
            self._versions.changes(),
            *self._versions.most_used,
            self._obstacles[0] if self._obstacles else "",
            self._other_calls,
        )

    def _watched(self, name: str, function: EngineFunction) -> EngineFunction:
        def call(*arguments: Any, **keywords: Any) -> Any:
            if name not in _WATCHED:
                self._other_calls |= self._current is not None
                return function(*arguments, **keywords)
            if threading.get_ident() != self._thread:
                self._obstacles.append("steps the engine in threads of its own")
                return function(*arguments, **keywords)
            given = (*arguments, *keywords.values())
            model = next((a for a in given if isinstance(a, mujoco.MjModel)), None)
            data = next((a for a in given if isinstance(a, mujoco.MjData)), None)
            # a reset, or Python that runs between steps, is no step
            if self._current is None or not self._begin_call(self._current, name, model, data):
                return function(*arguments, **keywords)
            reader, nstep = self._reader(model), _nstep(name, arguments, keywords)
            before = reader.read(model, data)
            result = function(*arguments, **keywords)
            after = reader.read(model, data)
            if nstep:
                number = len(self._traces)
                self._plain_steps.check(reader, model, before, after, nstep, number)
            self._current.calls.append(_Call(name, nstep, before, after))
            return result

        return call

    def _begin_call(self, step: _OpenStep, name: str, model: Any, data: Any) -> bool:
        """Return whether a call is recorded; note what no plain loop can do."""
        if model is None or data is None:
            return False
        if step.model is None:
            step.model, step.data, step.reader = model, data, self._reader(model)
            step.version = self._versions.of(model)
            self._versions.count()
        if data is not step.data or model is not step.model:
            self._obstacles.append("steps several simulations")
            return False
        if name in _INTEGRATORS:
            self._obstacles.append(f"integrates by {name} instead of mj_step")
        return True

    def _reader(self, model: Any) -> StateReader:
        if self._reader_of is None or self._reader_of[0] is not model:
            self._reader_of = (model, StateReader(model))
        return self._reader_of[1]


class _ModelVersions:
    """Numbers the contents that a model has had; `most_used` has a number, and a copy."""

    def __init__(self) -> None:
        self.moment = Moment.RESET
        self.most_used: tuple[int, Any] = (0, None)
        self._most_uses = self._uses = self._number = 0
        self._guard: ModelGuard | None = None
        self._copy: Any = None
        self._changes: collections.Counter[tuple[str, Moment]] = collections.Counter()

    def of(self, model: Any) -> int:
        if self._guard is not None:
            changed = self._guard.difference(model)
            if changed is None:
                return self._number
            self._changes[changed, self.moment] += 1
            self._number += 1
        self._guard, self._copy, self._uses = ModelGuard(model), copy.copy(model), 0
        return self._number

    def count(self) -> None:
        self._uses += 1
        if self._uses > self._most_uses:
            self._most_uses, self.most_used = self._uses, (self._number, self._copy)

    def changes(self) -> list[ModelChange]:
        return [ModelChange(*key, count) for key, count in self._changes.most_common()]


class _PlainSteps:
    def __init__(self, step: EngineFunction):
        self.checked = 0
        self.difference: tuple[int, Difference] | None = None
        self._step, self._needs_reset = step, False
        self._model: Any = None
        self._data: Any = None

    def check(
        self,
        reader: StateReader,
        model: Any,
        before: np.ndarray,
        after: np.ndarray,
        nstep: int,
        number: int,
    ) -> None:
        if model is not self._model:
            self._model, self._data = model, mujoco.MjData(model)
            self._needs_reset = compat.has_sleep(model)
        if self._needs_reset:
            mujoco.mj_resetData(model, self._data)
        compat.set_state(model, self._data, before, reader.spec)
        self._step(model, self._data, nstep)
        reached = reader.read(model, self._data)
        self.checked += 1
        if self.difference is None:
            difference = agreement.first_differing_entry(after[None], reached[None], reader.columns)
            if difference is not None:
                self.difference = (number, difference)


def _nstep(name: str, arguments: Sequence[Any], keywords: Mapping[str, Any]) -> int:
    if name == _BEGIN:
        return 0
    if name != _STEP:
        return 1
    given = [a for a in arguments if not isinstance(a, mujoco.MjModel | mujoco.MjData)]
    return int(keywords.get("nstep", given[0] if given else 1))
