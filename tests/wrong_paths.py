"""Paths that are wrong on purpose, each in one way; the comparison must find every one."""

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
from mjbench.paths.base import array_callbacks, make_simulate
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload


class _Wrong(paths.SteppingPath):
    summary = "wrong on purpose"
    closed_loop = True

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        start, control = self.spoiled(workload)
        final = resources.final_state()
        data = mujoco.MjData(workload.model)
        simulate = make_simulate(workload.model, workload.hold)
        n = len(start)

        def run() -> None:
            simulate(data, start, control, final[:n])

        return paths.Prepared(run, *array_callbacks(final))

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, workload.control

    def snippet(self, workload: Workload, options: paths.Options) -> str:
        return "raise NotImplementedError\n"


class Right(_Wrong):
    name = "wrong_paths:Right"


class ColdWarmStart(_Wrong):
    name = "wrong_paths:ColdWarmStart"

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        columns = compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
        cold = workload.initial_state.copy()
        cold[:, columns["qacc_warmstart"]] = 0.0
        return cold, workload.control


class OneStepFewer(_Wrong):
    name = "wrong_paths:OneStepFewer"

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, workload.control[:, :-1]


class ControlShifted(_Wrong):
    name = "wrong_paths:ControlShifted"

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state, np.roll(workload.control, 1, axis=1)


class LastUnstepped(_Wrong):
    name = "wrong_paths:LastUnstepped"

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        return workload.initial_state[:-1], workload.control[:-1]


class LateError(_Wrong):
    """Wrong from the 30th control on."""

    name = "wrong_paths:LateError"

    def spoiled(self, workload: Workload) -> tuple[np.ndarray, np.ndarray]:
        control = workload.control.copy()
        control[3, 29:] += 1e-3
        return workload.initial_state, control


class WrongWhenTimed(Right):
    """Right when verified, wrong from the second timed block on."""

    name = "wrong_paths:WrongWhenTimed"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        prepared = super().prepare(workload, options, resources)
        right, calls = prepared.run, 0

        def run() -> None:
            nonlocal calls
            calls += 1
            right()
            if calls > 2:
                resources.final_state()[0, 0] += 1.0

        return dataclasses.replace(prepared, run=run)


class Crashes(Right):
    name = "wrong_paths:Crashes"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        os.kill(os.getpid(), signal.SIGSEGV)
        raise AssertionError


class Hangs(Right):
    name = "wrong_paths:Hangs"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        while True:
            time.sleep(600)


class Raises(Right):
    name = "wrong_paths:Raises"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        raise RuntimeError("out of luck")


class Tells(Right):
    """Right; writes to a pipe once it is prepared, for a test that waits for it."""

    name = "wrong_paths:Tells"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        prepared = super().prepare(workload, options, resources)
        pipe = Path(os.environ["MJBENCH_TEST_PIPE"])
        if pipe.exists():
            pipe.write_text("prepared")
        return prepared


class CrashesWhenTimed(Right):
    """Right when verified; its third run, the first of a timed round, crashes."""

    name = "wrong_paths:CrashesWhenTimed"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        return _with_late_fault(super().prepare(workload, options, resources), _crash)


class HangsWhenTimed(Right):
    """Right when verified; its third run, the first of a timed round, never ends."""

    name = "wrong_paths:HangsWhenTimed"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        return _with_late_fault(super().prepare(workload, options, resources), _hang)


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
        if calls > 2:
            fault()
        prepared.run()

    return dataclasses.replace(prepared, run=run)


class RaisesWhenTimed(Right):
    """Right when verified; its third run, the first of a timed round, raises."""

    name = "wrong_paths:RaisesWhenTimed"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        return _with_late_fault(super().prepare(workload, options, resources), _exit)


def _exit() -> None:
    sys.exit("enough")


class Exits(Right):
    name = "wrong_paths:Exits"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        os._exit(0)


class UnsuitedRaises(Right):
    name = "wrong_paths:UnsuitedRaises"

    def unsuited(self, workload: Workload, options: paths.Options) -> str | None:
        raise RuntimeError("cannot\ntell")


class UnsuitedIsNoText(Right):
    name = "wrong_paths:UnsuitedIsNoText"

    def unsuited(self, workload: Workload, options: paths.Options) -> str | None:
        return 7  # type: ignore[return-value]


class PrepareInterrupts(Right):
    name = "wrong_paths:PrepareInterrupts"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        raise KeyboardInterrupt


class SnippetRaises(Right):
    name = "wrong_paths:SnippetRaises"

    def snippet(self, workload: Workload, options: paths.Options) -> str:
        raise LookupError("none")


class MessageRaises(Right):
    """Raises an exception that cannot be printed."""

    name = "wrong_paths:MessageRaises"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        raise UnprintableError


class UnprintableError(Exception):
    def __str__(self) -> str:
        raise ZeroDivisionError


class Untidy(Right):
    """Right, but it changes its process: folder, output, signals, threads."""

    name = "wrong_paths:Untidy"

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        print("to the output")
        os.write(1, b"to descriptor 1")
        os.chdir("/")
        os.closerange(0, 3)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        threading.Thread(target=time.sleep, args=(600,)).start()
        return super().prepare(workload, options, resources)


class VariantsRaise(Right):
    name = "wrong_paths:VariantsRaise"

    def variants(self, choices: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
        raise RuntimeError("no variants")


class NameIsNoText(Right):
    name = 7  # type: ignore[assignment]


class OptionsAreNoOptions(Right):
    name = "wrong_paths:OptionsAreNoOptions"
    options = ("threads",)  # type: ignore[assignment]


class CompilesWithoutInterface(Right):
    name = "wrong_paths:CompilesWithoutInterface"
    compiles = True


class AttributeRaises(Right):
    name = "wrong_paths:AttributeRaises"

    @property
    def summary(self) -> str:  # type: ignore[override]
        raise RuntimeError("no summary")


class ConstructorExits(Right):
    name = "wrong_paths:ConstructorExits"

    def __init__(self) -> None:
        sys.exit(5)
