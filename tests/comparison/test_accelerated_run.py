"""MJX and Warp: the same workload, judged by tolerances, killed where they do not return."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import PYTHONPATH, ROOT, mjbench
from pretender import MODEL, NBATCH, NSTEP, Pretender, make_workload

from mjbench import paths
from mjbench.comparison import accelerated_run, compare, selection
from mjbench.errors import MachineError
from mjbench.instrument import isolate
from mjbench.paths.accelerated import AcceleratedPath, save_workload
from mjbench.paths.warp_buffers import check_overflow
from mjbench.report import results
from mjbench.simulation import accelerated_check, models, trajectory, workload
from mjbench.simulation.work import Peaks, observe

ENVIRONMENT = {**os.environ, "PYTHONPATH": PYTHONPATH}
RUNS = ROOT / "results/runs"


def available(name: str) -> AcceleratedPath:
    path = paths.find(name)
    assert isinstance(path, AcceleratedPath)
    reason = path.unavailable()
    if reason:
        pytest.skip(reason)
    return path


def measured(
    path: AcceleratedPath, work: workload.Workload, folder: Path, **more: Any
) -> tuple[isolate.Ended, dict[str, Any]]:
    """Return how a child ended, and all it told."""
    file = folder / "work.pickle"
    save_workload(work, observe(work).peaks, file)
    told: dict[str, Any] = {"samples": []}

    def take(message: isolate.Message) -> None:
        if message["kind"] == "sample":
            told["samples"].append(message["seconds"])
        told.update(message)

    source = models.resolve(more.pop("model", MODEL))
    return accelerated_run.run(source, path.name, {}, file, take, **more), told


@pytest.mark.parametrize(("name", "nstep"), [("mjx", NSTEP), ("mjx64", 500), ("warp", NSTEP)])
def test_the_cart_pole_keeps_to_the_tolerances(name: str, nstep: int, tmp_path: Path) -> None:
    work = make_workload(nstep=nstep)
    ended, told = measured(available(name), work, tmp_path)
    assert ended.status == "ok", ended.detail
    assert told["agrees"] is True, told["detail"]
    assert len(told["samples"]) >= accelerated_run.LEAST_BLOCKS
    assert told["compile_s"] > 0
    assert told["device"]
    assert told["memory_bytes"] > 2**20
    # the very same workload, in the child and on its device
    assert told["workload_digest"] == work.digest()
    check = told["check"]
    assert check["received"] is True
    assert check["unconstrained_steps"] == min(NBATCH * nstep, accelerated_run.MOST_SINGLES)
    assert check["final_nstep"] == nstep
    if name == "mjx64":
        assert check["unconstrained_error"] <= 1e-12
        assert check["final_difference"] <= 1e-10


BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 0.099"><freejoint/><geom type="sphere" size="0.1"/></body>
  </worldbody>
</mujoco>
"""


def test_warp_called_by_mjx_has_room_and_tells_its_contacts(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    work = make_workload(str(tmp_path / "ball.xml"), nbatch=8, nstep=10)
    contacts = observe(work).peaks.contacts
    model = str(tmp_path / "ball.xml")
    ended, told = measured(available("mjx_warp"), work, tmp_path, model=model, limit_s=120.0)
    assert ended.status == "ok", ended.detail
    assert told["agrees"] is True, told["detail"]
    assert contacts == 1
    assert told["check"]["contact_steps"] > 0
    assert told["check"]["same_count"] == 1.0
    assert told["check"]["normal_degrees"] < 1e-3
    assert "naconmax=384, njmax=8" in told["snippet"]  # 48 of each world; twice 4 of the cone


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("control", "an unconstrained step differs"),
        ("control", "does not have"),
        ("start", "does not have"),
        ("nan", "finite"),
        ("step", "unconstrained steps differ"),
    ],
)
def test_a_wrong_engine_is_refused(wrong: str, said: str) -> None:
    work = make_workload()
    compiled = Pretender(wrong).compile(work, {}, Peaks(0, 0))
    found = accelerated_check.failures(accelerated_run.check(work, compiled, "float64")[0])
    assert any(said in line for line in found), found


@pytest.mark.parametrize("wrong", ["still", "nan", "start"])
def test_a_wrong_engine_is_refused_in_contact_too(wrong: str) -> None:
    work = make_workload("humanoid")
    compiled = Pretender(wrong).compile(work, {}, Peaks(0, 0))
    assert accelerated_check.failures(accelerated_run.check(work, compiled, "float64")[0])


def test_every_simulation_of_a_large_batch_takes_a_step_that_is_judged() -> None:
    work = make_workload(nbatch=300, nstep=4)
    for wrong in ("", "many"):
        compiled = Pretender(wrong).compile(work, {}, Peaks(0, 0))
        found = accelerated_check.failures(accelerated_run.check(work, compiled, "float64")[0])
        assert any("an unconstrained step differs" in line for line in found) == bool(wrong), found


def test_timed_blocks_that_do_nothing_are_told_in_contact_on_a_gpu_too() -> None:
    work = make_workload("humanoid", nbatch=8)
    for wrong in ("", "idle"):
        compiled = Pretender(wrong).compile(work, {}, Peaks(0, 0))
        compiled = dataclasses.replace(compiled, is_deterministic=False)
        checked, reached = accelerated_run.check(work, compiled, "float64")
        assert bool(accelerated_run._other_end(work, compiled, reached, checked)) == bool(wrong)


@pytest.mark.parametrize("exact", [True, False])
def test_a_timed_block_that_ends_elsewhere_than_what_was_checked_is_told(exact: bool) -> None:
    for wrong, said in (("", ""), ("block", "timed blocks end")):
        work = make_workload()
        compiled = Pretender(wrong).compile(work, {}, Peaks(0, 0))
        compiled = dataclasses.replace(compiled, is_deterministic=exact)
        checked, reached = accelerated_run.check(work, compiled, "float64")
        assert accelerated_run._other_end(work, compiled, reached, checked).startswith(said)
        assert bool(accelerated_run._other_end(work, compiled, reached, checked)) == bool(said)


@pytest.mark.parametrize(
    ("name", "result", "within"),
    [("mjx64", "[final.time, final.qpos]", 1e-12), ("warp", "[d.time, d.qpos]", 1e-5)],
)
def test_the_snippet_computes_what_c_computes(
    name: str, result: str, within: float, tmp_path: Path
) -> None:
    path, work = available(name), make_workload()
    np.savez(tmp_path / "in.npz", state=work.initial_state, control=work.control)
    (tmp_path / "run.py").write_text(
        "import numpy as np\n"
        "from mjbench.simulation import models\n"
        "model = models.load(models.resolve('cartpole'))\n"
        "given = np.load('in.npz')\n"
        "initial_state, control = given['state'], given['control']\n"
        f"{path.snippet(work, {})}\n"
        f"rows = [np.asarray(x).reshape(len(initial_state), -1) for x in {result}]\n"
        "np.save('out.npy', np.hstack(rows))\n"
    )
    subprocess.run([sys.executable, "run.py"], cwd=tmp_path, check=True, env=ENVIRONMENT)
    want = trajectory.record_trajectory(work, NBATCH).states[:, work.nstep]
    fields = workload.fields(work.model, want)
    got = np.load(tmp_path / "out.npy")
    assert np.abs(got - np.hstack([fields["time"], fields["qpos"]])).max() < within


def test_a_number_of_steps_that_is_compiled_in_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it is for a GPU."""
    available("mjx64")
    (tmp_path / "fixed.py").write_text(
        "from mjbench.paths.mjx import Mjx64\n"
        "class Fixed(Mjx64):\n"
        "    name = 'fixed:Fixed'\n"
        "    def counts_on_host(self): return True\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    ended, told = measured(
        available("fixed:Fixed"), make_workload(), tmp_path, import_from=str(tmp_path)
    )
    assert ended.status == "ok", ended.detail
    assert told["agrees"] is True, told["agreement"]
    assert len(told["samples"]) >= accelerated_run.LEAST_BLOCKS


@pytest.mark.parametrize("model", ["cartpole", "humanoid"])
def test_the_reference_engine_itself_passes(model: str) -> None:
    work = make_workload(model)
    compiled = Pretender().compile(work, {}, Peaks(0, 0))
    checked, _ = accelerated_run.check(work, compiled, "float64")
    assert accelerated_check.failures(checked) == []
    assert checked.final_difference == 0
    assert checked.final_shadow > 0
    assert bool(checked.contact_steps) == (model == "humanoid")
    json.dumps(dataclasses.asdict(checked), allow_nan=False)


def test_a_program_that_never_returns_is_a_row_that_says_timeout(tmp_path: Path) -> None:
    """The run goes on: the paths before and after it have their speeds."""
    (tmp_path / "hangs.py").write_text(
        "import dataclasses\n"
        "from pretender import Pretender\n"
        "class Hangs(Pretender):\n"
        "    name = 'hangs'\n"
        "    def compile(self, work, options, peaks):\n"
        "        compiled = super().compile(work, options, peaks)\n"
        "        def run():\n"
        "            while True: pass\n"
        "        return dataclasses.replace(compiled, run=run)\n"
        "class Fine(Pretender):\n"
        "    name = 'fine'\n"
    )
    plan = compare.ComparisonPlan(
        variants=(("python_loop", {}), ("hangs:Hangs", {}), ("hangs:Fine", {})),
        nbatch=2,
        nstep=4,
        budget_s=0.0,
        limit_s=3.0,
        import_from=str(tmp_path),
        named=("hangs:Hangs", "hangs:Fine"),
    )
    sys.path.insert(0, str(tmp_path))
    try:
        outcome = compare.compare_model(models.resolve(MODEL), plan, lambda name, share: None)
        found = {r["path"]: r for r in results.of_model(outcome.records)}
    finally:
        sys.path.remove(str(tmp_path))
    assert found["hangs:Hangs"]["status"] == "timeout"
    assert "timing hangs" in found["hangs:Hangs"]["detail"]
    assert found["hangs:Hangs"]["step_ns"] is None
    assert found["python_loop"]["step_ns"]
    assert found["hangs:Fine"]["step_ns"]


def test_a_child_that_takes_too_much_memory_is_killed_and_says_so() -> None:
    ended = isolate.run(
        "tests.isolated_tasks:hoard", {}, lambda m: None, limit_s=30, memory_bytes=300 * 2**20
    )
    assert ended.status == "failed"
    assert "0.3 GiB of memory" in ended.detail


def test_a_missing_package_names_the_extra_that_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjbench.paths.accelerated._is_installed", lambda name: False)
    for name, extra in (
        ("mjx", "mjx"),
        ("mjx64", "mjx"),
        ("mjx_warp", "mjx,warp"),
        ("warp", "warp"),
    ):
        assert f"mjbench[{extra}]" in str(paths.find(name).unavailable())
    assert not {"mjx", "mjx64"} & set(selection.expanded(["usual"]))


def test_a_jax_without_a_device_is_not_said_to_be_the_models_fault(tmp_path: Path) -> None:
    available("mjx")
    words = ["--paths", "mjx", "--nbatch", "2", "--nstep", "4", "--budget", "0"]
    run = mjbench("compare", "cartpole", *words, cwd=tmp_path, env={"JAX_PLATFORMS": "abacus"})
    assert run.returncode == 3
    assert "JAX finds no device" in run.stdout
    assert "does not take" not in run.stdout


def test_warp_is_not_timed_where_trees_sleep(tmp_path: Path) -> None:
    path = available("warp")
    asleep = BALL.replace("<mujoco>", '<mujoco><option><flag sleep="enable"/></option>')
    (tmp_path / "asleep.xml").write_text(asleep)
    assert "sleep" in str(path.unsuited(make_workload(str(tmp_path / "asleep.xml")), {}))


def test_a_model_that_mjx_does_not_take_is_told_with_its_own_reason(tmp_path: Path) -> None:
    path = available("mjx")
    run = mjbench("compare", "cloth", "--paths", path.name, "--budget", "0", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "MJX does not take this model" in run.stdout


def test_a_sweep_measures_every_size_and_shows_it_again(tmp_path: Path) -> None:
    words = ["--paths", "python_loop", "--nbatch", "2,3", "--nstep", "4", "--budget", "0"]
    run = mjbench("compare", "cartpole", *words, "--json", "out.json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    document = json.loads((tmp_path / "out.json").read_text())
    assert [r["nbatch"] for r in document["results"]] == [2, 3]
    assert [a["nbatch"] for a in document["advice"]] == [2, 2, 3, 3]
    shown = mjbench("show", cwd=tmp_path)
    assert "2 simulations × 4 steps" in shown.stdout
    assert "3 simulations × 4 steps" in shown.stdout


def test_sides_that_take_turns_cannot_be_compiled_ones() -> None:
    for words in (
        ["ab", "path=mjx", "path=rollout"],
        ["versions", "3.3.0", "4.0.0", "--paths", "mjx"],
    ):
        run = mjbench(*words)
        assert run.returncode == 2
        assert "mjbench compare --paths mjx" in run.stderr


def test_a_buffer_of_warp_that_was_too_small_is_told() -> None:
    overflow = pytest.importorskip("mujoco_warp").OverflowType
    check_overflow(np.array([0, overflow.ITERATIONS, overflow.LS_ITERATIONS]))
    flags = np.array([0, overflow.NEFC | overflow.ITERATIONS, overflow.NEFC | overflow.CCD])
    with pytest.raises(MachineError, match="overflowed in 2 worlds: NEFC, CCD"):
        check_overflow(flags)
