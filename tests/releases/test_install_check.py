import os
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import pytest

from mjbench.releases import install_check


def test_the_installed_release_has_no_problem() -> None:
    assert install_check.imported_problem() is None
    assert install_check.imported_problem(metadata.version("mujoco")) is None


def test_another_release_than_the_expected_one_is_refused() -> None:
    assert "expected MuJoCo 2.3.7" in (install_check.imported_problem("2.3.7") or "")


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("__version__", "2.0.0", "the package is 2.0.0"),
        ("mj_versionString", lambda: "2.0.0", "the C library is 2.0.0"),
        ("__path__", [*mujoco.__path__, "/elsewhere/mujoco"], "is mixed from"),
    ],
)
def test_a_mixed_release_is_refused(
    monkeypatch: pytest.MonkeyPatch, attribute: str, value: Any, message: str
) -> None:
    monkeypatch.setattr(mujoco, attribute, value)
    assert message in (install_check.imported_problem() or "")


def test_a_distribution_left_by_another_release_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Remaining:
        metadata = {"Name": "mujoco-core"}  # noqa: RUF012
        version = "4.1.0"

    monkeypatch.setattr(install_check, "_distributions", lambda: [Remaining()])
    assert "distribution mujoco-core is 4.1.0" in (install_check.imported_problem() or "")


def test_a_module_from_elsewhere_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stray = type(sys)("mujoco.stray")
    stray.__file__ = str(tmp_path / "stray.py")
    monkeypatch.setitem(sys.modules, "mujoco.stray", stray)
    assert "module mujoco.stray was loaded from" in (install_check.imported_problem() or "")


@pytest.mark.parametrize(
    "version", ["4.1.0", "4.1.0rc1", "4.1.0.dev3", "4.1.0.post1", "4.1.0+g1a2b3c"]
)
def test_the_engine_knows_only_the_numbers_of_a_version(
    monkeypatch: pytest.MonkeyPatch, version: str
) -> None:
    monkeypatch.setattr(mujoco, "__version__", "4.1.0")
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "4.1.0")
    assert install_check._wrong_versions(version, []) == []
    assert install_check._wrong_versions("4.1.1", []) == [
        "the package is 4.1.0",
        "the C library is 4.1.0",
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [(os.remove, "is missing"), (lambda p: p.write_text("x"), "been changed")],
)
def test_a_broken_file_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    """A distribution made by hand is complete until one of its files is lost or rewritten."""
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "part.py").write_text("part = 1\n")
    info = tmp_path / "mujoco-9.9.9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 9.9.9\n")
    (info / "RECORD").write_text("mujoco/part.py,sha256=x,9\nmujoco-9.9.9.dist-info/RECORD,,\n")
    (distribution,) = metadata.distributions(name="mujoco", path=[str(tmp_path)])
    assert install_check._broken_file([distribution]) is None
    change(tmp_path / "mujoco" / "part.py")
    assert message in (install_check._broken_file([distribution]) or "")
