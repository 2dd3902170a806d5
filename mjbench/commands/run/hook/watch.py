"""What only a run shows: warnings, shared simulations, memory, and states of the models."""

import json
import mmap
import os
import sys
import time
from _thread import get_ident
from collections.abc import Callable
from types import FrameType, ModuleType
from typing import Any

from .call_clock import COPIED_ENVIRONMENT, HALVES, IN_TURN, SHARED_DATA, WARNING, CallClock
from .function_replacement import named_like, suppress

# States of a model that are noted, to measure other calls on; models, and bytes of one.
MAX_STATES, MAX_MODELS, MAX_MODEL_BYTES = 8, 4, 64 << 20
# Between two looks at the memory of the process and the state of the simulation.
LOOK_NS = 100_000_000


class SpreadStates:
    """States of a model at equal distances, from the first offered to the last."""

    def __init__(self, path: str) -> None:
        self._path, self._states = path, list[bytes]()
        self._offered, self._every = 0, 1

    def is_due(self) -> bool:
        """Count a state that is offered; return whether to keep it."""
        number = self._offered
        self._offered += 1
        if number % self._every == 0 and len(self._states) == MAX_STATES:
            del self._states[1::2]
            self._every *= 2
        return number % self._every == 0

    def keep(self, state: bytes) -> None:
        """Write a state beside the others."""
        self._states.append(state)
        _write_whole(self._path, b"".join(self._states))


class Watch:
    """Looks at the simulations of this process while they are stepped."""

    def __init__(
        self, folder: str, calls: CallClock, now_ns: Callable[[], int] = time.perf_counter_ns
    ) -> None:
        self._folder, self._calls, self._now_ns = folder, calls, now_ns
        self.begin_process()

    def begin_process(self) -> None:
        self._active: dict[int, int] = {}  # thread by the MjData that it steps
        self._warnings: dict[int, list[int]] = {}
        # number by model, and its states by kind; None for a model that is too large
        self._models: dict[int, tuple[int, dict[str, SpreadStates] | None]] = {}
        self._first_bytes = 0  # of memory, at the first look
        self.next_look_ns = 0

    def install_copies(self, module: ModuleType) -> None:
        """Note copies of environments (`gymnasium.utils.ezpickle`), which begin anew.

        That of an environment that has not stepped yet is as its original.
        """
        set_state = module.EzPickle.__setstate__

        def note(environment: Any, state: Any) -> None:
            set_state(environment, state)
            frame = sys._getframe(1)
            with suppress(Exception):  # `data` is code of the user's
                if frame.f_globals.get("__name__") == "copy":
                    original = getattr(frame.f_locals.get("x"), "data", None)
                    if getattr(original, "time", 0.0) > 0.0:
                        self._calls.note(COPIED_ENVIRONMENT, frame)

        module.EzPickle.__setstate__ = named_like(set_state, note)

    def enter(self, data: int, frame: FrameType, now_ns: int) -> None:
        """Note that a step of an MjData begins, which no other thread may step meanwhile."""
        thread = get_ident()
        if self._active.get(data, thread) != thread:
            self._calls.add(SHARED_DATA, frame, now_ns, now_ns)
        self._active[data] = thread

    def leave(self, data: int) -> None:
        self._active.pop(data, None)

    def note_turns(self, simulations: int, frame: FrameType, now_ns: int) -> None:
        self._calls.add(IN_TURN, frame, now_ns, now_ns, all_steps=simulations)

    def look(self, model: Any, data: Any, frame: FrameType | None, now_ns: int) -> None:
        """Look at a simulation after a burst of steps, and at the process from time to time."""
        with suppress(Exception):
            self.look_for_warnings(data, frame, now_ns)
            if now_ns >= self.next_look_ns:
                self.next_look_ns = now_ns + LOOK_NS
                latest_bytes = _resident_bytes()
                self._first_bytes = self._first_bytes or latest_bytes
                self._calls.write_memory(self._first_bytes, latest_bytes)
                self.keep_state(model, data)

    def look_for_halves(self, model: Any, frame: FrameType | None) -> bool:
        """Note, and return, whether halves of a step run a model that asks for Runge-Kutta."""
        with suppress(Exception):
            module = sys.modules["mujoco"]
            if model.opt.integrator == int(module.mjtIntegrator.mjINT_RK4):
                now_ns = self._now_ns()
                self._calls.add(HALVES, frame, now_ns, now_ns)
                return True
        return False

    def look_for_warnings(self, data: Any, frame: FrameType | None, now_ns: int) -> None:
        """Count warnings of a simulation since the last look, at the line that steps it."""
        numbers = getattr(getattr(data, "warning", None), "number", None)
        if numbers is None or (not numbers.any() and id(data) not in self._warnings):
            return
        numbers = [int(number) for number in numbers]
        earlier = self._warnings.get(id(data))
        if earlier is None:
            earlier = [0] * len(numbers)
        for kind, (number, before) in enumerate(zip(numbers, earlier, strict=True)):
            more = number - before if number >= before else number  # it was reset meanwhile
            if more > 0:
                self._calls.add(f"{WARNING} {kind}", frame, now_ns, now_ns, calls=more)
        self._warnings[id(data)] = numbers

    def keep_state(self, model: Any, data: Any, kind: str = "states") -> None:
        """Write a model once, and a few of its states, or of those that the program copies."""
        if id(model) not in self._models:
            if len(self._models) == MAX_MODELS:
                return
            self._models[id(model)] = len(self._models), self._write_model(model)
        number, kinds = self._models[id(model)]
        if kinds is None:
            return
        if kind not in kinds:
            kinds[kind] = SpreadStates(f"{self._path(number)}.{kind}")
        if kinds[kind].is_due():
            import numpy as np

            module = sys.modules["mujoco"]
            spec = module.mjtState.mjSTATE_INTEGRATION
            state = np.empty(module.mj_stateSize(model, spec))
            get_state = module.mj_getState
            getattr(get_state, "__wrapped__", get_state)(model, data, state, spec)
            kinds[kind].keep(state.tobytes())

    def _write_model(self, model: Any) -> dict[str, SpreadStates] | None:
        module = sys.modules["mujoco"]
        if module.mj_sizeModel(model) > MAX_MODEL_BYTES:
            return None
        import numpy as np

        path, stored = self._path(len(self._models)), np.empty(module.mj_sizeModel(model), np.uint8)
        module.mj_saveModel(model, None, stored)
        size = module.mj_stateSize(model, module.mjtState.mjSTATE_INTEGRATION)
        _write_whole(f"{path}.count", str(size).encode())
        _write_whole(f"{path}.mjb", stored.tobytes())
        return {}

    def _path(self, number: int) -> str:
        return os.path.join(self._folder, f"{os.getpid()}.{number}")


def _write_whole(path: str, content: bytes) -> None:
    """Write a file that is whole or not there, whether the process is killed or the disk full."""
    with open(f"{path}.new", "wb") as file:
        file.write(content)
    os.replace(f"{path}.new", path)


def _resident_bytes() -> int:
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * mmap.PAGESIZE
    except OSError:
        return 0


def write_engine(folder: str, module: ModuleType) -> None:
    """Write the release, and the names of its timers and warnings."""
    timer = getattr(module, "mjtTimer", None)
    members = getattr(timer, "__members__", {})
    names = {name.removeprefix("mjTIMER_"): int(value) for name, value in members.items()}
    warnings = getattr(getattr(module, "mjtWarning", None), "__members__", {})
    engine = {
        "version": getattr(module, "__version__", ""),
        "timers": names,
        "warnings": {int(value): name.removeprefix("mjWARN_") for name, value in warnings.items()},
    }
    with suppress(OSError):  # the names are missing then
        _write_whole(os.path.join(folder, "engine.json"), json.dumps(engine).encode())
