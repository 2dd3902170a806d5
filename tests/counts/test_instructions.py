"""Counting instructions: counts that repeat, agree with other methods, and leave nothing behind."""

import json
import os
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import pytest
from commands import ROOT, mjbench, mjbench_process

from mjbench.counts import instructions
from mjbench.counts.counted_program import OperationRequest
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.host import machine
from mjbench.paired import operations
from mjbench.releases import release_names
from mjbench.simulation import models
from mjbench.status import Status

INSTALLED = release_names.parse_release(release_names.INSTALLED)
MODELS = ("cartpole", "cube_table")
OPERATIONS = (
    OperationRequest("load cartpole", models.resolve("cartpole"), operations.load, 1),
    OperationRequest("copy pile", models.resolve("pile"), operations.copy_data, 1),
)
# Steps from keyframe 0, as the counted program does; a marker follows each number of steps.
PROGRAM = """
#include <chrono>
#include <cstdlib>
#include <mujoco/mujoco.h>

static const auto begin = std::chrono::steady_clock::now();
static mjtNum seconds() {
  return std::chrono::duration<mjtNum>(std::chrono::steady_clock::now() - begin).count();
}

int main(int argc, char** argv) {
  mjModel* model = mj_loadXML(argv[1], nullptr, nullptr, 0);
  mjData* data = mj_makeData(model);
  mjcb_time = seconds;
  for (int i = 2; i < argc; i++) {
    mj_resetDataKeyframe(model, data, 0);
    for (int step = 0; step < std::atoi(argv[i]); step++) mj_step(model, data);
    mj_version();
  }
}
"""
ENVIRONMENT = {**os.environ, "GLIBC_TUNABLES": instructions.TUNABLES}
needs_valgrind = pytest.mark.skipif(
    instructions.unavailable() is not None, reason=str(instructions.unavailable())
)


@pytest.fixture(scope="module")
def counter() -> Iterator[InstructionCounter]:
    with InstructionCounter() as counter:
        yield counter


@pytest.fixture(scope="module")
def counts(
    counter: InstructionCounter, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, ModelCount]:
    """Return the counts of a broken model, and of what is good after it, in one run."""
    broken = tmp_path_factory.mktemp("models") / "broken.xml"
    broken.write_text("<mujoco><worldbody/></mujoco>")
    sources = [models.resolve(name) for name in (str(broken), *MODELS)]
    names = ("broken", *MODELS, *(request.operation for request in OPERATIONS))
    return dict(zip(names, counter.count(INSTALLED, [*sources, *OPERATIONS]), strict=True))


def test_without_valgrind_one_line_says_how_to_get_it(tmp_path: Path) -> None:
    done = mjbench(
        "profile", "--instructions", "cartpole", cwd=tmp_path, env={"PATH": str(tmp_path)}
    )
    assert done.returncode == 3
    assert "valgrind: install it" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@needs_valgrind
def test_two_counts_differ_by_at_most_a_tenth_of_a_percent(
    counter: InstructionCounter,
    counts: dict[str, ModelCount],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Also with another hash seed, with a larger environment, in another folder."""
    monkeypatch.setattr(instructions, "HASH_SEED", "7")
    monkeypatch.setenv("PADDING", "x" * 5000)
    monkeypatch.chdir(tmp_path)
    first = counts["cube_table"]  # with contacts
    (second,) = counter.count(INSTALLED, [models.resolve("cube_table")])
    assert first.status == second.status == Status.OK
    assert first.instructions_per_step == pytest.approx(second.instructions_per_step, rel=1e-3)
    assert first.work == second.work
    assert first.repeats is not None
    assert first.repeats < 1e-3
    stages = first.stages or {}
    assert sum(stages.values()) == pytest.approx(first.instructions_per_step)
    assert 0 <= stages["other"] < 0.3 * sum(stages.values())


@needs_valgrind
def test_a_broken_model_costs_its_own_row(counts: dict[str, ModelCount]) -> None:
    assert counts["broken"].status == Status.INPUT
    assert "no degree of freedom" in counts["broken"].detail
    assert counts["cartpole"].status == Status.OK


@needs_valgrind
def test_operations_are_counted_whole_and_by_function(counts: dict[str, ModelCount]) -> None:
    load, copy = (counts[request.operation] for request in OPERATIONS)
    for count, request in zip((load, copy), OPERATIONS, strict=True):
        assert (count.status, count.operation) == (Status.OK, request.operation)
        assert count.repeats is not None
        assert count.repeats < 0.1  # some work may move to the other pass
        total = sum(function.self for function in count.functions)
        assert total == pytest.approx(count.instructions_per_step)
    assert any(function.name.startswith("mjXReader") for function in load.functions)
    untyped = {function.name[1:].replace("operator()", "") for function in load.functions}
    assert not {name for name in untyped if re.search("[(<]", name)}
    names = {function.name for function in copy.functions}
    assert any(name.startswith("mj_copyData") for name in names)


@needs_valgrind
def test_the_command_writes_json_and_a_run_file(
    counts: dict[str, ModelCount], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def count(*arguments: object, **options: object) -> list[ModelCount]:
        return [counts["cartpole"]]

    monkeypatch.setattr(InstructionCounter, "count", count)
    done = mjbench("profile", "--instructions", "cartpole", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["instructions_per_step"] > 1000
    assert any(f["name"].startswith("mj_kinematics") for f in row["functions"])
    assert {path.name for path in tmp_path.iterdir()} == {"out.json", "results"}
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    _, record = map(json.loads, file.read_text().splitlines())
    assert record == {"type": "instructions", **row}
    shown = mjbench("show", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.splitlines()[:2] == done.stdout.splitlines()[:2]
    page = mjbench("show", "--markdown", "-", cwd=tmp_path)
    assert f"{row['instructions_per_step']:,.0f}" in page.stdout


@needs_valgrind
def test_a_killed_run_leaves_no_process_and_no_folder(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "mjbench", "profile", "--instructions", "cartpole"),
            *("--results", str(tmp_path / "r")),
        ],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    pids: list[int] = []
    while not (pids := _processes("callgrind.out", tmp_path)) and process.poll() is None:
        os.sched_yield()
    descriptors = [os.pidfd_open(pid) for pid in pids]
    assert descriptors
    process.kill()
    process.wait()
    for descriptor in descriptors:
        ended, _, _ = select.select([descriptor], [], [], 60.0)  # long only where the test fails
        assert ended
        os.close(descriptor)
    assert len(list(tmp_path.iterdir())) > 1, "its folder, beside that of its run file"
    environment = {"TMPDIR": str(tmp_path)}
    assert mjbench_process("models", "cartpole", cwd=tmp_path, env=environment).returncode == 0
    assert list(tmp_path.iterdir()) == [tmp_path / "r"]


def _processes(*words: object) -> list[int]:
    """Return the processes whose command lines hold all words."""
    lines = {int(f.parent.name): machine.read_text(f) for f in Path("/proc").glob("[0-9]*/cmdline")}
    return [pid for pid, line in lines.items() if all(str(word) in line for word in words)]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a program that steps as Python does, with the timer of MuJoCo's package."""
    if shutil.which("c++") is None:
        pytest.skip("no C++ compiler (c++) on this machine")
    package = Path(mujoco.__file__).parent
    (library,) = package.glob("libmujoco.so*")
    folder = tmp_path_factory.mktemp("program")
    (folder / "steps.cc").write_text(PROGRAM)
    command = ["c++", "-O2", f"-I{package / 'include'}", "steps.cc", "-o", "steps", str(library)]
    subprocess.run([*command, f"-Wl,-rpath,{package}"], cwd=folder, check=True)
    return folder / "steps"


@needs_valgrind
def test_counts_agree_with_bracketing_by_two_step_counts(
    counts: dict[str, ModelCount], program: Path, tmp_path: Path
) -> None:
    """A second method: how much more 40 steps cost than 20, in a program without Python."""
    _, of_20, of_40 = _instructions_in_engine(program, (20, 20, 40), tmp_path)  # one warms up
    per_step = (of_40 - of_20) / 20
    assert counts["cartpole"].instructions_per_step == pytest.approx(per_step, rel=0.02)


@needs_valgrind
def test_counts_agree_with_those_of_the_processor(
    counts: dict[str, ModelCount], program: Path, tmp_path: Path
) -> None:
    """An independent instrument, where the machine has one: `perf stat`, bracketed likewise."""
    if shutil.which("perf") is None:
        pytest.skip("perf is not installed")
    totals = {n: _instructions_retired(program, n, tmp_path / "perf.csv") for n in (2000, 4000)}
    per_step = (totals[4000] - totals[2000]) / 2000
    assert counts["cartpole"].instructions_per_step == pytest.approx(per_step, rel=0.05)


def _command(program: Path, *nsteps: int) -> list[str]:
    return [str(program), str(models.resolve("cartpole").path), *map(str, nsteps)]


def _instructions_retired(program: Path, nstep: int, out: Path) -> int:
    perf = ["perf", "stat", "-x,", "-e", "instructions:u", "-o", str(out)]
    subprocess.run([*perf, *_command(program, nstep)], env=ENVIRONMENT, check=False)
    fields = [
        line.split(",")[0] for line in machine.read_text(out).splitlines() if "instructions" in line
    ]
    if not fields or not fields[0].isdigit():
        pytest.skip(f"this machine counts no instructions: {(fields or ['nothing'])[0]}")
    return int(fields[0])


def _instructions_in_engine(program: Path, nsteps: Sequence[int], folder: Path) -> list[int]:
    """Return the instructions of `mj_step` for each number of steps, from the same start state."""
    callgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out"]
    callgrind += ["--toggle-collect=mj_step", "--dump-before=mj_version"]
    command = [*callgrind, *_command(program, *nsteps)]
    subprocess.run(command, env=ENVIRONMENT, capture_output=True, check=True)
    dumps = sorted(folder.glob("out.*"), key=lambda file: int(file.suffix[1:]))[-len(nsteps) :]
    return [int(re.findall(r"^(?:totals|summary): (\d+)", d.read_text(), re.M)[0]) for d in dumps]
