import shutil
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from benchmarks import c_floor
from mjbench.simulation import work, workload


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler (cc) on this machine")
@pytest.mark.parametrize("returns_states", [False, True])
def test_the_c_program_reaches_the_same_states(
    tmp_path: Path, returns_states: bool, model: Any
) -> None:
    made = workload.make(model, nbatch=4, nstep=12, hold=3)
    library = c_floor.build(tmp_path)
    run, final_state = c_floor.c_loop(library, made, mujoco.MjData(model), returns_states)
    run()
    np.testing.assert_array_equal(final_state, work.observe(made).final_state)
