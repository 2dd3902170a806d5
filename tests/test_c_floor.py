import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import c_floor
from mjbench import work, workload


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler (cc) on this machine")
def test_the_c_program_reaches_the_same_states(tmp_path: Path, model: Any) -> None:
    made = workload.make(model, nbatch=4, nstep=12, hold=3)
    run, final_state = c_floor.c_loop(c_floor.build(tmp_path), made)
    run()
    np.testing.assert_array_equal(final_state, work.observe(made).final_state)
