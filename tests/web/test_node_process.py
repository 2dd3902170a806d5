"""Which Node is used; a process of it that works, and ones that crash, hang or talk nonsense."""

import stat
from collections.abc import Iterator
from pathlib import Path

import mujoco
import pretending_node
import pytest
from process_tree import descendants

from mjbench.errors import InputError, MachineError
from mjbench.status import Status
from mjbench.web import node_process
from mjbench.web.node_process import Instantiated, Memory, NodeError, NodeProcess, NodeProgram


@pytest.fixture
def process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Iterator[NodeProcess]:
    marker = request.node.get_closest_marker("parametrize")
    how = request.node.callspec.params["how"] if marker else ""
    monkeypatch.setenv(pretending_node.MISBEHAVIOUR, how)
    node = NodeProgram(pretending_node.program(tmp_path), pretending_node.VERSION)
    pretending_node.package(tmp_path, mujoco.__version__)
    folder = tmp_path / "work"
    folder.mkdir()
    process = NodeProcess(node, "wasm (cartpole)", folder, 1.0 if how == "hang:memory" else 60.0)
    yield process
    process.end()


def test_requests_are_answered_in_their_types(process: NodeProcess, tmp_path: Path) -> None:
    script = tmp_path / "node_modules/@mujoco/mujoco/mujoco.js"
    instantiated = process.instantiate(script, nthread=2)
    assert instantiated == Instantiated(mujoco.__version__, 1.0, 2.0, 100, True)
    assert process.memory() == Memory(300, 400)


@pytest.mark.parametrize("how", ["error:memory"])
def test_a_request_that_fails_leaves_the_process_at_work(
    process: NodeProcess, how: str, tmp_path: Path
) -> None:
    with pytest.raises(NodeError, match=r"^wasm \(cartpole\): no such thing while measuring"):
        process.memory()
    script = tmp_path / "node_modules/@mujoco/mujoco/mujoco.js"
    assert process.instantiate(script, nthread=2).version == mujoco.__version__


@pytest.mark.parametrize(
    ("how", "status", "message"),
    [
        ("crash:memory", Status.CRASHED, r"killed by signal 9 \(SIGKILL\) while measuring memory;"
         " its last output: it went wrong"),
        ("hang:memory", Status.TIMEOUT, "no answer within 1 s while measuring memory"),
        ("nonsense:memory", Status.CRASHED, r"answer \(b'nonsense'\), killed while measuring"),
    ],
)  # fmt: skip
def test_a_process_that_fails_ends_in_one_line(
    process: NodeProcess, how: str, status: Status, message: str
) -> None:
    for _ in range(2):  # and says the same when it is asked again
        with pytest.raises(NodeError, match=message) as caught:
            process.memory()
        assert caught.value.status == status
        assert "\n" not in str(caught.value)
    assert process.pid not in descendants()


def script(folder: Path, text: str) -> str:
    file = folder / "program"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    return str(file)


def test_a_node_that_is_new_enough_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = pretending_node.program(tmp_path)
    monkeypatch.chdir(tmp_path)
    installed = node_process.find_node("./node")
    assert (installed.file, installed.version) == (program, pretending_node.VERSION)


def test_a_missing_node_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MachineError, match=r"^Node is not installed: install Node\.js 18 or newer"):
        node_process.find_node()
    with pytest.raises(InputError, match="--node: there is no program nodejs"):
        node_process.find_node("nodejs")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("echo v16.20.2", "is Node 16.20.2; MuJoCo's WebAssembly builds need 18 or newer"),
        ("echo Python 3.11", "is not Node: `--version` printed 'Python 3.11'"),
        ("echo broken >&2; exit 3", "is not Node: `--version` printed 'broken'"),
        ("exec sleep 600", "did not say its version within 0.1 s"),
    ],
)
def test_a_node_that_will_not_do_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(MachineError, match=message):
        node_process.find_node(script(tmp_path, text), limit_s=0.1 if "sleep" in text else 30.0)
