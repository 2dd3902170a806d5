"""What one worker does: what it imports, what it sets, and what it refuses."""

import subprocess
import sys
from dataclasses import replace

import mujoco
import pytest
from commands import ROOT
from example_models import CONTACT_XML
from paired_examples import CUBES

from mjbench.errors import InputError
from mjbench.paired import worker
from mjbench.paired.protocol import TargetPair
from mjbench.paired.worker_pool import TargetError, WorkerPool


def test_a_worker_imports_neither_mujoco_nor_numpy_before_it_has_mapped_other_memory() -> None:
    code = (
        "import sys, mjbench.paired.worker; print({'mujoco', 'numpy', 'msgspec'} & {*sys.modules})"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_path_that_computes_something_else_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    target = replace(CUBES, path="wrong_paths:ColdWarmStart")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"))
    with WorkerPool(limit_s=30.0) as pool:
        pair = TargetPair(pool, target, target)
        with pytest.raises(TargetError, match="does not reach the final states"):
            pair.launch()


def test_options_are_numbers_or_names_of_enum_values() -> None:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    for option, text in {
        "timestep": "0.001",
        "solver": "cg",
        "cone": "Elliptic",
        "integrator": "1",
        "iterations": "7",
    }.items():
        worker._set_option(model, option, text)
    assert model.opt.timestep == 0.001
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.opt.iterations == 7


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("iterations", "many", "cannot be 'many'"),
        ("gravity", "0", "cannot be '0'"),
        ("__class__", "0", "no option"),
    ],
)
def test_an_option_with_an_impossible_value_is_bad_input(
    option: str, text: str, message: str
) -> None:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    with pytest.raises(InputError, match=message):
        worker._set_option(model, option, text)
