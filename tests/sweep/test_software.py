"""Nodes measure only with the software that this process has."""

from dataclasses import replace
from pathlib import Path

import pytest

from mjbench.sweep import software

HERE = software.installed()


def test_the_same_software_is_no_difference() -> None:
    assert software.difference(HERE, replace(HERE)) == ""


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"python": "3.12.1"}, f"Python 3.12.1 instead of {HERE.python}"),
        ({"mujoco": ""}, f"MuJoCo missing instead of {HERE.mujoco}"),
        ({"code": "0"}, f"other code of mjbench {HERE.mjbench}: install the same on all nodes"),
        (
            {"mjbench": "0.0.1", "code": "0"},
            f"mjbench 0.0.1 instead of {HERE.mjbench}",
        ),
    ],
)
def test_other_software_is_named(change: dict[str, str], line: str) -> None:
    assert software.difference(HERE, replace(HERE, **change)) == line


def test_the_code_is_known_by_its_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "__init__.py").write_text("")
    monkeypatch.setattr(software.mjbench, "__file__", str(tmp_path / "__init__.py"))
    before = software._code_digest()
    assert before == software._code_digest()
    (tmp_path / "costs.json").write_text("{}")
    assert software._code_digest() != before
