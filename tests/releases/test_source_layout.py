"""Source trees: where their modules are imported from, and whether they have to be built."""

from pathlib import Path

import pytest

from mjbench.errors import MachineError
from mjbench.releases import source_layout


def tree(folder: Path, *files: str, pyproject: str = "") -> Path:
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).touch()
    if pyproject:
        (folder / "pyproject.toml").write_text(pyproject)
    return folder


def test_src_and_the_folders_of_pytest_come_before_the_top(tmp_path: Path) -> None:
    settings = "[tool.pytest.ini_options]\npythonpath = ['python', 'absent']\n"
    folder = tree(tmp_path, "src/a.py", "python/b.py", pyproject=settings)
    expected = [folder / "src", folder / "python", folder]
    assert source_layout.source_folders(folder) == expected


def test_packages_are_found_wherever_they_lie(tmp_path: Path) -> None:
    folder = tree(
        tmp_path,
        *("alone.py", "python/mine/__init__.py", "python/mine/inner/__init__.py"),
        *("docs/page.py", ".venv/lib/foreign/__init__.py", "src/flat.py"),
    )
    assert source_layout.package_names(folder) == {"alone", "mine", "flat"}


@pytest.mark.parametrize(
    ("setup", "pyproject", "expected"),
    [
        ("", '[build-system]\nbuild-backend = "scikit_build_core.build"\n', True),
        ("", '[build-system]\nbuild-backend = "hatchling.build"\n', False),
        ("setup(ext_modules=[Extension('a', ['a.c'])])", "", True),
        ("", "[tool.setuptools]\next-modules = [{name = 'a', sources = ['a.c']}]\n", True),
        ("setup()", "", False),
        ("", "", False),
    ],
)
def test_a_package_with_extension_modules_has_to_be_built(
    tmp_path: Path, setup: str, pyproject: str, expected: bool
) -> None:
    folder = tree(tmp_path, "benchmarks/floor.c", "setup.py", pyproject=pyproject)
    (folder / "setup.py").write_text(setup)
    assert source_layout.is_compiled(folder) is expected


def test_trees_are_told_apart_by_what_they_depend_on(tmp_path: Path) -> None:
    texts = [
        source_layout.dependencies(tree(tmp_path / str(number), "a.py", pyproject=text))
        for number, text in enumerate(
            ("", "[project]\ndescription = 'x'\n", "[project]\ndependencies = ['numpy']\n")
        )
    ]
    assert texts[0] == texts[1] != texts[2]


def test_settings_that_cannot_be_read_are_reported_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"cannot read pyproject\.toml"):
        source_layout.source_folders(tree(tmp_path, pyproject="[project\n"))


def test_files_that_pin_versions_are_found(tmp_path: Path) -> None:
    folder = tree(tmp_path, "uv.lock", "requirements-dev.txt", "a.py")
    assert source_layout.lock_files(folder) == {"uv.lock": b"", "requirements-dev.txt": b""}
