"""Counting instructions: Callgrind's format, stages, and counts that repeat."""

import dataclasses
import json
import os
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ROOT, mjbench

from mjbench.counts import callgrind, explain, instructions
from mjbench.counts.instructions import Count, Function
from mjbench.instrument import child
from mjbench.releases import installs
from mjbench.simulation import models

HERE = installs.parse_release(installs.INSTALLED)
needs_valgrind = pytest.mark.skipif(
    instructions.unavailable() is not None, reason=str(instructions.unavailable())
)

# main calls mj_step twice; mj_step calls mj_forward, and that mj_collision and itself again.
DUMP = """\
# callgrind format
version: 1
positions: line
events: Ir

fn=(1) main
10 5
cfn=(2) mj_step
calls=2 20
11 1000
fn=(2)
20 100
+1 50
cfn=(3) mj_forward
calls=2 30
* 850
fn=(3)
30 50
cfn=(4) mj_collision
calls=2 40
31 500
cfn=(5) mj_solNewton.isra.0
calls=2 50
32 300
fn=(4)
40 500
fn=(5)
50 300
"""


def test_a_dump_is_read_with_compressed_names_and_relative_positions() -> None:
    profile = callgrind.parse(DUMP)
    assert profile.self_cost == {
        "main": 5,
        "mj_step": 150,
        "mj_forward": 50,
        "mj_collision": 500,
        "mj_solNewton": 300,
    }
    assert profile.total == 1005
    assert profile.inclusive("mj_step") == 1000
    assert profile.inclusive("mj_collision") == 500


def test_functions_of_the_engine_are_those_that_mj_step_reaches() -> None:
    rows = callgrind.parse(DUMP).below("mj_step")
    assert [name for name, _, _ in rows] == [
        "mj_collision",
        "mj_solNewton",
        "mj_step",
        "mj_forward",
    ]


def test_stages_sum_up_to_the_engine() -> None:
    found = instructions.stages(callgrind.parse(DUMP))
    assert found["collision"] == 500
    assert found["solver"] == 300
    assert sum(found.values()) == 1000
    assert found["other"] == 200  # mj_step itself, and mj_forward


def test_recursion_is_not_counted_twice() -> None:
    text = DUMP + "fn=(6) mju_sort'2\n60 7\ncfn=(7) mju_sort\ncalls=1 60\n61 3\n"
    profile = callgrind.parse(text)
    assert profile.self_cost["mju_sort"] == 7
    assert profile.inclusive("mju_sort") == 7


def counted(release: str, **functions: float) -> Count:
    listed = [Function(name, cost, cost) for name, cost in functions.items()]
    return Count(
        "pile",
        release,
        instructions_per_step=sum(functions.values()),
        outside_per_step=1.0,
        functions=listed,
        stages={},
        work={"contacts": 4.0},
    )


def test_what_changed_is_sorted_by_contribution_with_new_and_gone() -> None:
    old = counted("1.0", a=100.0, b=50.0, gone=30.0)
    new = counted("2.0", a=90.0, b=50.0, fresh=200.0)
    found = explain.changes(old, new)
    assert [(c.name, c.difference, c.kind) for c in found] == [
        ("fresh", 200.0, "new"),
        ("gone", -30.0, "gone"),
        ("a", -10.0, ""),
    ]
    assert sum(c.difference for c in found) == (new.instructions_per_step or 0) - 180.0


def test_without_valgrind_one_line_says_how_to_get_it(tmp_path: Path) -> None:
    done = mjbench("instructions", "cartpole", cwd=tmp_path, env={"PATH": str(tmp_path)})
    assert done.returncode == 3
    assert "valgrind: install it" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@needs_valgrind
def test_two_counts_differ_by_at_most_a_tenth_of_a_percent(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Also with another hash seed, with a larger environment, in another folder."""
    sources = [models.resolve(name) for name in ("cartpole", "cube_table")]
    with instructions.Counter() as counter:
        first = counter.count(HERE, sources)
        monkeypatch.setattr(instructions, "HASH_SEED", "7")
        monkeypatch.setenv("PADDING", "x" * 5000)
        monkeypatch.chdir(tmp_path)
        second = counter.count(HERE, sources)
    for one, two in zip(first, second, strict=True):
        assert one.status == two.status == "ok"
        assert one.instructions_per_step == pytest.approx(two.instructions_per_step, rel=1e-3)
        assert one.work == two.work
        assert one.repeats is not None
        assert one.repeats < 1e-3
        stages = one.stages or {}
        assert sum(stages.values()) == pytest.approx(one.instructions_per_step)
        assert 0 <= stages["other"] < 0.3 * sum(stages.values())


@needs_valgrind
def test_a_broken_model_costs_its_own_row(tmp_path: Path) -> None:
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody/></mujoco>")
    sources = [models.resolve(str(broken)), models.resolve("cartpole")]
    with instructions.Counter() as counter:
        first, second = counter.count(HERE, sources)
    assert first.status == "input"
    assert "no degree of freedom" in first.detail
    assert second.status == "ok"


@needs_valgrind
def test_the_command_writes_json(tmp_path: Path) -> None:
    done = mjbench("instructions", "cartpole", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["instructions_per_step"] > 1000
    assert any(f["name"].startswith("mj_kinematics") for f in row["functions"])
    assert list(tmp_path.iterdir()) == [tmp_path / "out.json"]


@pytest.mark.parametrize(
    ("now", "expected"),
    [(1004.0, "same"), (1005.0, "slower"), (1100.0, "slower"), (900.0, "faster")],
)
def test_a_verdict_on_instructions_is_exact(now: float, expected: str) -> None:
    row = explain.verdict(counted("1.0", a=1000.0), counted("2.0", a=now), 0.005)
    assert row["verdict"] == expected
    assert row["ratio"]["low"] < now / 1000 < row["ratio"]["high"]
    assert row["changed_work"] is False


def test_a_step_that_leads_elsewhere_is_changed_work() -> None:
    there, elsewhere = {"qpos": [[1.0]]}, {"qpos": [[1.0 + 1e-6]]}
    old = dataclasses.replace(counted("1.0", a=1000.0), after=there)
    for after, changed in ((there, False), (elsewhere, True)):
        new = dataclasses.replace(counted("2.0", a=1000.0), after=after)
        assert explain.verdict(old, new, 0.005)["changed_work"] is changed
        assert any("changed work" in line for line in explain.sentence(old, new, None)) is changed


def test_a_model_that_could_not_be_counted_has_no_verdict() -> None:
    broken = instructions.Count("m", "2.0", "crashed", "killed by signal 11")
    row = explain.verdict(counted("1.0", a=1000.0), broken, 0.005)
    assert (row["status"], row["verdict"], row["ratio"]) == ("crashed", None, None)
    assert row["detail"] == "MuJoCo 2.0: killed by signal 11"


@needs_valgrind
def test_instructions_can_gate_an_upgrade(tmp_path: Path) -> None:
    done = mjbench(
        *("versions", "installed", "installed", "cartpole", "--metric", "instructions"),
        *("--fail-on", "slower,changed-work", "--min-effect", "0.5%", "--json", "out.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert (row["metric"], row["verdict"], row["changed_work"]) == ("instructions", "same", False)
    assert row["ratio"]["estimate"] == pytest.approx(1.0, abs=1e-3)
    assert "same work" in done.stdout
    again = mjbench("show", cwd=tmp_path)
    assert again.returncode == 0, again.stderr


def test_instructions_are_of_the_plain_loop() -> None:
    done = mjbench("versions", "2.3.7", "4.0.0", "--metric", "instructions", "--paths", "rollout")
    assert done.returncode == 2
    assert "python_loop alone" in done.stderr


@needs_valgrind
def test_a_killed_run_leaves_no_process_and_no_folder(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "instructions", "pile"],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    found: list[int] = []
    while not (found := _processes("callgrind.out", tmp_path)) and process.poll() is None:
        os.sched_yield()
    counting = [os.pidfd_open(pid) for pid in found]
    assert counting
    process.kill()
    process.wait()
    for descriptor in counting:
        ended, _, _ = select.select([descriptor], [], [], 60.0)  # long only where the test fails
        assert ended
        os.close(descriptor)
    assert list(tmp_path.iterdir())
    environment = {"TMPDIR": str(tmp_path)}
    assert mjbench("models", "cartpole", cwd=tmp_path, env=environment).returncode == 0
    assert list(tmp_path.iterdir()) == []


def _processes(*words: object) -> list[int]:
    """Return the processes whose command lines hold all words."""
    lines = {int(f.parent.name): child.text(f) for f in Path("/proc").glob("[0-9]*/cmdline")}
    return [pid for pid, line in lines.items() if all(str(word) in line for word in words)]


@needs_valgrind
def test_counts_agree_with_bracketing_by_two_step_counts() -> None:
    """A second method: what 40 steps cost more than 20, in one call of the engine each."""
    with instructions.Counter() as counter:
        (count,) = counter.count(HERE, [models.resolve("cartpole")])
    totals = {n: _total(n) for n in (20, 40)}
    per_step = (totals[40] - totals[20]) / 20
    assert count.instructions_per_step == pytest.approx(per_step, rel=0.02)


@needs_valgrind
def test_counts_agree_with_those_of_the_processor(tmp_path: Path) -> None:
    """An instrument of its own, where the machine has one: `perf stat`, bracketed likewise."""
    if shutil.which("perf") is None:
        pytest.skip("perf is not installed")
    totals = {n: _retired(n, tmp_path / "perf.csv") for n in (2000, 4000)}
    with instructions.Counter() as counter:
        (count,) = counter.count(HERE, [models.resolve("cartpole")])
    per_step = (totals[4000] - totals[2000]) / 2000
    assert count.instructions_per_step == pytest.approx(per_step, rel=0.05)


def _program(nstep: int) -> tuple[str, dict[str, str]]:
    code = (
        "import mujoco; from mjbench.simulation import models, workload;"
        "m = models.load(models.resolve('cartpole')); d = workload.start_data(m);"
        f"mujoco.mj_step(m, d, {nstep})"
    )
    environment = {**os.environ, "GLIBC_TUNABLES": instructions.TUNABLES}
    return code, environment | {"PYTHONHASHSEED": "0", "PYTHONPATH": str(ROOT)}


def _retired(nstep: int, out: Path) -> int:
    code, environment = _program(nstep)
    perf = ["perf", "stat", "-x,", "-e", "instructions:u", "-o", str(out)]
    subprocess.run([*perf, sys.executable, "-c", code], env=environment, check=False)
    found = [line.split(",")[0] for line in child.text(out).splitlines() if "instructions" in line]
    if not found or not found[0].isdigit():
        pytest.skip(f"this machine counts no instructions: {(found or ['nothing'])[0]}")
    return int(found[0])


def _total(nstep: int) -> int:
    code, environment = _program(nstep)
    done = subprocess.run(
        [
            *("valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"),
            *("--toggle-collect=mj_step", sys.executable, "-c", code),
        ],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    (line,) = [x for x in done.stderr.splitlines() if "Collected :" in x]
    return int(line.split(":")[1])
