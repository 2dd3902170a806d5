"""What an environment asks of the engine in each of its steps, and whether a plain loop can, too.

While an environment is watched, every call that moves its simulation is repeated on another MjData:
`mj_step` from the same state of mjSTATE_INTEGRATION, with the same model, must reach the same state
to the last bit. What is written to the state between calls is noted by field, and so is every
change of the model.
"""

import functools
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mjbench.environment import engine
from mjbench.environment.model_changes import ModelChange, ModelVersions, Moment
from mjbench.loop.engine_functions import STEPPING, EngineFunction
from mjbench.simulation import agreement, compat
from mjbench.simulation.agreement import Difference
from mjbench.simulation.state_reader import StateReader

# `mj_step` does a whole step, `mj_step1` begins one, and `mj_step2` ends it.
_STEP, _BEGIN, _END = STEPPING
# Functions by which a program integrates itself.
_INTEGRATORS = ("mj_Euler", "mj_RungeKutta", "mj_implicit", "mj_implicitFast")
_WATCHED = (_STEP, _BEGIN, _END, *_INTEGRATORS)
# Callbacks of the engine that change what a step computes.
_CALLBACKS = ("passive", "control", "contactfilter", "sensor", "act_dyn", "act_gain", "act_bias")


@dataclass(frozen=True, eq=False)
class StepTrace:
    """What one step of an environment asked of the engine.

    Attributes:
      start: (nstate,) mjSTATE_INTEGRATION at the first call that ends a step, controls included.
      end: (nstate,) the state after the last such call.
      control: (nstep, nu) of every step of the engine.
      calls: functions of the engine in their order, such as `mj_step2`, with the steps that each
        takes.
      written: fields other than ctrl that were written between two calls.
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
        """Steps of the engine."""
        return len(self.control)


@dataclass(frozen=True, eq=False)
class Recording:
    """The steps of an environment, as its engine saw them.

    Attributes:
      steps: one entry per step of the environment; None for one that did not step the engine.
      checked: calls that a plain `mj_step` repeated.
      difference: the first call that it did not repeat to the last bit, and in which step of the
        environment; None without any.
      model: a copy of the one that most steps were taken with, which has this version; None where
        the engine was never stepped.
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


class EngineWatch:
    """Watches the engine's functions while an environment steps."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()
        self._versions = ModelVersions()
        self._traces: list[StepTrace | None] = []
        self._current: _OpenTrace | None = None
        self._last_data: Any = None
        self._last_row: np.ndarray | None = None
        self._plain_steps = _PlainSteps(mujoco.mj_step)
        self._obstacles: list[str] = []
        self._other_calls = False
        self._reader_of: tuple[Any, StateReader] | None = None

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch while the block runs."""
        names = engine.function_names()
        wrappers = {name: functools.partial(self._watched, name) for name in names}
        with engine.replaced(wrappers, engine.bindings()):
            yield

    def begin_episode(self) -> None:
        """Note that the environment was reset: what was written since is no input of a step."""
        self._last_row = self._last_data = None
        self._versions.moment = Moment.RESET

    def run(self, step: Callable[[], Any]) -> Any:
        """Run one step of the environment, and return its result."""
        self._current = _OpenTrace()
        try:
            outcome = step()
        finally:
            trace, self._current = self._current, None
        if trace.model is None or trace.start is None:
            self._traces.append(None)
            return outcome
        self._versions.moment = Moment.STEP
        is_same = self._versions.of(trace.model) == trace.version
        self._traces.append(trace.closed(is_same))
        return outcome

    def recording(self) -> Recording:
        """Return what was seen."""
        installed = [
            f"mjcb_{name}"
            for name in _CALLBACKS
            if getattr(mujoco, f"get_mjcb_{name}", lambda: None)() is not None
        ]
        if installed:
            self._obstacles.append(f"installs a callback of the engine, {installed[0]}")
        version, model = self._versions.most_used()
        return Recording(
            tuple(self._traces),
            self._plain_steps.checked,
            self._plain_steps.difference,
            self._versions.changes(),
            version,
            model,
            self._obstacles[0] if self._obstacles else "",
            self._other_calls,
        )

    def _watched(self, name: str, function: EngineFunction) -> EngineFunction:
        """Return the replacement of a function."""

        def call(*arguments: Any, **keywords: Any) -> Any:
            if name not in _WATCHED:
                self._other_calls |= self._current is not None
                return function(*arguments, **keywords)
            if threading.get_ident() != self._thread:
                self._obstacles.append("steps the engine in threads of its own")
                return function(*arguments, **keywords)
            if self._current is None:  # a reset, or Python that runs between steps
                return function(*arguments, **keywords)
            given = (*arguments, *keywords.values())
            model = next((a for a in given if isinstance(a, mujoco.MjModel)), None)
            data = next((a for a in given if isinstance(a, mujoco.MjData)), None)
            if model is None or data is None:
                return function(*arguments, **keywords)
            nstep = _nstep(name, arguments, keywords)
            self._before(name, nstep, model, data)
            result = function(*arguments, **keywords)
            self._after(nstep, model, data)
            return result

        return call

    def _before(self, name: str, nstep: int, model: Any, data: Any) -> None:
        """Note the state that a call begins with, and what was written since the call before."""
        trace = self._current
        assert trace is not None, "a step is being run"
        reader = self._reader(model)
        row = reader.read(model, data)
        if trace.model is None:
            trace.model, trace.version = model, self._versions.of(model)
            trace.follows = data is self._last_data
            self._versions.count()
        elif data is not self._last_data or model is not trace.model:
            self._obstacles.append("steps several simulations")
        if data is self._last_data and self._last_row is not None:
            # what was written before the first step of the engine is part of the start
            written = trace.entered if trace.start is None else trace.written
            written |= reader.differing(self._last_row, row)
        if name in _INTEGRATORS:
            self._obstacles.append(f"integrates by {name} instead of mj_step")
        if nstep:
            if trace.start is None:
                trace.start = row
            controls = row[reader.columns.get("ctrl", slice(0, 0))]
            trace.control.extend([controls] * nstep)
        trace.calls.append((name, nstep))
        self._last_row = row

    def _reader(self, model: Any) -> StateReader:
        """Return what reads the states of a model; prepared once per model."""
        if self._reader_of is None or self._reader_of[0] is not model:
            self._reader_of = (model, StateReader(model))
        return self._reader_of[1]

    def _after(self, nstep: int, model: Any, data: Any) -> None:
        """Note the state that a call ended in; repeat the call, and compare."""
        trace = self._current
        assert trace is not None and self._last_row is not None, "a step is being run"
        reader = self._reader(model)
        row = reader.read(model, data)
        if nstep:
            number = len(self._traces)
            self._plain_steps.check(reader, model, self._last_row, row, nstep, number)
            trace.end = row
        self._last_row, self._last_data = row, data


@dataclass(eq=False)
class _OpenTrace:
    """A step that is being taken; see `StepTrace`."""

    model: Any = None
    version: int = 0
    start: np.ndarray | None = None
    end: np.ndarray | None = None
    control: list[np.ndarray] = field(default_factory=list)
    calls: list[tuple[str, int]] = field(default_factory=list)
    written: set[str] = field(default_factory=set)
    entered: set[str] = field(default_factory=set)
    follows: bool = False

    def closed(self, is_same_model: bool) -> StepTrace | None:
        """Return the trace of the step, now that it is over; None where its last call failed."""
        if self.start is None or self.end is None:
            return None
        return StepTrace(
            self.version,
            self.start,
            self.end,
            np.array(self.control),
            tuple(self.calls),
            frozenset(self.written),
            frozenset(self.entered),
            self.follows,
            is_same_model,
        )


class _PlainSteps:
    """Repeats calls on an MjData of its own.

    Attributes:
      checked: calls that were repeated.
      difference: the first that differs, with the number of the environment's step.
    """

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
        """Take steps from a state, and compare with the state that the environment reached."""
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
    """Return how many steps a call ends."""
    if name == _BEGIN:
        return 0
    if name != _STEP:
        return 1
    given = [a for a in arguments if not isinstance(a, mujoco.MjModel | mujoco.MjData)]
    return int(keywords.get("nstep", given[0] if given else 1))
