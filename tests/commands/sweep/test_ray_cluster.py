"""A sweep: which cells a plan has, and what a local Ray makes of them."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from commands import PYTHONPATH, mjbench_process

from mjbench import extras
from mjbench.cli.sweep import check_command
from mjbench.commands.sweep import ray_cluster as sweep
from mjbench.commands.sweep.ray_cluster import Cell, CellResult
from mjbench.errors import InputError, MachineError
from mjbench.host import machine
from mjbench.status import Status

QUICK = ("latency", "cartpole", "--nstep", "20")


def cells(folder: Path, text: str) -> list[Cell]:
    (folder / "plan.toml").write_text(text)
    return sweep.load(folder / "plan.toml", check_command)[1]


# plans


def test_a_plan_has_a_cell_for_each_combination_on_each_machine(tmp_path: Path) -> None:
    planned = cells(
        tmp_path,
        'command = "versions 3.3.0 {release} {model} --nstep {nstep}"\nmachines = ["a", "b"]\n'
        '[matrix]\nmodel = ["cartpole", "my robot.xml"]\nrelease = ["4.0.0"]\nnstep = [8, 8, 16]\n',
    )
    assert len(planned) == 2 * 2 * 2
    assert planned[0] == Cell(("versions", "3.3.0", "4.0.0", "cartpole", "--nstep", "8"), "a")
    assert planned[-1].machine == "b"
    assert planned[-1].command == "mjbench versions 3.3.0 4.0.0 'my robot.xml' --nstep 16"
    assert len({cell.file_name for cell in planned}) == len(planned)


def test_a_plan_without_matrix_is_one_command(tmp_path: Path) -> None:
    assert cells(tmp_path, 'command = "compare"\n') == [Cell(("compare",))]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "missing required field `command`"),
        ("command = 3", "Expected `str`, got `int` - at `$.command`"),
        ('command = " "', "$.command"),
        ('command = "compare \'a"', "command: No closing quotation"),
        ('command = "compare"\nmodles = []', "unknown field `modles`"),
        ('command = "compare"\nretries = -1', "$.retries"),
        ('command = "compare"\nmachines = [""]', "$.machines"),
        ('command = "compare"\nfolder = "nowhere"', "folder: No such file or directory"),
        ('command = "compare {model}"', "matrix.model: give it values in [matrix]"),
        ('command = "compare"\n[matrix]\nmodel = ["a"]', "name it in the command: {model}"),
        ('command = "compare {model}"\n[matrix]\nmodel = []', "matrix.model: Expected `array`"),
        ('command = "compare {model}"\n[matrix]\nmodel = [true]', "matrix.model: Expected"),
        ('command = "comprae"', "command: comprae: No such command"),
        ('command = "compare --nstep x"', "command: compare --nstep x: Invalid value"),
        ('command = "paths"', "command: paths: this command stores no results"),
        ('command = "compare', "plan.toml: "),
        ('command = "\x00"', "plan.toml: "),
        (
            f'command = "compare {{a}}{{b}}"\n[matrix]\na = {[*range(999)]}\nb = {[*range(99)]}',
            "10000",
        ),
    ],
)
def test_what_is_wrong_with_a_plan_is_one_line_that_names_the_key(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        cells(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "plan.toml"))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [None, b"\xff"])
def test_a_plan_that_cannot_be_read_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "plan.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match=r"plan\.toml: "):
        sweep.load(file, check_command)


def test_a_plan_without_end_is_refused() -> None:
    with pytest.raises(InputError, match=r"^/dev/zero: a plan has at most"):
        sweep.load(Path("/dev/zero"), check_command)


def test_a_command_takes_all_processors_of_the_largest_node() -> None:
    nodes = [
        {"Alive": True, "Resources": {"CPU": 4.0}, "Labels": {sweep.LABEL: "small"}},
        {"Alive": True, "Resources": {"CPU": 8.0}, "Labels": {}},
        {"Alive": False, "Resources": {"CPU": 64.0}, "Labels": {sweep.LABEL: "gone"}},
    ]
    assert sweep._processors(nodes, "") == 8
    assert sweep._processors(nodes, "small") == 4
    with pytest.raises(InputError, match=r"machines: .* gone; .* --labels mjbench-machine=gone"):
        sweep._processors(nodes, "gone")
    with pytest.raises(MachineError, match="no node"):
        sweep._processors([], "")


# on this machine, without Ray


def test_a_command_returns_its_run_file(tmp_path: Path) -> None:
    result = sweep.run_cell(Cell(QUICK, "lab"), tmp_path)
    assert (result.status, result.detail) == (Status.OK, "")
    assert label(result) == "lab"


def label(result: CellResult) -> str:
    """Return the name of the machine in the header of a run file."""
    header = json.loads(result.content.splitlines()[0])
    return str(header["machine"]["label"])


def test_a_command_that_fails_says_why_in_a_line() -> None:
    result = sweep.run_cell(Cell(("compare", "nosuch")))
    assert (result.status, result.content) == (Status.INPUT, b"")
    assert result.detail.startswith("no model 'nosuch'")


# on a local Ray


@pytest.fixture(scope="module")
def ray_address() -> Iterator[str]:
    """Start Ray on this machine, whose name is `here`; yield the address."""
    if extras.missing(["ray"]):
        pytest.skip("Ray is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(machine.LABEL_VARIABLE, "here")
        patch.setenv("PYTHONPATH", PYTHONPATH)
        with sweep.cluster(None):
            import ray

            yield ray.get_runtime_context().gcs_address


@pytest.mark.usefixtures("ray_address")
def test_a_cell_that_fails_costs_no_other_one(tmp_path: Path) -> None:
    good = Cell(QUICK, "here")
    bad = Cell(("compare", "nosuch"))
    results = dict(sweep.measure([bad, good], 0, tmp_path))
    assert results[bad].status == Status.INPUT
    assert results[good].status == Status.OK
    assert label(results[good]) == "here"


@pytest.mark.usefixtures("ray_address")
def test_a_machine_that_the_cluster_lacks_is_one_line() -> None:
    with pytest.raises(InputError, match="no node of the cluster is elsewhere"):
        next(sweep.measure([Cell(("compare",), "elsewhere")]))


@pytest.mark.usefixtures("ray_address")
def test_a_worker_that_is_killed_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def die(cell: Cell, folder: Path | None) -> CellResult:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("it is dead")

    monkeypatch.setattr(sweep, "run_cell", die)
    ((_, result),) = sweep.measure([Cell(("compare",))])
    assert result.status == Status.CRASHED
    assert result.detail and "\n" not in result.detail


def test_a_sweep_on_a_cluster_stores_what_is_missing(ray_address: str, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(
        'command = "latency {model} --nstep 20"\nfolder = "."\n[matrix]\n'
        'model = ["cartpole", "nosuch"]\n'
    )
    done = mjbench_process("sweep", "plan.toml", "--address", ray_address, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "2 results, 1 of them missing" in done.stdout
    assert "input: no model 'nosuch'" in done.stdout
    (file,) = (tmp_path / "results/sweeps/plan").iterdir()
    assert file.name.startswith("latency-cartpole-")


def test_stopped_it_ends_the_command_on_the_node(ray_address: str, tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text('command = "latency cartpole --nstep 1000000000"\n')
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "sweep", "plan.toml", "--address", ray_address],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not (started := measuring()):
        threading.Event().wait(0.05)
    process.send_signal(signal.SIGTERM)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "mjbench: interrupted\n"
    assert "1 result, 1 of them missing" in output
    assert psutil.wait_procs(started, timeout=60)[1] == []


def measuring() -> list[psutil.Process]:
    """Return what runs below this process that is the command of the cell above."""
    running = []
    for one in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            if "--nstep 1000000000" in " ".join(one.cmdline()):
                running.append(one)
    return running


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere"])
def test_a_cluster_that_does_not_answer_is_one_line(address: str) -> None:
    if extras.missing(["ray"]):
        pytest.skip("Ray is not installed")
    with (
        pytest.raises(MachineError, match=f"Ray cannot connect to {address}: "),
        sweep.cluster(address),
    ):
        pass
