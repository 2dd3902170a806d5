"""MJX and Warp: the same workload, judged by tolerances, killed where they do not return."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench import (
    agreement,
    apart,
    compare,
    isolate,
    models,
    paths,
    selection,
    stats,
    trajectory,
    workload,
)
from mjbench.errors import InputError, MachineError
from mjbench.paths.accelerated import (
    Accelerated,
    After,
    Compiled,
    check_overflow,
    final,
    hand_over,
    start_fields,
)
from mjbench.paths.base import States
from mjbench.report import results
from mjbench.work import Peaks, observe
from tests.commands import PYTHONPATH, mjbench

ENVIRONMENT = {**os.environ, "PYTHONPATH": PYTHONPATH}
RUNS = Path(__file__).parent.parent / "results/runs"
FREE = "cartpole"
NBATCH, NSTEP = 4, 20


def made(name: str = FREE, nbatch: int = NBATCH, nstep: int = NSTEP) -> workload.Workload:
    return workload.make(models.load(models.resolve(name)), nbatch, nstep, hold=2)


def available(name: str) -> Accelerated:
    path = paths.find(name)
    assert isinstance(path, Accelerated)
    reason = path.unavailable()
    if reason:
        pytest.skip(reason)
    return path


def measured(
    path: Accelerated, work: workload.Workload, folder: Path, **more: Any
) -> tuple[isolate.Ended, dict[str, Any]]:
    """Return how a child ended, and all it told."""
    file = folder / "work.pickle"
    hand_over(work, observe(work).peaks, file)
    told: dict[str, Any] = {"samples": []}

    def take(message: isolate.Message) -> None:
        if message["kind"] == "sample":
            told["samples"].append(message["seconds"])
        told.update(message)

    source = models.resolve(more.pop("model", FREE))
    return apart.run(source, path.name, {}, file, take, **more), told


@pytest.mark.parametrize(("name", "nstep"), [("mjx", NSTEP), ("mjx64", 500), ("warp", NSTEP)])
def test_the_cart_pole_keeps_to_the_tolerances(name: str, nstep: int, tmp_path: Path) -> None:
    work = made(nstep=nstep)
    ended, told = measured(available(name), work, tmp_path)
    assert ended.status == "ok", ended.detail
    assert told["agrees"] is True, told["detail"]
    assert len(told["samples"]) >= apart.LEAST_BLOCKS
    assert told["compile_s"] > 0
    assert told["device"]
    assert told["memory_bytes"] > 2**20
    # the very same workload, in the child and on its device
    assert told["workload_digest"] == work.digest()
    check = told["check"]
    assert check["received"] is True
    assert check["free_steps"] == min(NBATCH * nstep, apart.MOST_SINGLES)
    assert check["final_nstep"] == nstep
    if name == "mjx64":
        assert check["free_stray"] <= 1e-12
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
    work = made(str(tmp_path / "ball.xml"), nbatch=8, nstep=10)
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


class Pretender(Accelerated):
    """C itself under another name, with something wrong, to see what the check makes of it."""

    name = "pretender"
    summary = "wrong on purpose"
    precision = "float64"
    extra = "none"
    packages = ()

    def __init__(self, wrong: str = "") -> None:
        self.wrong = wrong

    def device_kind(self) -> str:
        return "cpu"

    def fields(self, model: Any) -> Any:
        return workload.fields(model, made().initial_state)

    def snippet(self, workload: Any, options: Any) -> str:
        return ""

    def compiled(self, work: Any, options: Any, peaks: Any) -> Compiled:
        def advance(fields: Any, control: np.ndarray, nstep: int) -> After:
            rows = workload.states(work.model, fields)
            if self.wrong == "control":
                control = np.roll(control, 1, axis=0) + 0.1
            given = workload.Workload(work.model, rows, control, work.hold, 0)
            states = trajectory.run(with_steps(given, nstep), work.nbatch).states
            after = workload.fields(work.model, states[:, nstep])
            after.pop("ctrl", None)
            if self.wrong == "nan":
                after["qvel"][1] = np.nan
            if self.wrong == "many" and len(rows) > 256:  # as if a buffer ended there
                after["qpos"][256:] = fields["qpos"][256:]
            after["ctrl"] = given.step_control[:, max(nstep - 1, 0)]
            if self.wrong == "step" and nstep > 1:
                after |= workload.fields(work.model, states[:, nstep - 1])
            if self.wrong == "still":
                after |= fields
            if self.wrong == "start":
                after["qpos"] = after["qpos"] + 1e-16
            return After(after, None)

        def final_states() -> States:
            nstep = work.nstep - {"block": 1, "idle": work.nstep}.get(self.wrong, 0)
            return final(work, advance(start_fields(work), work.control, nstep).fields)

        return Compiled(_nothing, _nothing, final_states, device="cpu", advance=advance)


def _nothing() -> None:
    pass


def with_steps(work: workload.Workload, nstep: int) -> workload.Workload:
    """Return a workload of as many steps, each with the control that it would have had."""
    control = np.ascontiguousarray(work.step_control[:, :nstep])
    return workload.Workload(work.model, work.initial_state, control, 1, 0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("control", "free step strays"),
        ("control", "does not hold"),
        ("start", "does not hold"),
        ("nan", "finite"),
        ("step", "free steps stray"),
    ],
)
def test_a_wrong_engine_is_refused(wrong: str, said: str) -> None:
    work = made()
    compiled = Pretender(wrong).compiled(work, {}, Peaks(0, 0))
    found = agreement.failures(apart.check(work, compiled, "float64")[0])
    assert any(said in line for line in found), found


@pytest.mark.parametrize("wrong", ["still", "nan", "start"])
def test_a_wrong_engine_is_refused_in_contact_too(wrong: str) -> None:
    work = made("humanoid")
    compiled = Pretender(wrong).compiled(work, {}, Peaks(0, 0))
    assert agreement.failures(apart.check(work, compiled, "float64")[0])


def test_every_simulation_of_a_large_batch_takes_a_step_that_is_judged() -> None:
    work = made(nbatch=300, nstep=4)
    for wrong in ("", "many"):
        compiled = Pretender(wrong).compiled(work, {}, Peaks(0, 0))
        found = agreement.failures(apart.check(work, compiled, "float64")[0])
        assert any("a free step strays" in line for line in found) == bool(wrong), found


def test_timed_blocks_that_do_nothing_are_told_in_contact_on_a_gpu_too() -> None:
    work = made("humanoid", nbatch=8)
    for wrong in ("", "idle"):
        compiled = Pretender(wrong).compiled(work, {}, Peaks(0, 0))
        compiled.exact = False
        checked, reached = apart.check(work, compiled, "float64")
        assert bool(apart._other_end(work, compiled, reached, checked)) == bool(wrong)


@pytest.mark.parametrize("exact", [True, False])
def test_a_timed_block_that_ends_elsewhere_than_what_was_checked_is_told(exact: bool) -> None:
    for wrong, said in (("", ""), ("block", "timed blocks end")):
        work = made()
        compiled = Pretender(wrong).compiled(work, {}, Peaks(0, 0))
        compiled.exact = exact
        checked, reached = apart.check(work, compiled, "float64")
        assert apart._other_end(work, compiled, reached, checked).startswith(said)
        assert bool(apart._other_end(work, compiled, reached, checked)) == bool(said)


@pytest.mark.parametrize(
    ("name", "result", "within"),
    [("mjx64", "[final.time, final.qpos]", 1e-12), ("warp", "[d.time, d.qpos]", 1e-5)],
)
def test_the_snippet_computes_what_c_computes(
    name: str, result: str, within: float, tmp_path: Path
) -> None:
    path, work = available(name), made()
    np.savez(tmp_path / "in.npz", state=work.initial_state, control=work.control)
    (tmp_path / "run.py").write_text(
        "import numpy as np\n"
        "from mjbench import models\n"
        "model = models.load(models.resolve('cartpole'))\n"
        "given = np.load('in.npz')\n"
        "initial_state, control = given['state'], given['control']\n"
        f"{path.snippet(work, {})}\n"
        f"rows = [np.asarray(x).reshape(len(initial_state), -1) for x in {result}]\n"
        "np.save('out.npy', np.hstack(rows))\n"
    )
    subprocess.run([sys.executable, "run.py"], cwd=tmp_path, check=True, env=ENVIRONMENT)
    want = trajectory.run(work, NBATCH).states[:, work.nstep]
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
    ended, told = measured(available("fixed:Fixed"), made(), tmp_path, import_from=str(tmp_path))
    assert ended.status == "ok", ended.detail
    assert told["agrees"] is True, told["agreement"]
    assert len(told["samples"]) >= apart.LEAST_BLOCKS


@pytest.mark.parametrize("model", ["cartpole", "humanoid"])
def test_the_reference_engine_itself_passes(model: str) -> None:
    work = made(model)
    compiled = Pretender().compiled(work, {}, Peaks(0, 0))
    checked, _ = apart.check(work, compiled, "float64")
    assert agreement.failures(checked) == []
    assert checked["final_difference"] == 0
    assert checked["final_shadow"] > 0
    assert bool(checked["contact_steps"]) == (model == "humanoid")
    json.dumps(checked, allow_nan=False)


def test_a_program_that_never_returns_is_a_row_that_says_timeout(tmp_path: Path) -> None:
    """The run goes on: the paths before and after it have their speeds."""
    (tmp_path / "hangs.py").write_text(
        "import time\n"
        "from tests.test_accelerated import Pretender\n"
        "class Hangs(Pretender):\n"
        "    name = 'hangs'\n"
        "    def compiled(self, work, options, peaks):\n"
        "        found = super().compiled(work, options, peaks)\n"
        "        def run():\n"
        "            while True: pass\n"
        "        found.run = run\n"
        "        return found\n"
        "class Fine(Pretender):\n"
        "    name = 'fine'\n"
    )
    plan = compare.Plan(
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
        outcome = compare.compare_model(models.resolve(FREE), plan, lambda name, share: None)
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
    monkeypatch.setattr("mjbench.paths.accelerated._installed", lambda name: False)
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
    assert "sleep" in str(path.unsuited(made(str(tmp_path / "asleep.xml")), {}))


def test_words_stand_for_several_paths() -> None:
    c = selection.expanded(["c"])
    assert "rollout" in c
    assert "mjx" not in c
    assert selection.expanded(["mjx", "c", "rollout"]) == ["mjx", *c]
    assert selection.rivals(["mjx"])
    assert selection.rivals(["mjx", "rollout"]) == []


def test_a_model_that_mjx_does_not_take_is_told_with_its_own_reason(tmp_path: Path) -> None:
    path = available("mjx")
    run = mjbench("compare", "cloth", "--paths", path.name, "--budget", "0", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "MJX does not take this model" in run.stdout


def row(path: str, nbatch: int, ns: float, **more: Any) -> dict[str, Any]:
    common = {"model": "m", "path": path, "options": {}, "nbatch_asked": nbatch, "nbatch": nbatch}
    return common | {"steps_per_s": 1e9 / ns, "step_ns": {"median": ns}} | more


def test_the_crossover_is_the_size_from_which_on_a_path_stays_ahead() -> None:
    rows = [
        *(row("python_loop", n, 100.0) for n in (1, 16, 64, 256)),
        *(row("rollout", n, 50.0) for n in (1, 16, 64, 256)),
    ]
    speeds = {1: 900.0, 16: 49.0, 64: 51.0, 256: 10.0}
    rows += [row("mjx", n, ns, precision="float32") for n, ns in speeds.items()]
    rows += [row("mjx64", n, 60.0, precision="float64") for n in speeds]
    first, second = results.crossovers(rows)
    assert (first["path"], first["nbatch"], first["rival"]["path"]) == ("mjx", 256, "rollout")
    assert (second["path"], second["nbatch"], second["largest"]) == ("mjx64", None, 256)
    for found in rows:
        found["check"] = {"free_steps": 0} if "precision" in found else None
    assert results.crossovers(rows) == []  # held to nothing


def test_results_that_differ_in_identity_are_not_compared_unless_asked() -> None:
    old = stats.Measured([1.0] * 9, {"jax": "0.10.1", "device": "cpu"})
    new = stats.Measured([2.0] * 9, {"jax": "0.10.2", "device": "cpu"})
    with pytest.raises(InputError, match=r"differ in jax \(0.10.2, 0.10.1\)"):
        stats.unpaired(new, old)
    assert stats.unpaired(new, old, across=True).median == pytest.approx(2.0)
    assert stats.unpaired(old, old).median == pytest.approx(1.0)


def run_file(folder: Path, name: str, jax: str, seconds: float) -> Path:
    machine = {"cpu": "c", "versions": {"jax": jax}, "flags": {}}
    measurement = {
        "type": "measurement",
        "model": "m",
        "path": "mjx",
        "options": {},
        "nbatch": 2,
        "nstep": 5,
        "status": "ok",
        "agrees": True,
        "precision": "float32",
        "device": "cpu",
        "workload_digest": "w",
        "samples_s": [seconds] * 9,
    }
    head = {"type": "run", "schema": 1, "command": "compare", "machine": machine}
    file = folder / name
    file.write_text(f"{json.dumps(head)}\n{json.dumps(measurement)}\n")
    return file


def test_diff_compares_run_files_and_refuses_other_versions_of_jax(tmp_path: Path) -> None:
    old = run_file(tmp_path, "old.jsonl", "1", 1.0)
    new = run_file(tmp_path, "new.jsonl", "2", 1.5)
    refused = mjbench("diff", str(old), str(new))
    assert refused.returncode == 2
    assert "they differ in jax (2, 1)" in refused.stdout
    alone = mjbench("diff", str(old), str(RUNS / "reference-selfcheck-quiet.jsonl"))
    assert alone.returncode == 2
    assert "no timed row" in alone.stderr
    compared = mjbench("diff", str(old), str(new), "--across", "--json", "-")
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["results"][0]["ratio"]["estimate"] == pytest.approx(1.5)


def check_of(precision: str, **strays: float) -> dict[str, Any]:
    kinds = ("free", "constrained", "contact")
    return {"precision": precision} | {f"{k}_stray": strays.get(k) for k in kinds}


@pytest.mark.parametrize(
    ("precision", "shadow", "stray", "difference", "passes"),
    [
        ("float32", 1e-6, 1e-8, 9e-6, True),
        ("float32", 1e-6, 1e-8, 1.1e-5, False),
        ("float32", 1e-9, 2e-6, 1.9e-5, True),  # a lucky shadow of one step
        ("float32", 1e-9, 2e-6, 2.1e-5, False),
        ("float64", 1e-6, 1e-13, 0.9e-10, True),
        ("float64", 1e-6, 1e-13, 1.1e-10, False),
    ],
)
def test_a_free_run_is_held_to_the_shadow_or_to_single_steps(
    precision: str, shadow: float, stray: float, difference: float, passes: bool
) -> None:
    run = {"received": True, "still": False, "lost": 0, "free_nstep": 3}
    strays = {"free_shadow": shadow, "free_difference": difference}
    found = agreement.failures(check_of(precision, free=stray) | run | strays)
    assert found == [] if passes else "3 free steps stray" in found[0]


def test_float64_tells_precision_from_algorithm() -> None:
    coarse = check_of("float32", contact=1e-2)
    assert agreement.cause(coarse, check_of("float64", contact=1e-9)).startswith("precision")
    assert agreement.cause(coarse, check_of("float64", contact=9e-3)).startswith("algorithm")


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


def test_buffers_are_sized_by_the_peak_of_the_reference_run() -> None:
    work = made("cube_table", nbatch=3, nstep=10)
    found = observe(work).peaks
    run = trajectory.run(work, work.nbatch)
    singles = trajectory.singles(work, run, 10**6, rounded=False)
    assert found.contacts == singles.contacts.counts(len(singles.state)).max() > 0
    assert found.constraints == singles.constraints.max() > 0


def test_contacts_of_two_engines_are_matched_by_geoms_and_nearest_normal() -> None:
    ours = trajectory.Contacts.of([0, 0], [[3, 1], [1, 3]], [[0, 0, -1], [0, 1, 0]])
    assert ours.geom.tolist() == [[1, 3], [1, 3]]
    assert ours.normal.tolist() == [[0, 0, 1], [0, 1, 0]]
    tilted = np.array([[0, np.sin(0.1), np.cos(0.1)]])
    theirs = trajectory.Contacts.of([0], [[1, 3]], tilted)
    assert agreement.normal_angle(ours, theirs) == pytest.approx(np.degrees(0.1))
    elsewhere = trajectory.Contacts.of([1], [[1, 3]], tilted)
    assert agreement.normal_angle(ours, elsewhere) is None
