import sys
from pathlib import Path

import mujoco
import pytest

from mjbench.errors import InputError
from mjbench.simulation import models

XML = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with models in it, whose import would fail."""
    root = tmp_path / "robots_pkg"
    for name in ("ant.xml", "deep/arm.xml", "one/hand.xml", "two/hand.xml"):
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(XML)
    (root / "__init__.py").write_text("raise RuntimeError('must not be imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    return root


def test_shipped_models_are_found_by_name() -> None:
    assert "cartpole" in models.shipped()
    assert models.resolve("cartpole").path.name == "cartpole.xml"


def test_a_file_is_found_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    assert models.load(models.resolve(str(tmp_path / "robot.xml"))).nv == 6


def test_a_compiled_model_loads(tmp_path: Path) -> None:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(XML), str(tmp_path / "robot.mjb"))
    assert models.load(models.resolve(str(tmp_path / "robot.mjb"))).nv == 6


def test_a_packages_model_is_found_without_importing_the_package(package: Path) -> None:
    assert models.resolve("robots_pkg:ant").path == package / "ant.xml"
    assert models.resolve("robots_pkg:deep/arm").path == package / "deep/arm.xml"
    assert models.resolve("robots_pkg:one/hand.xml").path == package / "one/hand.xml"
    assert "robots_pkg" not in sys.modules


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robots_pkg:hand", "ambiguous, name one of: one/hand.xml, two/hand.xml"),
        ("robots_pkg:amt", "did you mean arm, ant"),
        ("dm_kontrol:x", "pip install dm_kontrol"),
        ("gymnasium_robotics:x", "pip install gymnasium-robotics"),
        ("cartpol", "did you mean cartpole"),
        ("nowhere/robot.xml", "no such file"),
    ],
)
def test_an_unknown_name_is_an_error_that_suggests_others(
    package: Path, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        models.resolve(name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco>", "cannot load"),
        ("", "cannot load"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "no degree of freedom"),
    ],
)
def test_a_broken_file_is_an_error_of_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        models.load(models.resolve(str(tmp_path / "bad.xml")))
    assert "\n" not in str(raised.value)
