"""What every way of stepping promises.

A `SteppingPath` says what it is called, what it can do, why it is unavailable here, and makes a
`Prepared` run of a workload. `Prepared.run()` is exactly the timed region: it starts from the
workload's start states, does all its steps, and leaves the final states where `final_states()`
can read them afterwards. Every allocation, thread pool and worker is made in `prepare`.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

Options = Mapping[str, Any]


@dataclass(frozen=True)
class Option:
    """An option of a path.

    Attributes:
      name: what it is called on the command line and in results.
      summary: what it does, in a few words.
      values: what is tried unless the user says otherwise; None means the path's own default.
      parse: turns a user's word into a value.
      allowed: the values there are; empty when any will do.
    """

    name: str
    summary: str
    values: tuple[Any, ...]
    parse: Callable[[str], Any]
    allowed: tuple[str, ...] = ()

    def value(self, word: str) -> Any:
        """Return the value that a word of the command line stands for.

        Raises:
          InputError: it stands for none.
        """
        try:
            value = self.parse(word)
        except ValueError as error:
            raise InputError(f"{self.name}: {error}") from error
        if self.allowed and value not in self.allowed:
            raise InputError(f"{self.name} is one of {', '.join(self.allowed)}, not {word}")
        if self.parse is int and value < 1:
            raise InputError(f"{self.name} must be at least 1, not {word}")
        return value


@dataclass(frozen=True, eq=False)
class States:
    """Final states that a run left behind.

    Attributes:
      values: (nbatch, nstate) rows of mjSTATE_INTEGRATION.
      held: (nbatch, nstate) which entries the path gives away; None when it gives all.
    """

    values: np.ndarray
    held: np.ndarray | None = None


class Resources:
    """Memory and workers that prepared runs of one workload share, made on first use.

    Runs take turns, so one set of MjData and one output buffer serve all of them: memory does
    not grow with the number of paths. Close it to stop what was started.
    """

    def __init__(self, workload: Workload):
        self.workload = workload
        self._kept: dict[Any, Any] = {}
        self._datas: list[Any] = []
        self._closing = ExitStack()

    def datas(self, count: int) -> list[Any]:
        """Return `count` MjData, the same ones to every caller."""
        while len(self._datas) < count:
            self._datas.append(mujoco.MjData(self.workload.model))
        return self._datas[:count]

    def get_or_create(self, key: Any, create: Callable[[], Any]) -> Any:
        """Return what `create` returned when `key` was first asked for."""
        if key not in self._kept:
            self._kept[key] = create()
        return self._kept[key]

    def final_state(self) -> np.ndarray:
        """Return the (nbatch, nstate) array that runs write their final states to."""
        return self.get_or_create(  # type: ignore[no-any-return]
            "final_state", lambda: np.empty_like(self.workload.initial_state)
        )

    def at_close(self, callback: Callable[[], Any]) -> None:
        """Call `callback` when these resources are closed."""
        self._closing.callback(callback)

    def close(self) -> None:
        """Stop workers and pools, and drop all memory."""
        self._closing.close()
        self._kept.clear()
        self._datas.clear()


@dataclass(eq=False)
class Prepared:
    """A run that is ready to be timed, over and over.

    Attributes:
      run: the timed region.
      clear: makes the outputs of an earlier run invalid, so that only states that `run` computed
        can pass for its result; untimed.
      final_states: reads what `run` left behind; untimed.
      verify: runs and returns every entry of the final states, by further calls where the timed
        call does not give all away; untimed.
    """

    run: Callable[[], None]
    clear: Callable[[], None]
    final_states: Callable[[], States]
    verify: Callable[[], States] = field(default=None)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.verify is None:
            self.verify = self._run_once

    def _run_once(self) -> States:
        self.clear()
        self.run()
        return self.final_states()


class SteppingPath(ABC):
    """One way of stepping a workload.

    Class attributes:
      name: what results call it.
      summary: one line for people.
      closed_loop: whether a feedback policy can choose each control from the state before it.
      options: what can be varied.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    closed_loop: ClassVar[bool]
    options: ClassVar[tuple[Option, ...]] = ()

    def unavailable(self) -> str | None:
        """Return why this path cannot run here, in one line, or None if it can."""
        return None

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Return why this path cannot run this workload, in one line, or None if it can."""
        return None

    @abstractmethod
    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """Return a run of `workload`, everything allocated and started."""

    @abstractmethod
    def snippet(self, workload: Workload, options: Options) -> str:
        """Return Python that does what this path does, for people to paste.

        It starts from `model`, `initial_state` (nbatch, nstate) and `control`
        (nbatch, ncontrol, nu), and leaves `final_state` (nbatch, nstate).
        """

    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        """Return the option sets to try: every combination, without those that mean the same.

        Args:
          choices: values by option name that replace the path's own.
        """
        values = [choices.get(option.name, option.values) for option in self.options]
        sets = [
            self.simplified(dict(zip([o.name for o in self.options], combination, strict=True)))
            for combination in itertools.product(*values)
        ]
        return [s for i, s in enumerate(sets) if s not in sets[:i]]

    def complete(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return a whole option set: what was not given is one thread, or what is tried first."""
        one = {"threads": 1, "processes": 1}
        usual = {o.name: one.get(o.name, o.values[0] if o.values else None) for o in self.options}
        return self.simplified({**usual, **given})

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        """Return `options` without those that mean nothing beside the others."""
        return {name: value for name, value in options.items() if value is not None}


def fill_from_array(array: np.ndarray) -> tuple[Callable[[], None], Callable[[], States]]:
    """Return `clear` and `final_states` of a run that writes all of `array`."""
    return lambda: array.fill(np.nan), lambda: States(array)


def simulate(
    model: Any,
    data: Any,
    initial_state: np.ndarray,
    control: np.ndarray,
    hold: int,
    final_state: np.ndarray,
    spec: int,
    fresh: bool,
) -> None:
    """Step simulations one after the other, holding each control for one `mj_step` call.

    Args:
      model: the MjModel.
      data: the MjData that every simulation runs in.
      initial_state: (n, nstate) start states.
      control: (n, ncontrol, nu) controls.
      hold: steps per control.
      final_state: (n, nstate), written.
      spec: mjSTATE_INTEGRATION.
      fresh: whether to reset `data` before each simulation (see `needs_reset`).
    """
    mj_step, ctrl = mujoco.mj_step, data.ctrl
    for start, controls, end in zip(initial_state, control, final_state, strict=True):
        if fresh:
            mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, start, spec)
        for values in controls:
            ctrl[:] = values
            mj_step(model, data, hold)
        mujoco.mj_getState(model, data, end, spec)


def needs_reset(model: Any) -> bool:
    """Return whether an MjData must be reset between simulations: sleep is not in the state."""
    return compat.has_sleep(model)
