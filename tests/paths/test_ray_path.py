"""docs/examples/ray_path.py: a path of one's own, which does what the plain loop does."""

import numpy as np
import pytest
from commands import ROOT

from mjbench import paths
from mjbench.simulation import models, reference_run, workload


def test_actors_end_in_the_states_of_the_plain_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray", reason="Ray is not installed")
    monkeypatch.syspath_prepend(str(ROOT / "docs/examples"))
    model = models.load(models.resolve("cartpole"))
    small = workload.make(model, nbatch=3, nstep=8, hold=2)
    path, resources = paths.find("ray_path:Ray"), paths.Resources(small)
    try:
        states = path.prepare(small, path.complete({"processes": 2}), resources).verified_states()
        expected = reference_run.observe(small).final_state
        np.testing.assert_array_equal(states.values, expected)
    finally:
        resources.close()
