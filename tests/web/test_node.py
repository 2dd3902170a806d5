"""Which Node is used, and what is said where there is none that will do."""

import stat
from pathlib import Path

import pretending_node
import pytest

from mjbench.errors import InputError, MachineError
from mjbench.web import node


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
    installed = node.find("./node")
    assert (installed.file, installed.version) == (program, pretending_node.VERSION)


def test_a_missing_node_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MachineError, match=r"^Node is not installed: install Node\.js 18 or newer"):
        node.find()
    with pytest.raises(InputError, match="--node: there is no program nodejs"):
        node.find("nodejs")


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
        node.find(script(tmp_path, text), limit_s=0.1 if "sleep" in text else 30.0)
