"""What every way of stepping promises: the interface `SteppingPath`.

A `SteppingPath` has a name and options, says why it is unavailable here, and prepares runs of a
workload. `Prepared.run()` is exactly the timed region: it starts from the workload's start states,
takes all steps, and leaves the final states where `final_states()` can read them afterwards.
`prepare` makes every allocation and starts every thread and worker.

Before each timed round the simulations are reordered in place (`Resources.reorder`), so a run must
read the workload's arrays, and keep a copy of its own only with `Resources.at_change`.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from mjbench.errors import InputError, one_line
from mjbench.limits import MAX_COUNT, MAX_THREADS
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, StepOutputs, Workload

Options = Mapping[str, Any]

# Options that set how many threads or worker processes share the simulations, as --threads does.
WORKER_OPTIONS = ("threads", "processes")
# All options that set a number of threads or worker processes.
PARALLEL_OPTIONS = (*WORKER_OPTIONS, "engine_threads")


@dataclass(frozen=True)
class Option:
    """An option of a path.

    Attributes:
      values: values that are tried unless the user names others; None is the path's own default.
      allowed: all possible values; empty if any value will do.
    """

    name: str
    summary: str
    values: tuple[Any, ...]
    parse: Callable[[str], Any]
    allowed: tuple[str, ...] = ()

    @property
    def is_parallel(self) -> bool:
        """Whether the option sets a number of threads or worker processes."""
        return self.name in PARALLEL_OPTIONS

    def value(self, text: str) -> Any:
        """Return the value of a text of the command line; InputError if it is none of these."""
        try:
            value = self.parse(text)
        except Exception as error:  # a path of the user's own has a parser of its own
            raise InputError(f"{self.name}: {one_line(error)}") from error
        if self.allowed and value not in self.allowed:
            raise InputError(
                f"{self.name} is one of {', '.join(self.allowed)}, not {one_line(text, 30)}"
            )
        most = MAX_THREADS if self.is_parallel else MAX_COUNT
        if self.parse is int and not 1 <= value <= most:
            raise InputError(
                f"{self.name} must be at least 1 and at most {most}, not {one_line(text, 30)}"
            )
        return value


@dataclass(frozen=True, eq=False)
class States:
    """Final states of a run.

    Attributes:
      values: (nbatch, nstate) rows of mjSTATE_INTEGRATION.
      mask: (nbatch, nstate) bool: the entries that the path returns; None when it returns all.
    """

    values: np.ndarray
    mask: np.ndarray | None = None

    @classmethod
    def of_entries(cls, values: np.ndarray, entries: np.ndarray, returned: np.ndarray) -> "States":
        """Write what a path returns to some entries of states, which alone are in the mask."""
        mask = np.zeros(values.shape, dtype=bool)
        values[:, entries], mask[:, entries] = returned, True
        return cls(values, mask)

    def completed(self, whole: np.ndarray) -> "States":
        """Return the states with all entries: those that are not in the mask from `whole`."""
        return States(np.where(np.asarray(self.mask), self.values, whole))


class Resources:
    """Memory and workers that prepared runs of one workload share, made on first use.

    Runs take turns, so one set of MjData and one output buffer serve all of them: memory does
    not grow with the number of paths. Close it to stop the workers.
    """

    def __init__(self, workload: Workload):
        self.workload = workload
        self._shared: dict[Hashable, Any] = {}
        self._datas: list[mujoco.MjData] = []
        self._at_change: list[Callable[[], None]] = []
        self._closing = ExitStack()

    def datas(self, count: int) -> list[mujoco.MjData]:
        """Return `count` MjData, the same ones to every caller."""
        while len(self._datas) < count:
            self._datas.append(mujoco.MjData(self.workload.model))
        return self._datas[:count]

    def get_or_create(self, key: Hashable, create: Callable[[], Any]) -> Any:
        """Return the object stored under `key`; the first call creates it by `create()`."""
        if key not in self._shared:
            self._shared[key] = create()
        return self._shared[key]

    def final_state(self) -> np.ndarray:
        """Return the (nbatch, nstate) array that runs write their final states to."""
        return self.get_or_create(  # type: ignore[no-any-return]
            "final_state", lambda: np.empty_like(self.workload.initial_state)
        )

    def step_outputs(self) -> StepOutputs:
        """Return the arrays that runs write what they return of every step to."""
        return self.get_or_create(  # type: ignore[no-any-return]
            "step outputs", lambda: StepOutputs.empty(self.workload)
        )

    def at_change(self, callback: Callable[[], None]) -> None:
        """Call `callback` whenever the workload's arrays were changed in place."""
        self._at_change.append(callback)

    def reorder(self, order: np.ndarray) -> None:
        """Reorder the simulations of the workload, in place, by a permutation of (nbatch,)."""
        self.workload.reorder(order)
        self.changed()

    def changed(self) -> None:
        """Let prepared runs follow a change of the workload's arrays in place."""
        self.workload.update_step_control()
        for callback in self._at_change:
            callback()

    def at_close(self, callback: Callable[[], Any]) -> None:
        self._closing.callback(callback)

    def close(self) -> None:
        """Stop workers and pools, and release all memory."""
        self._closing.close()
        self._at_change.clear()
        self._shared.clear()
        self._datas.clear()


@dataclass(frozen=True, eq=False)
class Prepared:
    """A run that can be timed as often as one likes; only `run` is timed.

    Attributes:
      clear: invalidates the output of an earlier run, so that only states that `run` computed pass
        as its result.
      verify: runs, and returns every entry of the final states, with further calls for what `run`
        does not return; None where `run` returns all.
      step_outputs: what `run` returned of every step; None where a workload asks for final states
        alone.
    """

    run: Callable[[], None]
    clear: Callable[[], None]
    final_states: Callable[[], States]
    verify: Callable[[], States] | None = None
    step_outputs: Callable[[], StepOutputs] | None = None

    def verified_states(self) -> States:
        """Run once, and return all entries of the final states that the path can."""
        if self.verify is not None:
            return self.verify()
        self.clear()
        self.run()
        return self.final_states()


class SteppingPath(ABC):
    """One way of stepping a workload.

    Class attributes:
      title: name in a sentence, such as `Batch.step`; empty for `name`.
      closed_loop: whether a feedback policy can choose each control from the state before it.
      compiles: whether it compiles the step first, and is held to tolerances (`AcceleratedPath`).
      starts_slowly: whether starting takes seconds in a fresh process, so that few processes time
        it.
      usual: whether `--paths usual` includes it where it is available, and `--paths c` if it steps
        in C.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    title: ClassVar[str] = ""
    closed_loop: ClassVar[bool]
    compiles: ClassVar[bool] = False
    starts_slowly: ClassVar[bool] = False
    usual: ClassVar[bool] = True
    products: ClassVar[tuple[Product, ...]] = (Product.FINAL,)
    options: ClassVar[tuple[Option, ...]] = ()

    def unavailable(self) -> str | None:
        """Return why this path cannot run here, in one line, or None if it can."""
        return None

    def unsuited(self, workload: Workload, options: Options) -> str | None:
        """Return why this path cannot run this workload, in one line, or None if it can."""
        return None

    def cannot_return(self, returns: Product) -> str | None:
        """Return why runs of this path cannot return a product, or None if they can."""
        if returns in self.products:
            return None
        able = " or ".join(self.products)
        return f"returns {able}, not {returns}"

    def cannot_run(self, workload: Workload, options: Options) -> str | None:
        """Return why this path cannot run this workload here and return what it asks for."""
        reason = self.unavailable() or self.cannot_return(workload.returns)
        return reason or self.unsuited(workload, options)

    @abstractmethod
    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """Return a run of `workload`, with everything allocated and started."""

    @abstractmethod
    def snippet(self, workload: Workload, options: Options) -> str:
        """Return Python code that does what this path does, for people to paste.

        It starts from `model`, `initial_state` (nbatch, nstate) and `control`
        (nbatch, ncontrol, nu), and ends with `final_state` (nbatch, nstate).
        """

    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        """Return the option sets to try, without duplicates in effect; `choices` replace values."""
        names = [option.name for option in self.options]
        values = [choices.get(option.name, option.values) for option in self.options]
        variants: list[dict[str, Any]] = []
        for combination in itertools.product(*values):
            variant = self.simplified(dict(zip(names, combination, strict=True)))
            if variant not in variants:
                variants.append(variant)
        return variants

    def complete(self, options: Options) -> dict[str, Any]:
        """Return a full option set: missing options get their first value, or one thread."""
        defaults = {
            option.name: option.values[0] if option.values else 1 if option.is_parallel else None
            for option in self.options
        }
        return self.simplified({**defaults, **options})

    def simplified(self, options: dict[str, Any]) -> dict[str, Any]:
        """Return `options` without those that have no effect beside the others."""
        return {name: value for name, value in options.items() if value is not None}


def prepared_arrays(
    run: Callable[[], None], final_state: np.ndarray, outputs: StepOutputs
) -> Prepared:
    def clear() -> None:
        final_state.fill(np.nan)
        outputs.clear()

    return Prepared(
        run,
        clear,
        lambda: States(final_state),
        step_outputs=None if outputs.state is None else lambda: outputs,
    )


# (data, initial_state (n, nstate), control (n, ncontrol, nu), final_state (n, nstate), outputs);
# the last two are written
Simulate = Callable[[mujoco.MjData, np.ndarray, np.ndarray, np.ndarray, StepOutputs], None]


def make_simulate(model: mujoco.MjModel, hold: int, returns: Product) -> Simulate:
    """Return a function that steps simulations one after the other in one MjData.

    For final states it calls `mj_step` once per control, with `nstep=hold`; otherwise once per
    step. What it needs to know of the model is looked up here, so that a timed call does nothing
    but step and record.
    """
    # a state does not hold what sleeps
    spec, has_reset = compat.INTEGRATION, compat.has_sleep(model)
    physics = compat.FULLPHYSICS

    def simulate(
        data: mujoco.MjData,
        initial_state: np.ndarray,
        control: np.ndarray,
        final_state: np.ndarray,
        outputs: StepOutputs,
    ) -> None:
        mj_step, ctrl = mujoco.mj_step, data.ctrl
        for start, controls, end in zip(initial_state, control, final_state, strict=True):
            if has_reset:
                mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, spec)
            for values in controls:
                ctrl[:] = values
                mj_step(model, data, hold)
            mujoco.mj_getState(model, data, end, spec)

    def record(
        data: mujoco.MjData,
        initial_state: np.ndarray,
        control: np.ndarray,
        final_state: np.ndarray,
        outputs: StepOutputs,
    ) -> None:
        mj_step, mj_getState, ctrl = mujoco.mj_step, mujoco.mj_getState, data.ctrl  # noqa: N806
        sensordata = data.sensordata
        for i, (start, controls) in enumerate(zip(initial_state, control, strict=True)):
            states, sensors = outputs.rows(i)
            if has_reset:
                mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, spec)
            step = 0
            for values in controls:
                ctrl[:] = values
                for _ in range(hold):
                    mj_step(model, data)
                    mj_getState(model, data, states[step], physics)
                    if sensors is not None:
                        sensors[step] = sensordata
                    step += 1
            mujoco.mj_getState(model, data, final_state[i], spec)

    return simulate if returns == Product.FINAL else record


def nthread(options: Mapping[str, Any]) -> int:
    """Return the threads or worker processes that an option set steps with; 1 if it names none."""
    return max(options.get(name) or 1 for name in PARALLEL_OPTIONS)
