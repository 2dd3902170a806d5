"""Revisions that are built: from which tree, one wheel each, and what a failure says.

Nothing is downloaded.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from mjbench.errors import MachineError
from mjbench.releases import installs, pip, revision_builds
from mjbench.releases.pip import BuildError
from mjbench.releases.revisions import Revision
from mjbench.status import ExitCode

MAIN = Revision("main", "a" * 40)
TREE = "b" * 40


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have pip write a wheel; return the source trees that it builds."""
    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path / "cache"))
    built: list[str] = []

    def run(command: str, *arguments: str, phase: str) -> str:
        assert command == "wheel"
        (target,) = (a.partition("=")[2] for a in arguments if a.startswith("--wheel-dir="))
        (Path(target) / "own-1.0-py3-none-any.whl").write_text(arguments[-1])
        built.append(arguments[-1])
        return ""

    monkeypatch.setattr(pip, "run", run)
    return built


def test_a_tree_is_built_once(sources: list[str]) -> None:
    first, second = (revision_builds.built(MAIN, Path("source"), TREE) for _ in range(2))
    assert first == second
    assert sources == ["source"]
    assert [wheel.name for wheel in first.own_wheels] == ["own-1.0-py3-none-any.whl"]
    (name,) = installs.install_names()
    installs.remove(name)
    assert not first.own_wheels[0].exists()


def test_builds_of_other_trees_are_other_installs(sources: list[str]) -> None:
    first = revision_builds.built(MAIN, Path("one"), TREE)
    second = revision_builds.built(MAIN, Path("two"), "c" * 40)
    assert first.key != second.key


def test_a_branch_called_installed_is_built_as_any_other(sources: list[str]) -> None:
    branch = Revision("installed", "a" * 40)
    release = revision_builds.built(branch, Path("source"), TREE)
    assert release.key == revision_builds.built(MAIN, Path("source"), TREE).key


def failing(problem: str) -> Callable[..., str]:
    return lambda *_, phase: problem


def test_a_revision_that_does_not_build_says_why(
    sources: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pip, "run", failing("error: command 'gcc' failed"))
    with pytest.raises(BuildError, match=r"cannot build main \(a{10}\): error: command") as raised:
        revision_builds.built(MAIN, Path("source"), TREE)
    assert raised.value.exit_code == ExitCode.NOT_BUILT


def test_a_build_without_a_wheel_is_refused(
    sources: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pip, "run", failing(""))
    with pytest.raises(BuildError, match="does not build to one wheel"):
        revision_builds.built(MAIN, Path("source"), TREE)


def test_needs_that_cannot_be_installed_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pip, "run", failing("No matching distribution found for nowhere"))
    wheel = tmp_path / "own-1.0-py3-none-any.whl"
    with pytest.raises(BuildError, match=r"cannot install own-1\.0.* with MuJoCo 4\.0\.0: No mat"):
        pip.install("4.0.0", [], tmp_path / "target", [str(wheel)])


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
    assert revision_builds.source_folders(folder) == expected


def test_packages_are_found_wherever_they_lie(tmp_path: Path) -> None:
    folder = tree(
        tmp_path,
        *("alone.py", "python/mine/__init__.py", "python/mine/inner/__init__.py"),
        *("docs/page.py", ".venv/lib/foreign/__init__.py", "src/flat.py"),
    )
    assert revision_builds.package_names(folder) == {"alone", "mine", "flat"}


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
    assert revision_builds.is_compiled(folder) is expected


def test_trees_are_told_apart_by_what_they_depend_on(tmp_path: Path) -> None:
    texts = [
        revision_builds.dependencies(tree(tmp_path / str(number), "a.py", pyproject=text))
        for number, text in enumerate(
            ("", "[project]\ndescription = 'x'\n", "[project]\ndependencies = ['numpy']\n")
        )
    ]
    assert texts[0] == texts[1] != texts[2]


def test_settings_that_cannot_be_read_are_reported_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"cannot read pyproject\.toml"):
        revision_builds.source_folders(tree(tmp_path, pyproject="[project\n"))


def test_files_that_pin_versions_are_found(tmp_path: Path) -> None:
    folder = tree(tmp_path, "uv.lock", "requirements-dev.txt", "a.py")
    assert revision_builds.lock_files(folder) == {"uv.lock": b"", "requirements-dev.txt": b""}
