"""Paths that are wrong on purpose, each in one way; the comparison must find every one."""

import contextlib
import copy
import dataclasses
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.paths.base import make_simulate, prepared_arrays
from mjbench.simulation import compat
from mjbench.simulation.workload import Product, Workload


class _Wrong(paths.SteppingPath):
    summary = "wrong on purpose"
    closed_loop = True
    products = tuple(Product)

    def __init_subclass__(cls) -> None:
        cls.name = vars(cls).get("name", f"wrong_paths:{cls.__name__}")

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        model = self.model(workload)
        final, outputs = resources.final_state(), resources.step_outputs()
        data = mujoco.MjData(model)
        simulate = make_simulate(model, workload.hold, workload.returns)

        def run() -> None:
            start, control = self.spoiled(workload)
            simulate(data, start, control, final[: len(start)], outputs)

        return prepared_arrays(run, final, outputs)

    def model(self, workload: Workload) -> mujoco.MjModel:
        return workload.model

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, workload.control

    def snippet(self, workload: Workload, options: paths.Options) -> str:
        return "raise NotImplementedError\n"


class Right(_Wrong):
    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        self.before(workload)
        return self.changed(super().prepare(workload, options, resources), resources)

    def before(self, workload: Workload) -> None:
        """Do what else happens before it is prepared."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        return prepared


class ColdWarmStart(_Wrong):
    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        columns = compat.state_columns(workload.model)
        cold = workload.initial_state.copy()
        cold[:, columns["qacc_warmstart"]] = 0.0
        return cold, workload.control


class OneStepFewer(_Wrong):
    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, workload.control[:, :-1]


class ControlShifted(_Wrong):
    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, np.roll(workload.control, 1, axis=1)


class LastUnstepped(_Wrong):
    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state[:-1], workload.control[:-1]


class LateError(_Wrong):
    """Wrong from the 30th control on."""

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        control = workload.control.copy()
        control[3, 29:] += 1e-3
        return workload.initial_state, control


class Memo(Right):
    """Steps once, and returns that result ever after."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        outputs = [resources.final_state(), *resources.step_outputs().arrays]
        results: list[np.ndarray] = []

        def run() -> None:
            if not results:
                prepared.run()
                results.extend(array.copy() for array in outputs)
            for array, result in zip(outputs, results, strict=True):
                array[...] = result

        return dataclasses.replace(prepared, run=run)


class MemoWhenTimed(Right):
    """Right until it is timed; then it returns the result of the warm-up ever after."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        results: list[np.ndarray] = []

        def run() -> None:
            if len(results) < 3:
                prepared.run()
                results.append(resources.final_state().copy())
            resources.final_state()[...] = results[-1]

        return dataclasses.replace(prepared, run=run)


class NoSensors(_Wrong):
    """Steps a copy of the model that computes no sensors."""

    def model(self, workload: Workload) -> mujoco.MjModel:
        model = copy.copy(workload.model)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
        return model


class DropsInputs(_Wrong):
    """Drops some inputs of the start states; see `fields`."""

    fields: tuple[str, ...] = ()

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        columns = compat.state_columns(workload.model)
        start = workload.initial_state.copy()
        for field in self.fields:
            if field in columns:
                start[:, columns[field]] = 0.0
        return start, workload.control


class DropsXfrc(DropsInputs):
    fields = ("xfrc_applied", "qfrc_applied", "userdata")


class DropsUserdata(DropsInputs):
    fields = ("userdata",)


class CopiesInput(_Wrong):
    """Takes one field of the start states, `field`, from another simulation, `source`."""

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        place = compat.state_columns(workload.model)[options["field"]]
        rows = np.arange(workload.nbatch)
        source = {
            "first": np.zeros_like(rows),
            "previous": np.maximum(rows - 1, 0),
            "last": np.full_like(rows, rows[-1]),
        }[options["source"]]
        final, outputs = resources.final_state(), resources.step_outputs()
        data = mujoco.MjData(workload.model)
        simulate = make_simulate(workload.model, workload.hold, workload.returns)

        def run() -> None:
            start = workload.initial_state.copy()
            start[:, place] = start[source, place]
            simulate(data, start, workload.control, final, outputs)

        return prepared_arrays(run, final, outputs)


class WrongMiddle(Right):
    """Returns a wrong state after the third step, and right ones before and after."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        state = resources.step_outputs().state

        def run() -> None:
            prepared.run()
            if state is not None:
                state[1, 2, -1] += 1e-9

        return dataclasses.replace(prepared, run=run)


class SharedModel(Right):
    """Changes the model that all paths share."""

    def before(self, workload: Workload) -> None:
        workload.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR


class SharedModelWhenTimed(Right):
    """Changes the shared model in a timed block."""

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        def change() -> None:
            workload.model.body_mass[-1] *= 1.01

        return _with_late_fault(super().prepare(workload, options, resources), change)


class ClaimsTrajectories(Right):
    """Says that it returns states of every step, and does not."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        return dataclasses.replace(prepared, step_outputs=None)


class FinalOnly(Right):
    products = (Product.FINAL,)


class WrongWhenTimed(Right):
    """Right when verified, wrong from the second timed block on."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        right, calls = prepared.run, 0

        def run() -> None:
            nonlocal calls
            calls += 1
            right()
            if calls > 3:
                resources.final_state()[0, 0] += 1.0

        return dataclasses.replace(prepared, run=run)


class Crashes(Right):
    def before(self, workload: Workload) -> None:
        _crash()


class Hangs(Right):
    def before(self, workload: Workload) -> None:
        _hang()


class Raises(Right):
    def before(self, workload: Workload) -> None:
        raise RuntimeError("out of luck")


class Tells(Right):
    """Right; writes to a pipe once it is prepared, for a test that waits for it."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        pipe = Path(os.environ["MJBENCH_TEST_PIPE"])
        if pipe.exists():
            pipe.write_text("prepared")
        return prepared


class CrashesWhenTimed(Right):
    """Right when verified; its fourth run, the first of a timed round, crashes."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        return _with_late_fault(prepared, _crash)


class HangsWhenTimed(Right):
    """Right when verified; its fourth run, the first of a timed round, never ends."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        return _with_late_fault(prepared, _hang)


def _crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _hang() -> None:
    while True:
        time.sleep(600)


def _with_late_fault(prepared: paths.Prepared, fault: Callable[[], None]) -> paths.Prepared:
    """Return the run with a fault after it was verified and warmed up."""
    calls = 0

    def run() -> None:
        nonlocal calls
        calls += 1
        if calls > 3:
            fault()
        prepared.run()

    return dataclasses.replace(prepared, run=run)


class RaisesWhenTimed(Right):
    """Right when verified; its fourth run, the first of a timed round, raises."""

    def changed(self, prepared: paths.Prepared, resources: paths.Resources) -> paths.Prepared:
        return _with_late_fault(prepared, _exit)


def _exit() -> None:
    sys.exit("enough")


class Exits(Right):
    def before(self, workload: Workload) -> None:
        os._exit(0)


class UnsuitedRaises(Right):
    def unsuited(self, workload: Workload, options: paths.Options) -> str | None:
        raise RuntimeError("cannot\ntell")


class UnsuitedIsNoText(Right):
    def unsuited(self, workload: Workload, options: paths.Options) -> str | None:
        return 7  # type: ignore[return-value]


class PrepareInterrupts(Right):
    def before(self, workload: Workload) -> None:
        raise KeyboardInterrupt


class SnippetRaises(Right):
    def snippet(self, workload: Workload, options: paths.Options) -> str:
        raise LookupError("none")


class MessageRaises(Right):
    """Raises an exception that cannot be printed."""

    def before(self, workload: Workload) -> None:
        raise UnprintableError


class UnprintableError(Exception):
    def __str__(self) -> str:
        raise ZeroDivisionError


class Untidy(Right):
    """Right, but it changes its process: folder, output, signals, threads."""

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        with contextlib.suppress(OSError):  # it is prepared more than once
            print("to the output", flush=True)
            os.write(1, b"to descriptor 1")
        os.chdir("/")
        os.closerange(0, 3)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        threading.Thread(target=time.sleep, args=(600,)).start()
        return super().prepare(workload, options, resources)


class VariantsRaise(Right):
    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        raise RuntimeError("no variants")


class NameIsNoText(Right):
    name = 7  # type: ignore[assignment]


class OptionsAreNoOptions(Right):
    options = ("threads",)  # type: ignore[assignment]


class CompilesWithoutInterface(Right):
    compiles = True


class AttributeRaises(Right):
    @property
    def summary(self) -> str:  # type: ignore[override]
        raise RuntimeError("no summary")


class ConstructorExits(Right):
    def __init__(self) -> None:
        sys.exit(5)
