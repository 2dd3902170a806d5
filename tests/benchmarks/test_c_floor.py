import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import ROOT

from benchmarks import c_floor
from mjbench.comparison.sizes import SizeRequest, choose_sizes
from mjbench.errors import MachineError
from mjbench.simulation import models, work, workload

needs_compiler = pytest.mark.skipif(
    not shutil.which("cc"), reason="no C compiler (cc) on this machine"
)


@needs_compiler
@pytest.mark.parametrize("returns", list(workload.Product))
def test_the_c_program_reaches_the_same_states(
    tmp_path: Path, returns: workload.Product, model: mujoco.MjModel
) -> None:
    random_workload = workload.make(model, nbatch=4, nstep=12, hold=3).returning(returns)
    library = c_floor.build(tmp_path)
    data = mujoco.MjData(model)
    run, final_state = c_floor.c_loop(library, random_workload, data)
    run()
    np.testing.assert_array_equal(final_state, work.observe(random_workload).final_state)


@pytest.mark.parametrize("name", models.shipped())
def test_every_model_has_sizes_for_every_case(name: str) -> None:
    model = models.load(models.resolve(name))
    for hold in {case.hold for case in c_floor.CASES}:
        sizes = choose_sizes(work.step_s(model), SizeRequest(hold=hold))
        assert sizes.nbatch >= 1
        assert sizes.nstep >= hold
        assert sizes.nstep % hold == 0


@needs_compiler
def test_the_program_prints_a_row_for_a_model_whose_sizes_are_reduced() -> None:
    """Run as users do, with `-m`: requests then travel from `__main__` to child processes."""
    program = (
        "import runpy, sys\n"
        "from benchmarks import c_floor\n"
        "c_floor.CASES = c_floor.CASES[:1]\n"
        "sys.argv = ['c_floor', 'pile', '--budget', '0', '--launches', '1']\n"
        "runpy.run_module('benchmarks.c_floor', run_name='__main__', alter_sys=True)\n"
    )
    completed = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    header, row = completed.stdout.splitlines()
    assert header.split()[:3] == ["model", "path", "ns/step"]
    assert re.fullmatch(r"pile +rollout +[\d,]+ +\d+\.\d{4} +\d+\.\d{4}–\d+\.\d{4}", row)


def test_a_launch_that_fails_names_the_model_and_the_path(tmp_path: Path) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco>")
    source = models.resolve(str(tmp_path / "broken.xml"))
    request = c_floor.LaunchRequest(tmp_path / "no.so", source, c_floor.CASES[0], 0.0)
    with pytest.raises(MachineError, match=r"broken\.xml, rollout: input: .*cannot load"):
        c_floor.launch(request)
