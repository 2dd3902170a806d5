"""The command that installs an extra: it names packages, since mjbench is on no index."""

import importlib.metadata
from pathlib import Path

import pytest

from mjbench import extras
from mjbench.errors import MachineError

REQUIREMENTS = [
    "numpy>=1.26",
    "jinja2>=3.1; extra == 'report'",
    'vl-convert-python ; extra == "report"',
    "mjbench[report]; extra == 'pages'",
    "sphinx>=8; (python_version > '3') and extra == 'pages'",
]


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("", '"numpy>=1.26"'),
        ("report", '"jinja2>=3.1" vl-convert-python'),
        ("pages", '"jinja2>=3.1" vl-convert-python "sphinx>=8"'),
        ("pages,report", '"jinja2>=3.1" vl-convert-python "sphinx>=8"'),
        ("unknown", '".[unknown]"'),
    ],
)
def test_packages_of_an_extra_are_named(
    monkeypatch: pytest.MonkeyPatch, extra: str, arguments: str
) -> None:
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: REQUIREMENTS)
    assert extras.install_command(extra) == f"python -m pip install {arguments}"


def test_a_package_that_is_broken_is_refused_with_its_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "broken_renderer.py").write_text("from json import nothing")
    monkeypatch.syspath_prepend(tmp_path)
    says = r"--html needs broken_renderer, which cannot be imported \(ImportError: .*reinstall"
    with pytest.raises(MachineError, match=says):
        extras.require("--html", "report", ["broken_renderer"])


def test_without_metadata_it_is_the_command_for_a_clone(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> list[str]:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "requires", fail)
    assert extras.install_command("mjx") == 'python -m pip install ".[mjx]"'
    assert extras.install_command() == "python -m pip install ."


@pytest.mark.parametrize("extra", ["", "asv", "env", "mjx", "ray", "report", "warp"])
def test_every_extra_of_mjbench_has_packages(extra: str) -> None:
    assert " ." not in extras.install_command(extra)
