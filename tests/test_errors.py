"""A module in the place of MuJoCo or NumPy is named where it is the cause of an error."""

import importlib
import sys
from pathlib import Path

import pytest

from mjbench.errors import describe_unforeseen, failure_of, file_argument, foreign_module
from mjbench.status import Status


def error_of_import(
    name: str, content: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> BaseException:
    """Return what is raised where `name` stands for a file of the user's own."""
    file = folder / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(content)
    monkeypatch.syspath_prepend(str(folder))
    package = name.split("/")[0].removesuffix(".py")
    monkeypatch.delitem(sys.modules, package)
    with pytest.raises(BaseException) as raised:
        getattr(importlib.import_module(package), "MjModel")  # noqa: B009 - it may be missing
    return raised.value


@pytest.mark.parametrize("name", ["mujoco.py", "mujoco/__init__.py", "numpy.py"])
@pytest.mark.parametrize(
    "content", ["x = 1", "raise SystemExit(5)", "raise ValueError", "import nothing_so_called", "("]
)
def test_a_module_in_the_place_of_a_package_is_named_in_a_line(
    name: str, content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    error = error_of_import(name, content, tmp_path, monkeypatch)
    package = name.split("/")[0].removesuffix(".py")
    line = foreign_module(error)
    assert line.startswith(f"{tmp_path / name} is imported in the place of the package {package}:")
    assert failure_of(error).status == Status.FAILED
    assert failure_of(error).detail == line
    assert not isinstance(error, Exception) or describe_unforeseen(error) == line


def test_an_error_of_another_cause_is_not_blamed_on_such_a_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    error_of_import("mujoco.py", "x = 1", tmp_path, monkeypatch)
    assert foreign_module(SystemExit(1)) == ""
    assert foreign_module(ValueError("of the user")) == ""


def test_an_error_beside_the_installed_packages_is_not_blamed_on_them() -> None:
    assert foreign_module(AttributeError("of the user")) == ""


@pytest.mark.parametrize(
    ("name", "argument"), [("-c.py", "./-c.py"), ("a-b.py", "a-b.py"), ("../-c.py", "../-c.py")]
)
def test_a_file_on_a_command_line_is_no_option(name: str, argument: str) -> None:
    assert file_argument(name) == argument


def test_a_model_that_reserves_too_little_memory_is_the_users_to_mend() -> None:
    class FatalError(Exception):
        """As that of MuJoCo."""

    failure = failure_of(FatalError("mj_stackAlloc: out of memory at mj_step\n  max = 1, nefc = 0"))
    assert failure.status == Status.INPUT
    assert failure.detail.startswith("FatalError: mj_stackAlloc: out of memory at mj_step: the")
    assert "fusestatic" in failure.detail
    assert failure_of(FatalError("mj_step: no")).status == Status.FAILED
    assert failure_of(ValueError("XML Error: no such attribute")).status == Status.INPUT
    assert failure_of(ValueError("no XML Error: ")).status == Status.FAILED
