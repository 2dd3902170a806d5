"""A model's run by a path that compiles, as a function; a stub stands for the path."""

import os
import pickle
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mjbench.errors import MachineError
from mjbench.measuring.calls import PreparedCall
from mjbench.paired import compiled_steps
from mjbench.paths.accelerated import accelerated_path
from mjbench.paths.base import States
from mjbench.paths.warp import CACHE_VARIABLE
from mjbench.paths.warp_buffers import OverflowedError
from mjbench.simulation import models, workload
from mjbench.simulation.workload import Workload


class Program:
    """Stands for a compiled run: what it did last, and where that ended."""

    def __init__(self, simulations: Workload):
        self.log: list[str] = []
        self.ends = States(simulations.initial_state.copy())
        self.overflows = False

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
    path = SimpleNamespace(
        packages=(),
        unavailable=lambda: None,
        environment=dict,
        unsuited=lambda *_: None,
        prepare=lambda *_: program,
    )
    monkeypatch.setattr(compiled_steps, "accelerated_path", lambda name: path)
    return compiled_steps.compiled_step(SOURCE, "mjx", stored(simulations, tmp_path), tmp_path)


def stored(simulations: Workload, folder: Path) -> Path:
    file = folder / "workload"
    file.write_bytes(pickle.dumps(workload.portable(simulations)))
    return file


def test_compiling_anew_is_timed_without_what_a_process_has_kept(
    simulations: Workload, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    log: list[str] = []
    programs: list[Program] = []

    def prepare(*_: object) -> Program:
        log.append("compile")
        programs.append(Program(simulations))
        return programs[-1]

    path = SimpleNamespace(
        packages=("jax",),
        unavailable=lambda: None,
        environment=lambda: {"JAX_COMPILATION_CACHE_DIR": None},
        unsuited=lambda *_: None,
        prepare=prepare,
    )
    jax = SimpleNamespace(clear_caches=lambda: log.append("clear"))
    monkeypatch.setattr(compiled_steps, "accelerated_path", lambda name: path)
    monkeypatch.setitem(sys.modules, "jax", cast(ModuleType, jax))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/elsewhere")
    call = compiled_steps.compilation(SOURCE, "mjx", stored(simulations, tmp_path))
    assert "JAX_COMPILATION_CACHE_DIR" not in os.environ
    assert log == []
    for _ in range(2):
        call.prepare()
        call.timed()
    assert log == ["clear", "compile"] * 2
    result: Any = call.result()
    assert result["qpos"].shape == (3, 2)
    assert [program.log for program in programs] == [[], ["clear", "run"]]


def test_warp_keeps_its_kernels_where_processes_of_an_environment_look(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "/elsewhere")
    path = accelerated_path("warp")
    assert path.environment()[CACHE_VARIABLE] is None
    compiled_steps._use_cache(path, tmp_path)
    assert os.environ[CACHE_VARIABLE] == str(tmp_path)


def test_the_run_alone_is_timed(program: Program, step: PreparedCall) -> None:
    step.timed()
    assert program.log == ["run"]
    step.prepare()
    assert program.log == ["run", "clear"]


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
