"""Paired comparison: the protocol, its failures, and what it leaves behind."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import PYTHONPATH, ROOT, mjbench

from mjbench.errors import InputError
from mjbench.paired import protocol, verdict
from mjbench.paired.protocol import Launch, Sizes, Target, TargetPair
from mjbench.paired.worker_pool import TargetError, WorkerPool
from mjbench.releases import installs
from mjbench.simulation import models

HERE = installs.parse_release(installs.INSTALLED)
CARTPOLE = models.resolve("cartpole")
CUBES = models.resolve("cube_table")
# Verdicts cost time, and their rate is not what is tested here.
BRIEF = verdict.VerdictPlan(time_limit_s=0.1)


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(limit_s=30.0) as made:
        yield made


def children() -> set[int]:
    """Return the process ids of everything below this process."""
    parent = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, above = file.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parent[int(file.parent.name)] = int(above)
    found, new = set(), {os.getpid()}
    while new:
        new = {p for p, pp in parent.items() if pp in new}
        found |= new
    return found


# launches


def test_a_launch_takes_turns_in_balanced_quads(pool: WorkerPool) -> None:
    pair = TargetPair(pool, Target(HERE, CUBES), Target(HERE, CUBES))
    launch = pair.launch()
    pair.close()
    assert set(launch.orders) <= {"ABBA", "BAAB"}
    assert launch.ns.shape == (len(launch.orders), 4)
    assert len(launch.orders) >= protocol.LEAST_QUADS
    assert (launch.ns > 0).all()


def test_the_log_ratio_of_a_quad_is_new_over_old_whatever_the_order() -> None:
    ns = np.array([[100.0, 200.0, 200.0, 100.0], [200.0, 100.0, 100.0, 200.0]])
    launch = Launch(None, None, ["ABBA", "BAAB"], ns)
    assert np.exp(launch.log_ratios()) == pytest.approx(np.full((2, 2), 2.0))


def test_what_the_order_of_turns_costs_cancels_within_a_quad() -> None:
    second_is_slower = np.array([[100.0, 101.0, 100.0, 101.0]])
    launch = Launch(None, None, ["ABBA"], second_is_slower)
    assert launch.log_ratios() == pytest.approx(np.log([[1.01, 1 / 1.01]]))
    assert launch.value == pytest.approx(0.0)


def test_drift_of_the_machine_cancels_within_a_quad() -> None:
    drifting = np.exp(np.array([[0.0, 0.1, 0.2, 0.3]]))
    assert Launch(None, None, ["BAAB"], drifting).value == pytest.approx(0.0)


def test_both_sides_run_on_one_core(pool: WorkerPool) -> None:
    if not hasattr(os, "sched_getaffinity"):
        pytest.skip("no affinity on this system")
    allowed = os.sched_getaffinity(0)
    pair = TargetPair(pool, Target(HERE, CARTPOLE), Target(HERE, CARTPOLE))
    launch = pair.launch()
    pair.close()
    assert launch.core in allowed
    assert os.sched_getaffinity(0) == allowed


def test_the_processes_of_both_sides_sit_on_the_core_of_this_one(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not hasattr(os, "sched_getaffinity"):
        pytest.skip("no affinity on this system")
    seen: list[set[int]] = []
    quads = protocol._quads

    def spying(old: Any, new: Any, count: int) -> Any:
        seen.extend(os.sched_getaffinity(pid) for pid in (0, old.pid, new.pid))
        return quads(old, new, count)

    monkeypatch.setattr(protocol, "_quads", spying)
    pair = TargetPair(pool, Target(HERE, CARTPOLE), Target(HERE, CARTPOLE))
    launch = pair.launch()
    pair.close()
    assert seen == [{launch.core}] * 3 * protocol.LAYOUTS


def test_every_launch_is_a_new_process(pool: WorkerPool, monkeypatch: pytest.MonkeyPatch) -> None:
    pids: list[int] = []
    quads = protocol._quads

    def spying(old: Any, new: Any, count: int) -> Any:
        pids.extend((old.pid, new.pid))
        return quads(old, new, count)

    monkeypatch.setattr(protocol, "_quads", spying)
    pair = TargetPair(pool, Target(HERE, CARTPOLE), Target(HERE, CARTPOLE))
    for _ in range(3):
        pair.launch()
    pair.close()
    assert len(pids) == 6 * protocol.LAYOUTS
    assert len(set(pids)) == 6


def test_models_of_different_size_do_as_many_simulations_each(
    pool: WorkerPool, tmp_path: Path
) -> None:
    file = tmp_path / "other.xml"
    file.write_text(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    old, new = Target(HERE, CARTPOLE), Target(HERE, models.resolve(str(file)))
    pair = TargetPair(pool, old, new, Sizes(nbatch=3))
    launch = pair.launch()
    pair.close()
    assert pair.work_check.nbatch == 3
    assert pair.work_check.drift is None
    assert (launch.ns > 0).all()


@pytest.fixture
def stiff(tmp_path: Path) -> models.ModelSource:
    """Return a spring that a timestep of 2.5 ms blows up, by about four in each step."""
    file = tmp_path / "stiff.xml"
    file.write_text(
        "<mujoco><option timestep='1e-4' integrator='Euler'/><worldbody><body>"
        "<joint type='slide' stiffness='1e5'/><geom size='.1' mass='.1'/></body>"
        "</worldbody></mujoco>"
    )
    return models.resolve(str(file))


def test_simulations_that_diverge_on_one_side_only_are_changed_work(
    pool: WorkerPool, stiff: models.ModelSource
) -> None:
    new = Target(HERE, stiff, model_options={"timestep": "0.0025"})
    pair = TargetPair(pool, Target(HERE, stiff), new, Sizes(nbatch=8, nstep=13))
    launch = pair.launch()
    pair.close()
    assert pair.work_check.diverged[0] == 0
    assert 0 < pair.work_check.diverged[1] < 8
    assert pair.work_check.nbatch == 8 - pair.work_check.diverged[1]
    assert verdict.changed(pair.work_check)
    assert (launch.ns > 0).all()


def test_a_side_on_which_every_simulation_diverges_is_told(
    pool: WorkerPool, stiff: models.ModelSource
) -> None:
    new = Target(HERE, stiff, model_options={"timestep": "0.0025"})
    outcome = verdict.decide(
        pool, Target(HERE, stiff), new, replace(BRIEF, sizes=Sizes(nbatch=4, nstep=50))
    )
    assert outcome.status == "input"
    assert "every simulation diverges (BADQACC in 4)" in outcome.detail


def test_sides_with_threads_are_not_pinned_and_their_cores_are_calibrated(pool: WorkerPool) -> None:
    side = Target(HERE, CARTPOLE, "rollout", {"threads": 2})
    pair = TargetPair(pool, side, side)
    launch = pair.launch()
    pair.close()
    assert launch.core is None
    assert launch.cores is not None
    assert launch.cores > 0


def test_both_sides_do_the_same_work_from_the_same_start(pool: WorkerPool) -> None:
    pair = TargetPair(pool, Target(HERE, CUBES), Target(HERE, CUBES))
    pair.close()
    assert pair.work_check.old == pair.work_check.new
    assert pair.work_check.drift == 0.0
    assert not verdict.changed(pair.work_check)


def test_other_work_is_told(pool: WorkerPool) -> None:
    new = Target(HERE, CUBES, model_options={"iterations": "1", "solver": "cg"})
    pair = TargetPair(pool, Target(HERE, CUBES), new)
    pair.close()
    assert verdict.changed(pair.work_check)


def test_a_known_slowdown_is_a_share_of_the_simulations(pool: WorkerPool) -> None:
    side = Target(HERE, CARTPOLE)
    outcome = verdict.decide(
        pool, side, replace(side, slowdown=1.0), replace(BRIEF, sizes=Sizes(nbatch=4, nstep=50))
    )
    assert outcome.status == "ok"
    assert outcome.judgement is not None
    assert outcome.judgement.ratio > 1.5  # twice the work


# failures: a line, and nothing left


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return a function that makes the worker's method misbehave on one model."""

    def plant(method: str, code: str) -> None:
        (tmp_path / "sitecustomize.py").write_text(
            "import os, time, signal\n"
            "import importlib.abc, importlib.machinery, sys\n"
            "def bad(self, *args, **named):\n"
            f"    {code}\n"
            "class Loader(importlib.abc.Loader):\n"
            "    def __init__(self, inner): self.inner = inner\n"
            "    def create_module(self, spec): return self.inner.create_module(spec)\n"
            "    def exec_module(self, module):\n"
            "        self.inner.exec_module(module)\n"
            f"        module.Worker.{method} = bad\n"
            "class Finder(importlib.abc.MetaPathFinder):\n"
            "    def find_spec(self, name, path, target=None):\n"
            "        if name != 'mjbench.paired.worker': return None\n"
            "        spec = importlib.machinery.PathFinder.find_spec(name, path)\n"
            "        spec.loader = Loader(spec.loader)\n"
            "        return spec\n"
            "sys.meta_path.insert(0, Finder())\n"
        )
        monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{ROOT}")

    return plant


@pytest.mark.parametrize(
    ("method", "code", "said"),
    [
        ("do_load", "os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV) while loading the model"),
        ("do_observe", "os._exit(3)", "exit code 3 while stepping the model"),
        ("do_prepare", "time.sleep(60)", "no answer within 5 s while preparing a run"),
        ("_block", "os.kill(os.getpid(), signal.SIGKILL)", "SIGKILL) while"),
        ("_block", "return -5", "says that a block took -5 ns"),
        ("do_start", "raise RuntimeError('half a release')", "RuntimeError: half a release"),
        ("do_make", "raise MemoryError", "out of memory"),
    ],
)
def test_a_side_that_misbehaves_is_told_in_a_line_and_leaves_nothing(
    broken: Any, method: str, code: str, said: str
) -> None:
    before = children()
    broken(method, code)
    with WorkerPool(limit_s=5.0 if "sleep" in code else 30.0) as made:
        outcome = verdict.decide(made, Target(HERE, CARTPOLE), Target(HERE, CARTPOLE), BRIEF)
    assert outcome.status == "failed"
    assert said in outcome.detail
    assert "\n" not in outcome.detail
    assert "MuJoCo" in outcome.detail
    assert children() <= before


def test_a_model_that_does_not_load_is_bad_input(pool: WorkerPool, tmp_path: Path) -> None:
    file = tmp_path / "empty.xml"
    file.write_text("")
    source = models.resolve(str(file))
    outcome = verdict.decide(pool, Target(HERE, source), Target(HERE, source), BRIEF)
    assert outcome.status == "input"
    assert "cannot load it" in outcome.detail


@pytest.mark.parametrize(
    ("options", "said"),
    [({"solver": "magic"}, "one of cg, newton, pgs"), ({"speed": "9"}, "no option 'speed'")],
)
def test_an_option_that_does_not_exist_is_bad_input(
    pool: WorkerPool, options: dict[str, str], said: str
) -> None:
    with pytest.raises(InputError) as caught:
        TargetPair(pool, Target(HERE, CARTPOLE, model_options=options), Target(HERE, CARTPOLE))
    assert said in str(caught.value).lower()


def test_a_path_that_computes_something_else_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    tests = Target(HERE, CUBES, "wrong_paths:ColdWarmStart")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"))
    with WorkerPool(limit_s=30.0) as made:
        pair = TargetPair(made, tests, tests)
        with pytest.raises(TargetError, match="does not reach the final states"):
            pair.launch()


def test_time_runs_out_with_an_interval_and_no_verdict(pool: WorkerPool) -> None:
    ticks = iter(range(0, 10_000, 100))
    outcome = verdict.decide(
        pool,
        Target(HERE, CARTPOLE),
        Target(HERE, CARTPOLE),
        verdict.VerdictPlan(time_limit_s=250.0),
        clock=lambda: float(next(ticks)),
    )
    assert outcome.judgement is not None
    assert outcome.judgement.verdict == "inconclusive"
    assert outcome.judgement.launches == 2


# the commands


def test_versions_gives_a_table_a_sentence_and_json(tmp_path: Path) -> None:
    done = mjbench(
        *("versions", "installed", "installed", "cube_table", "--time-limit", "0.2s"),
        *("--json", "out.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["changed_work"] is False
    assert row["drift"] == 0.0
    assert row["work"]["old"]["contacts"] > 0
    assert row["launches"] >= 1
    assert row["pairs"] >= 2 * protocol.LEAST_QUADS
    assert "cube_table" in done.stdout
    assert "same work" in done.stdout
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    _, record = map(json.loads, file.read_text().splitlines())
    assert len(record["samples"]) == row["launches"]
    again = mjbench("show", cwd=tmp_path)
    assert again.returncode == 0
    assert "same work" in again.stdout


def test_changed_work_can_fail_the_command(tmp_path: Path) -> None:
    words = ("ab", "model=cube_table", "iterations=1,solver=cg", "--time-limit", "0.2s")
    assert mjbench(*words, "--fail-on", "changed-work", cwd=tmp_path).returncode == 1
    assert mjbench(*words, cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("versions", "installed"), "name an OLD and a NEW release"),
        (("versions", "installed", "installed", "no_such_model"), "no model 'no_such_model'"),
        (("versions", "missing.whl", "installed"), "no such wheel"),
        (("versions", "installed", "installed", "--fail-on", "tea"), "'tea' is not one of"),
        (("versions", "installed", "installed", "--min-effect", "0"), "not between 0% and 100%"),
        (("versions", "installed", "installed", "--time-limit", "soon"), "no time such as 60s"),
        (("ab", "path=nothing", "path=rollout"), "no path 'nothing'"),
        (("ab", "speed=1", "path=rollout"), "no 'speed'"),
        (("ab", "threads", "path=rollout"), "is not KEY=VALUE"),
        (("selfcheck", "--slowdowns", "0.3"), "no whole number"),
    ],
)
def test_bad_words_are_told_in_a_line(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    done = mjbench(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr


def test_a_side_that_fails_ends_in_exit_code_3(tmp_path: Path, broken: Any) -> None:
    broken("do_load", "os._exit(7)")
    done = mjbench(
        *("versions", "installed", "installed", "cartpole"),
        cwd=tmp_path,
        env={"PYTHONPATH": os.environ["PYTHONPATH"]},
    )
    assert done.returncode == 3
    assert "old side" in done.stdout


def test_ctrl_c_keeps_what_was_measured_and_leaves_nothing(tmp_path: Path) -> None:
    before = children()
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "selfcheck", "cartpole", "--slowdowns", "0"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while len(children() - before) < 4 and time.monotonic() < deadline:
        os.sched_yield()
    descriptors = [os.pidfd_open(pid) for pid in children() - before - {process.pid}]
    assert len(descriptors) >= 2
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    for descriptor in descriptors:
        ended, _, _ = select.select([descriptor], [], [], 60.0)  # long only where the test fails
        assert ended
        os.close(descriptor)


def test_selfcheck_tells_the_share_of_errors(tmp_path: Path) -> None:
    done = mjbench(
        *("selfcheck", "cartpole", "--trials", "1", "--slowdowns", "0,5", "--time-limit", "0.2s"),
        *("--json", "out.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    again = mjbench("show", "--json", "again.json", cwd=tmp_path)
    assert again.returncode == 0
    assert json.loads((tmp_path / "again.json").read_text())["results"] == rows
    assert [(r["model"], r["slowdown"], r["trials"]) for r in rows] == [
        ("cartpole", 0.0, 1),
        ("cartpole", 0.05, 1),
    ]
