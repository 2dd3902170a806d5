"""What accelerated paths say of themselves: packages, models, snippets, buffers."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import PYTHONPATH
from example_models import PENDULUM_XML
from pretender import MODEL, NBATCH, available, make_workload
from quick_engines import QUICK_WARP

from mjbench import extras, paths
from mjbench.errors import MachineError
from mjbench.paths import warp
from mjbench.paths.accelerated import accelerated_path
from mjbench.paths.warp_buffers import check_overflow
from mjbench.simulation import reference_trajectory, workload
from mjbench.verification import selection

BALL_ASLEEP = """
<mujoco>
  <option><flag sleep="enable"/></option>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.099"><freejoint/><geom type="sphere" size="0.1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("name", "model", "result", "within"),
    [
        ("mjx64", "pendulum.xml", "[final.time, final.qpos]", 1e-12),
        ("warp", MODEL, "[d.time, d.qpos]", 1e-5),
    ],
)
def test_the_snippet_computes_what_c_computes(
    name: str,
    model: str,
    result: str,
    within: float,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)
    if name != "warp":
        request.getfixturevalue("without_warp")
    monkeypatch.chdir(tmp_path)
    Path("pendulum.xml").write_text(PENDULUM_XML)
    path, work = available(name), make_workload(model)
    np.savez("in.npz", state=work.initial_state, control=work.control)
    Path("run.py").write_text(
        (QUICK_WARP if name == "warp" else "") + "import numpy as np\n"
        "from mjbench.simulation import models\n"
        f"model = models.load(models.resolve({model!r}))\n"
        "given = np.load('in.npz')\n"
        "initial_state, control = given['state'], given['control']\n"
        f"{path.snippet(work, {})}\n"
        f"rows = [np.asarray(x).reshape(len(initial_state), -1) for x in {result}]\n"
        "np.save('out.npy', np.hstack(rows))\n"
    )
    subprocess.run([sys.executable, "run.py"], check=True)
    want = reference_trajectory.record_trajectory(work, NBATCH).states[:, work.nstep]
    fields = workload.fields(work.model, want)
    got = np.load("out.npy")
    assert np.abs(got - np.hstack([fields["time"], fields["qpos"]])).max() < within


def test_a_missing_package_names_the_extra_that_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjbench.extras._is_installed", lambda name: False)
    for name, extra in (
        ("mjx", "mjx"),
        ("mjx64", "mjx"),
        ("mjx_warp", "mjx,warp"),
        ("warp", "warp"),
    ):
        install = extras.install_command(extra)
        assert install in str(paths.find(name).unavailable())
    assert not {"mjx", "mjx64"} & set(selection.expand(["usual"]))


def test_warp_is_not_timed_where_trees_sleep(tmp_path: Path) -> None:
    path = available("warp")
    (tmp_path / "asleep.xml").write_text(BALL_ASLEEP)
    assert "sleep" in str(path.unsuited(make_workload(str(tmp_path / "asleep.xml")), {}))


def test_mjx_is_not_timed_where_noslip_iterations_act() -> None:
    workload = make_workload("cube_table")
    workload.model.opt.noslip_iterations = 3
    assert "noslip" in str(paths.find("mjx").unsuited(workload, {}))


def test_a_buffer_of_warp_that_was_too_small_is_reported() -> None:
    overflow = pytest.importorskip("mujoco_warp").OverflowType
    check_overflow(np.array([0, overflow.ITERATIONS, overflow.LS_ITERATIONS]))
    flags = np.array([0, overflow.NEFC | overflow.ITERATIONS, overflow.NEFC | overflow.CCD])
    with pytest.raises(MachineError, match="overflowed in 2 worlds: NEFC, CCD"):
        check_overflow(flags)


def test_a_process_that_measures_warp_compiles_everything_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = pytest.importorskip("warp").config
    monkeypatch.setattr(config, "kernel_cache_dir", None)
    monkeypatch.setattr(config, "log_level", config.log_level)
    monkeypatch.chdir(tmp_path)
    warp.configure_warp()
    assert Path(config.kernel_cache_dir).parent == tmp_path


def test_warp_keeps_its_kernels_where_processes_of_an_environment_look(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(warp.CACHE_VARIABLE, "/elsewhere")
    path = accelerated_path("warp")
    assert path.environment()[warp.CACHE_VARIABLE] is None
    path.use_cache(tmp_path)
    assert os.environ[warp.CACHE_VARIABLE] == str(tmp_path)
