"""Environments are made from their names; what fails is said in a line."""

import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import example_environments as examples
import mujoco
import pytest

from mjbench.commands.env import construction
from mjbench.commands.env.source import EnvironmentSource, resolve
from mjbench.errors import InputError

TESTS = Path(__file__).parents[2]
CONSTANTS = "dm_control.mujoco.wrapper.mjbindings.constants"


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    """Leave folder and path of this process as they were: factories change them."""
    folder, path = Path.cwd(), list(sys.path)
    yield
    os.chdir(folder)
    sys.path[:] = path


def source(name: str, folder: Path = TESTS) -> EnvironmentSource:
    return resolve(name, folder)


def test_a_factory_makes_an_environment_in_its_folder() -> None:
    environment = construction.make(source("example_environments:make"))
    assert isinstance(environment, examples.Env)
    assert Path.cwd() == TESTS


def test_a_module_in_the_users_folder_is_found(tmp_path: Path) -> None:
    (tmp_path / "made_up_env.py").write_text("class Tasks:\n    reach = staticmethod(lambda: 5)\n")
    assert construction.make(source("made_up_env:Tasks.reach", tmp_path)) == 5


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such_module_here:make", "no module no_such_module_here"),
        ("example_environments:mak", "has no mak (did you mean make?)"),
        ("example_environments:not_callable", "is int, not a function"),
        ("example_environments:fails", "RuntimeError: no GPU here (example_environments.py:"),
        ("example_environments:needs_argument", "raised TypeError"),
    ],
)
def test_a_factory_that_fails_is_one_line(name: str, message: str) -> None:
    with pytest.raises(InputError) as failed:
        construction.make(source(name))
    assert message in str(failed.value)
    assert "\n" not in str(failed.value)


def test_a_module_that_lacks_another_names_that_one(tmp_path: Path) -> None:
    (tmp_path / "needy_env.py").write_text("import not_installed_anywhere\n")
    with pytest.raises(InputError, match="not_installed_anywhere") as failed:
        construction.make(source("needy_env:make", tmp_path))
    assert "needy_env.py:1" in str(failed.value)


def test_a_failure_in_a_library_names_the_users_line_first(tmp_path: Path) -> None:
    (tmp_path / "json_env.py").write_text("import json\n\ndef make():\n    json.loads('{')\n")
    with pytest.raises(InputError, match=r"\(json_env\.py:4, from decoder\.py:\d+\)"):
        construction.make(source("json_env:make", tmp_path))


def test_code_that_ends_the_process_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "exiting_env.py").write_text("import sys\nsys.exit(3)\n")
    with pytest.raises(InputError, match="importing exiting_env raised SystemExit: 3"):
        construction.make(source("exiting_env:make", tmp_path))


@pytest.mark.parametrize(
    ("package", "name"), [("gymnasium", "Ant-v5"), ("dm_control", "dm_control:cartpole-swingup")]
)
def test_a_package_that_is_missing_is_named_with_its_command(
    package: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    with pytest.raises(InputError) as failed:
        construction.make(source(name))
    assert f"{package} is not installed here: python -m pip install" in str(failed.value)


@pytest.mark.skipif(not importlib.util.find_spec("gymnasium"), reason="needs gymnasium")
def test_an_unknown_id_names_similar_ones() -> None:
    with pytest.raises(InputError, match="did you mean Humanoid-v5"):
        construction.make(source("Humanoidd-v5"))


@pytest.mark.skipif(not importlib.util.find_spec("dm_control"), reason="needs dm_control")
def test_an_unknown_task_names_similar_ones() -> None:
    with pytest.raises(InputError, match="did you mean dm_control:humanoid-walk"):
        construction.make(source("dm_control:humanoid-wlak"))


def built_for(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, CONSTANTS, SimpleNamespace(mjVERSION_HEADER=number))


@pytest.mark.parametrize(
    ("number", "release"), [(337, "3.3.7"), (2003007, "2.3.7"), (3017001, "3.17.1")]
)
def test_both_releases_are_said(number: int, release: str, monkeypatch: pytest.MonkeyPatch) -> None:
    built_for(number, monkeypatch)
    monkeypatch.setattr(mujoco, "mj_version", lambda: 9000000)
    monkeypatch.setattr(mujoco, "mj_versionString", lambda: "9.0.0")
    mismatch = construction.dm_control_mismatch()
    assert (mismatch.built_for, mismatch.installed) == (release, "9.0.0")
    assert str(mismatch).startswith(
        f"dm_control is built for MuJoCo {release}, and 9.0.0 is installed; install it with"
    )


def test_the_same_release_and_other_frameworks_are_no_mismatch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built_for(mujoco.mj_version(), monkeypatch)
    assert construction.dm_control_mismatch() is None
    monkeypatch.delitem(sys.modules, CONSTANTS)
    assert construction.dm_control_mismatch() is None


def test_what_fails_for_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    built_for(100, monkeypatch)
    with (
        pytest.raises(
            InputError, match=r"making it raised .*; dm_control is built for MuJoCo 1\.0"
        ),
        construction.as_input_error("making it"),
    ):
        raise AttributeError("no attribute flex_vertedge")
