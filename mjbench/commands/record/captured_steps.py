"""Record the steps of a program for `capture`: count them all, and store the states of some.

Models are distinguished by their layout (see `capture_header`): a program that compiles its model
anew for each episode, or changes its masses, steps one model here.
"""

import collections
import contextlib
import functools
import itertools
import operator
import random
import tempfile
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any, Generic, TypeVar

import mujoco
import numpy as np

from mjbench.errors import failure_of
from mjbench.simulation import compat
from mjbench.simulation.agreement import StateReader
from mjbench.simulation.capture_header import ModelLayout, model_name
from mjbench.simulation.engine_functions import EngineFunction
from mjbench.simulation.model_digest import model_digest

# Bytes that the states of one model may take up; fewer are kept of a model with large states.
MAX_BYTES = 100_000_000
# Models whose states are kept at the same time; the steps of further ones are only counted.
MAX_MODELS = 16
# A window ends when its MjData took no step during so many steps of others.
_PATIENCE_NSTEP = 100_000
_SEED = 0
# Fields of mjSTATE_INTEGRATION that steps change: a program that sets one begins a new segment.
_MOVED = frozenset(("time", "qpos", "qvel", "act", "history", "plugin_state", "plastic"))
# If a step takes another time than the timestep, by more than this share, the engine was reset.
_TIME_SHARE = 0.5


_Window = TypeVar("_Window")


class RecordedWindow:
    """A piece of a program's run: the states of one MjData over some of its steps.

    A *segment* is a state and those after each further step. A replay from one of these states,
    with the controls of those that follow, repeats the program to the last bit, as long as the
    program sets only controls between its steps. If it changes the state itself, as by a reset, a
    new segment begins. If it sets another input, such as a force, the segment goes on, and
    `changed_inputs` names the MjData field.
    """

    def __init__(
        self, reader: StateReader, model: mujoco.MjModel, data: mujoco.MjData, most_states: int
    ):
        self.digest = model_digest(model)
        self._reader = reader
        self._get_state = mujoco.mj_getState
        self._timestep = float(model.opt.timestep)
        self._data = weakref.ref(data)  # the program decides how long it lives
        self.changed_inputs: set[str] = set()
        self._states = np.empty((most_states, reader.nstate))
        self._count = 0
        self._begins: list[int] = []  # of segments, as rows of the states
        self._before = np.empty(reader.nstate)
        self._last: np.ndarray | None = None

    @property
    def data(self) -> mujoco.MjData | None:
        """The one that is followed; None where the program has dropped it."""
        return self._data()

    def follows(self, data: mujoco.MjData) -> bool:
        """Return whether this is the one that is followed, and there is room for another state."""
        return self._data() is data and self._count < len(self._states)

    def step(
        self, function: EngineFunction, model: mujoco.MjModel, data: mujoco.MjData, nstep: int
    ) -> int:
        before, last, spec = self._before, self._last, self._reader.spec
        self._get_state(model, data, before, spec)
        if last is None or self._is_elsewhere(before, last):
            self._begins.append(self._count)
            self._states[self._count] = before
            self._count += 1
        self._last = None  # and stays so where a step raises
        for taken in range(1, nstep + 1):
            begin_s = data.time
            function(model, data)
            if abs(data.time - begin_s - self._timestep) > _TIME_SHARE * self._timestep:
                return taken  # the engine started the simulation anew, from a bad state
            if self._count == len(self._states):
                return taken
            after = self._states[self._count]
            self._get_state(model, data, after, spec)
            self._count += 1
        self._last = after
        return nstep

    def _is_elsewhere(self, before: np.ndarray, last: np.ndarray) -> bool:
        """Return whether the program has changed the state since the last step; note inputs."""
        changed = self._reader.differing(before, last)
        if changed & _MOVED:
            return True
        self.changed_inputs |= changed
        return False

    def segments(self) -> list[np.ndarray]:
        """Return (count, nstate) states of each segment that has a step.

        A segment ends before a state that is not finite; the engine may be set to continue from it.
        """
        segments = []
        for begin, end in itertools.pairwise([*self._begins, self._count]):
            states = self._states[begin:end]
            is_bad = ~np.isfinite(states).all(axis=1)
            finite = states[: int(is_bad.argmax())] if is_bad.any() else states
            if len(finite) > 1:
                segments.append(finite)
        return segments


class WindowSample(Generic[_Window]):
    """A bounded number of windows, spread evenly over a run of unknown length.

    The run is divided into strata of `stride` steps. A stratum has at most one window, which begins
    at a random step of it: windows at fixed distances would always meet the same part of an
    episode. When there are too many, neighbouring strata become one, which keeps one of its two
    windows, at random, and the stride doubles. So at any time windows lie everywhere in the run
    with equal density.

    Attributes:
      due: step of the run at which the next window is to begin.
    """

    def __init__(self, most: int, nstep: int, rng: random.Random):
        self._most, self._nstep, self._rng = most, nstep, rng
        self._by_stratum: dict[int, _Window] = {}
        self.stride = nstep
        self.due = 0

    def add(self, window: _Window, end: int) -> None:
        """Take the window that was due and ended at a step, and decide when the next is due."""
        self._by_stratum[self.due // self.stride] = window
        while len(self._by_stratum) > self._most:
            self.stride *= 2
            merged: dict[int, _Window] = {}
            for stratum, sampled in sorted(self._by_stratum.items()):
                if stratum // 2 not in merged or self._rng.random() < 0.5:
                    merged[stratum // 2] = sampled
            self._by_stratum = merged
        stratum = max(self.due // self.stride + 1, end // self.stride)
        room = self.stride - self._nstep
        while (due := stratum * self.stride + self._rng.randint(0, room)) < end:
            stratum += 1
        self.due = due

    def windows(self) -> list[_Window]:
        return [self._by_stratum[stratum] for stratum in sorted(self._by_stratum)]


class ModelRecorder:
    """Takes the steps of one model, and stores states of some of them.

    Attributes:
      mjb: file with the model before its first step; None unless it is wanted and can be saved.
      nstep: that the program took, of what is to be captured.
    """

    def __init__(
        self, model: mujoco.MjModel, max_states: int, window_nstep: int, with_mjb: bool = False
    ):
        self.mjb: IO[bytes] | None = None
        self.mjb_failure = ""
        if with_mjb:
            try:
                self.mjb = _saved(model)
            except Exception as error:  # this is inside a step of the program, which goes on
                self.mjb_failure = failure_of(error).detail
        self.name, self.layout = model_name(model), ModelLayout.of(model)
        self.timestep_s = float(model.opt.timestep)
        self.reader = StateReader(model)
        self.nstep = 0
        most = max(2, min(max_states, MAX_BYTES // (8 * self.reader.nstate)))
        self._window_states = min(window_nstep + 1, most)
        self._sample: WindowSample[RecordedWindow] = WindowSample(
            most // self._window_states, self._window_states - 1, random.Random(_SEED)
        )
        self._window: RecordedWindow | None = None
        self._followed_at = 0
        self._lock = threading.Lock()

    def close(self) -> None:
        if self.mjb is not None:
            self.mjb.close()

    def windows(self) -> list[RecordedWindow]:
        if self._window is not None:
            self._end_window()
        return self._sample.windows()

    def take(
        self, function: EngineFunction, model: mujoco.MjModel, data: mujoco.MjData, nstep: int
    ) -> None:
        """Have `mj_step`, or `mj_step2`, take steps, one by one while a window follows them."""
        while nstep > 0:
            window = self._window
            if window is None or not window.follows(data):
                window = self._window_of(model, data)
            if window is not None:
                taken = window.step(function, model, data, nstep)
                self.nstep += taken
                self._followed_at = self.nstep
                nstep -= taken
                continue
            unseen = nstep
            if self._window is None:  # up to where the next one begins
                unseen = min(nstep, max(1, self._sample.due - self.nstep))
            function(model, data, *([unseen] if unseen > 1 else []))
            self.nstep += unseen
            nstep -= unseen

    def _window_of(self, model: mujoco.MjModel, data: mujoco.MjData) -> RecordedWindow | None:
        """Return the window that begins now; None where none is due, or another goes on."""
        # Waiting could block a forked child for ever; a step that is not followed is only missed.
        if not self._lock.acquire(blocking=False):
            return None
        try:
            if self._window is not None:
                # it is gone, or full, or of no use
                is_over = self._window.data in (None, data)
                if not is_over and self.nstep - self._followed_at < _PATIENCE_NSTEP:
                    return None
                self._end_window()
            if self.nstep < self._sample.due:
                return None
            self._window = RecordedWindow(self.reader, model, data, self._window_states)
            self._followed_at = self.nstep
            return self._window
        finally:
            self._lock.release()

    def _end_window(self) -> None:
        assert self._window is not None, "a window is open"
        window, self._window = self._window, None
        self._sample.add(window, self.nstep)


def _saved(model: mujoco.MjModel) -> IO[bytes]:
    """Return a temporary file with a model, as `mj_saveModel` writes it.

    It has no name, so it is gone when this process is, however it ends.
    """
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    with contextlib.ExitStack() as on_error:
        file = on_error.enter_context(tempfile.TemporaryFile(buffering=0))
        rest = content.data
        while rest:
            rest = rest[file.write(rest) :]
        on_error.pop_all()
    return file


class StepRecorder:
    """The replacements of MuJoCo's stepping functions, and what they have seen.

    Up to `max_states` of each model are stored. With `model`, only that and those with its digest
    are captured; with `data`, only that.
    """

    def __init__(
        self,
        max_states: int,
        window_nstep: int,
        model: mujoco.MjModel | None = None,
        data: mujoco.MjData | None = None,
        with_mjb: bool = False,
    ):
        self._max_states, self._window_nstep = max_states, window_nstep
        self._digest = None if model is None else model_digest(model)
        self._data, self._with_mjb = data, with_mjb
        self._by_layout: dict[tuple[str, ModelLayout, int], ModelRecorder] = {}
        # by the identity of the MjModel, as long as that lives; None for one that is not captured
        self._by_identity: dict[int, tuple[ModelRecorder | None, weakref.ref[mujoco.MjModel]]] = {}
        # steps that were not captured, by the name of their model
        self.other_nstep: collections.Counter[str] = collections.Counter()

    def models(self) -> list[ModelRecorder]:
        """Return the models that were captured, the one that took most steps first."""
        seen = [recorder for recorder in self._by_layout.values() if recorder.nstep]
        return sorted(seen, key=lambda recorder: -recorder.nstep)

    def close(self) -> None:
        for recorder in self._by_layout.values():
            recorder.close()

    def wrappers(self) -> Mapping[str, Callable[[EngineFunction], EngineFunction]]:
        """Return what makes the replacements, by function; mj_step1 takes no step of its own."""
        return {
            "mj_step": functools.partial(self._wrap, ("m", "d", "nstep")),
            "mj_step2": functools.partial(self._wrap, ("m", "d")),
        }

    def _wrap(self, names: Sequence[str], function: EngineFunction) -> EngineFunction:
        by_identity, only_data = self._by_identity, self._data

        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            if len(args) == 2 and not keywords:  # the usual form first: this is called every step
                (model, data), nstep = args, 1
            else:
                arguments = _arguments(names, args, keywords)
                if arguments is None:  # MuJoCo says what is wrong with them
                    return function(*args, **keywords)
                model, data, nstep = arguments
            try:
                recorder, _ = by_identity[id(model)]
            except KeyError:
                recorder = self._recorder_of(model)
            if recorder is None or (only_data is not None and data is not only_data):
                result = function(*args, **keywords)
                self.other_nstep[model_name(model)] += nstep
                return result
            if recorder._window is None and recorder.nstep + nstep <= recorder._sample.due:
                result = function(*args, **keywords)
                recorder.nstep += nstep
                return result
            if not isinstance(data, mujoco.MjData):
                return function(*args, **keywords)
            return recorder.take(function, model, data, nstep)

        return call

    def _recorder_of(self, model: mujoco.MjModel) -> ModelRecorder | None:
        if not isinstance(model, mujoco.MjModel):
            return None
        recorder = None
        if model.nv and self._digest in (None, model_digest(model)):
            recorder = self._of_layout(model)
        identity = id(model)
        # Another MjModel may get the identity. A function of C forgets it: Python drops what is
        # raised in such a callback, and a signal handler may run in one of Python.
        reference = weakref.ref(model, functools.partial(self._by_identity.pop, identity))
        return self._by_identity.setdefault(identity, (recorder, reference))[0]

    def _of_layout(self, model: mujoco.MjModel) -> ModelRecorder | None:
        nstate = compat.state_size(model)
        key = model_name(model), ModelLayout.of(model), nstate
        if key not in self._by_layout and len(self._by_layout) < MAX_MODELS:
            recorder = ModelRecorder(model, self._max_states, self._window_nstep, self._with_mjb)
            # without a lock, which a forked child could wait for: another thread may be first
            if self._by_layout.setdefault(key, recorder) is not recorder:
                recorder.close()
        return self._by_layout.get(key)


def _arguments(
    names: Sequence[str], args: tuple[Any, ...], keywords: Mapping[str, Any]
) -> tuple[mujoco.MjModel, mujoco.MjData, int] | None:
    given = {**dict(zip(names, args, strict=False)), **keywords}
    if len(args) + len(keywords) != len(given) or not {"m", "d"} <= given.keys() <= set(names):
        return None
    try:
        nstep = operator.index(given.get("nstep", 1))
    except TypeError:
        return None
    return (given["m"], given["d"], nstep) if nstep > 0 else None
