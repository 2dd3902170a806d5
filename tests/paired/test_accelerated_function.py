"""A model's run by a path that compiles, as a function; a stub stands for the path."""

import os
import pickle
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mjbench.errors import MachineError
from mjbench.measuring.calls import Compilation, PreparedCall
from mjbench.paired import accelerated_function
from mjbench.paths.accelerated import CPU, Compiled
from mjbench.paths.base import States
from mjbench.paths.warp_buffers import OverflowedError
from mjbench.simulation import models, workload
from mjbench.simulation.workload import Workload


class Program:
    """Stands for a compiled run: what it did last, and where that ended."""

    def __init__(self, simulations: Workload):
        self.log: list[str] = []
        self.ends = States(simulations.initial_state.copy())
        self.overflows = False

    def compiled(self, simulations: Workload) -> Compiled:
        return Compiled(
            self.run,
            self.clear,
            self.final_states,
            workload=simulations,
            advance=self.advance,
            reload=self.clear,
            device=CPU,
            trace_s=0.5,
            compile_s=1.0,
            is_deterministic=True,
            buffer_sizes={},
            gpu_memory_bytes=lambda: None,
        )

    def clear(self) -> None:
        self.log.append("clear")

    def run(self) -> None:
        self.log.append("run")

    def final_states(self) -> States:
        if self.overflows:
            raise OverflowedError("buffers of Warp overflowed")
        return self.ends

    def advance(self, fields: Mapping[str, Any], control: np.ndarray, nstep: int) -> Any:
        assert nstep == 1
        return SimpleNamespace(fields=fields)


SOURCE = models.resolve("cartpole")
_CACHE = "JAX_COMPILATION_CACHE_DIR"


@pytest.fixture
def simulations() -> Workload:
    return workload.make(models.load(SOURCE), nbatch=3, nstep=4, seed=1)


@pytest.fixture
def program(simulations: Workload) -> Program:
    return Program(simulations)


@pytest.fixture
def step(
    simulations: Workload, program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> PreparedCall:
    path = stub_path(lambda *_: program.compiled(simulations))
    monkeypatch.setattr(accelerated_function, "accelerated_path", lambda name: path)
    return accelerated_function.compiled_step(
        SOURCE, "mjx", stored(simulations, tmp_path), tmp_path
    )


def stub_path(prepare: Callable[..., Compiled], **others: object) -> SimpleNamespace:
    usual: dict[str, object] = {
        "packages": (),
        "environment": dict,
        "cannot_run": lambda *_: None,
        "use_cache": lambda folder: None,
    }
    return SimpleNamespace(prepare=prepare, **(usual | others))


def stored(simulations: Workload, folder: Path) -> Path:
    file = folder / "workload"
    file.write_bytes(pickle.dumps(workload.portable(simulations)))
    return file


def test_compiling_anew_is_timed_without_what_a_process_has_kept(
    simulations: Workload, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    log: list[str] = []
    programs: list[Program] = []

    def prepare(*_: object) -> Compiled:
        log.append("compile")
        (listener,) = listeners
        for event in (
            "/jax/other",
            accelerated_function._COMPILE_EVENT,
            accelerated_function._COMPILE_EVENT,
        ):
            listener(event, 0.1, name="step")
        programs.append(Program(simulations))
        return programs[-1].compiled(simulations)

    path = stub_path(prepare, packages=("jax",), environment=lambda: {_CACHE: None})
    listeners: list[Callable[..., None]] = []
    monitoring = SimpleNamespace(register_event_duration_secs_listener=listeners.append)
    jax = SimpleNamespace(clear_caches=lambda: log.append("clear"), monitoring=monitoring)
    monkeypatch.setattr(accelerated_function, "accelerated_path", lambda name: path)
    monkeypatch.setitem(sys.modules, "jax", cast(ModuleType, jax))
    monkeypatch.setenv(_CACHE, "/elsewhere")
    call = accelerated_function.compilation(SOURCE, "mjx", stored(simulations, tmp_path))
    assert _CACHE not in os.environ
    assert log == []
    for _ in range(2):
        call.prepare()
        call.timed()
    assert log == ["clear", "compile"] * 2
    result: Any = call.result()
    assert result["qpos"].shape == (3, 2)
    assert [program.log for program in programs] == [["clear", "run"]] * 2
    took = call.compilation()
    assert took.first_run_s > 0
    assert took == Compilation(0.5, 1.0, took.first_run_s, programs=2)


def test_the_run_alone_is_timed(program: Program, step: PreparedCall) -> None:
    program.log.clear()  # of the first run
    step.timed()
    assert program.log == ["run"]
    step.prepare()
    assert program.log == ["run", "clear"]


@pytest.mark.parametrize("is_new", [True, False])
def test_a_program_is_of_the_cache_where_compiling_adds_nothing_to_it(
    is_new: bool, simulations: Workload, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()

    def prepare(*_: object) -> Compiled:
        if is_new:
            (cache / "program").touch()
        return Program(simulations).compiled(simulations)

    path = stub_path(prepare)
    monkeypatch.setattr(accelerated_function, "accelerated_path", lambda name: path)
    call = accelerated_function.compiled_step(SOURCE, "mjx", stored(simulations, tmp_path), cache)
    took = call.compilation()
    assert (took.is_cached, took.programs) == (not is_new, None)
    assert took.seconds == 1.5


def test_the_result_is_that_of_one_step_in_single_precision(step: PreparedCall) -> None:
    result: Any = step()
    assert {name: values.shape for name, values in result.items()} == {
        "qpos": (3, 2),
        "qvel": (3, 2),
    }
    assert result["qpos"].dtype == np.float32


def test_a_run_that_does_not_end_in_finite_numbers_is_refused(
    program: Program, step: PreparedCall
) -> None:
    program.ends.values[1, 2] = np.nan
    with pytest.raises(MachineError, match="1 of 3 simulations do not end in finite numbers"):
        step()


def test_what_a_path_does_not_return_need_not_be_finite(
    program: Program, step: PreparedCall
) -> None:
    program.ends.values[:, 2] = np.nan
    mask = np.isfinite(program.ends.values)
    program.ends = States(program.ends.values, mask)
    assert step() is not None


def test_a_run_that_overflows_a_buffer_is_refused(program: Program, step: PreparedCall) -> None:
    program.overflows = True
    with pytest.raises(OverflowedError):
        step()
