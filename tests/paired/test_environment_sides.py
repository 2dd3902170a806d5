"""Functions in two environments: which files and folders their processes get."""

from pathlib import Path

import pytest

from mjbench.errors import InputError
from mjbench.paired import environment_sides
from mjbench.paired.environment_sides import EnvironmentComparison
from mjbench.releases import installs
from mjbench.releases.installs import ReleaseSpec

OLD = ReleaseSpec("own==1.0", "4.0.0", requirements=("own==1.0",), has_packages=True)
NEW = ReleaseSpec("own==2.0", "4.0.0", requirements=("own==2.0",), has_packages=True)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of installs that hold the packages which were named."""

    def install(release: ReleaseSpec) -> Path:
        folder = tmp_path / "cache" / release.key
        info = folder / "own-1.0.dist-info"
        info.mkdir(parents=True, exist_ok=True)
        (info / "METADATA").write_text("Name: own\nVersion: 1.0\n")
        (info / "RECORD").write_text("own/__init__.py,,1\n")
        return folder

    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(installs, "install", install)
    return tmp_path / "cache"


def comparison(cwd: Path, *functions: str) -> EnvironmentComparison:
    parsed = environment_sides.parse_functions(functions, cwd)
    return EnvironmentComparison(OLD, [NEW], parsed, cwd)


def test_both_sides_run_the_same_code_with_their_own_packages(tmp_path: Path, cache: Path) -> None:
    cwd = tmp_path / "work"
    cwd.mkdir()
    (cwd / "bench.py").write_text("def step(): pass\n")
    ((old, new),) = environment_sides.install_all(comparison(cwd, "bench.py::step"))
    assert old.source == new.source
    assert old.source.text == b"def step(): pass\n"
    assert (old.source.file, old.source.folders) == (str(cwd / "bench.py"), (str(cwd),))
    assert (old.origin.packages, new.origin.packages) == ({"own"}, {"own"})
    assert old.origin.folders == (str(cache / OLD.key),)
    assert new.origin.folders == (str(cache / NEW.key),)
    assert (new.label, new.row().packages, new.row().revision) == ("own==2.0", "own==2.0", "")


def test_a_file_in_a_package_is_imported_as_its_module(tmp_path: Path, cache: Path) -> None:
    (tmp_path / "speed").mkdir()
    (tmp_path / "speed/__init__.py").touch()
    (tmp_path / "speed/bench.py").touch()
    ((old, _),) = environment_sides.install_all(comparison(tmp_path, "speed/bench.py::step"))
    assert (old.source.module, old.source.folders) == ("speed.bench", (str(tmp_path),))


def test_a_file_that_does_not_exist_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no file \S*none\.py"):
        comparison(tmp_path, "none.py::step")
