"""A Node process that works, and ones that crash, hang or talk nonsense."""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import pretending_node
import pytest
from process_tree import descendants

from mjbench.status import Status
from mjbench.web.node import Node
from mjbench.web.node_process import Instantiated, Memory, NodeError, NodeProcess


@pytest.fixture
def process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Iterator[NodeProcess]:
    marker = request.node.get_closest_marker("parametrize")
    how = request.node.callspec.params["how"] if marker else ""
    monkeypatch.setenv(pretending_node.MISBEHAVIOUR, how)
    node = Node(pretending_node.program(tmp_path), pretending_node.VERSION)
    pretending_node.package(tmp_path, mujoco.__version__)
    folder = tmp_path / "work"
    folder.mkdir()
    process = NodeProcess(node, "wasm (cartpole)", folder, 1.0 if how == "hang:memory" else 60.0)
    yield process
    process.end()


def test_requests_are_answered_in_their_types(process: NodeProcess, tmp_path: Path) -> None:
    script = tmp_path / "node_modules/@mujoco/mujoco/mujoco.js"
    instantiated = process.call(Instantiated, "instantiate", script=str(script), nthread=2)
    assert instantiated == Instantiated(mujoco.__version__, 1.0, 2.0, 100, True)
    assert process.call(Memory, "memory") == Memory(300, 400)


@pytest.mark.parametrize("how", ["error:memory"])
def test_a_request_that_fails_leaves_the_process_at_work(
    process: NodeProcess, how: str, tmp_path: Path
) -> None:
    with pytest.raises(NodeError, match=r"^wasm \(cartpole\): no such thing while measuring"):
        process.call(Memory, "memory")
    script = tmp_path / "node_modules/@mujoco/mujoco/mujoco.js"
    assert (
        process.call(Instantiated, "instantiate", script=str(script), nthread=2).version
        == mujoco.__version__
    )


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
            process.call(Memory, "memory")
        assert caught.value.status == status
        assert "\n" not in str(caught.value)
    assert process.pid not in descendants()
