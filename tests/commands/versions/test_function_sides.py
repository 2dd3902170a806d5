"""Functions of the user's code: how they are named, and where each side finds them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from git_checkout import commit, new_repository

from mjbench.commands.versions import function_sides
from mjbench.commands.versions.function_sides import (
    EnvironmentComparison,
    FunctionName,
    FunctionTargets,
    RevisionComparison,
)
from mjbench.errors import InputError
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import WORKTREE, Repository


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bench.py::step", FunctionName("bench.py::step", "step", Path("sub/bench.py"))),
        ("../bench.py::A::b", FunctionName("../bench.py::A::b", "A.b", Path("bench.py"))),
    ],
)
def test_functions_are_named_by_their_file(
    tmp_path: Path, text: str, expected: FunctionName
) -> None:
    assert function_sides.parse_function(text, tmp_path / "sub", tmp_path) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("step", "step is no function: give FILE.py::FUNCTION, such as"),
        ("own.physics:step", "is no function"),
        ("bench.py::step[1]", "is no function"),
        ("bench.txt::step", "bench.txt is no Python file"),
        ("../bench.py::step", "lies outside of the repository"),
    ],
)
def test_other_names_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        function_sides.parse_function(text, tmp_path, tmp_path)


@pytest.fixture
def repository(tmp_path: Path) -> Iterator[Repository]:
    """Yield a repository: tag v1 has no benchmark, HEAD has one, the worktree another."""
    git = new_repository(tmp_path)
    (tmp_path / "own").mkdir()
    (tmp_path / "own/__init__.py").touch()
    commit(git, "first", "v1")
    (tmp_path / "speed").mkdir()
    (tmp_path / "speed/bench.py").write_text("committed\n")
    commit(git, "second")
    (tmp_path / "speed/bench.py").write_text("changed\n")
    yield Repository(tmp_path)


def targets(
    pool: WorkerPool,
    repository: Repository,
    names: tuple[str, str],
    function: str,
    own_files: bool = False,
) -> FunctionTargets:
    baseline, candidate = map(repository.parse, names)
    parsed = function_sides.parse_function(function, repository.top, repository.top)
    comparison = RevisionComparison(
        repository, baseline, candidate, [parsed], repository.top.resolve(), own_files
    )
    (pair,) = function_sides.check_out(pool, comparison)
    return pair


@pytest.mark.parametrize(
    ("candidate", "text"),
    [("HEAD", b"committed\n"), (WORKTREE, b"changed\n"), ("v1", b"changed\n")],
)
def test_a_file_is_the_candidates_on_both_sides(
    pool: WorkerPool, repository: Repository, candidate: str, text: bytes
) -> None:
    """Where the candidate has none, it is that of the checkout."""
    pair = targets(pool, repository, ("v1", candidate), "speed/bench.py::step")
    assert [target.source.text for target in pair] == [text, text]
    folders = [target.origin.folders[0] for target in pair]
    assert len(folders[0]) == len(folders[1])
    for target, folder in zip(pair, folders, strict=True):
        assert target.source.file == f"{folder}/speed/bench.py"
        assert target.source.folders == (f"{folder}/speed", folder)
        assert target.source.cwd == folder
        assert "own" in target.origin.packages


@pytest.mark.parametrize(
    ("names", "texts"),
    [(("HEAD", WORKTREE), [b"committed\n", b"changed\n"]), (("v1", "HEAD"), [b"", b"committed\n"])],
)
def test_each_side_can_run_its_own_file(
    pool: WorkerPool, repository: Repository, names: tuple[str, str], texts: list[bytes]
) -> None:
    pair = targets(pool, repository, names, "speed/bench.py::step", own_files=True)
    assert [target.source.text for target in pair] == texts


def test_a_file_that_exists_nowhere_is_reported(pool: WorkerPool, repository: Repository) -> None:
    with pytest.raises(InputError, match=r"there is no file none\.py in the candidate"):
        targets(pool, repository, ("v1", "HEAD"), "none.py::step")


def test_copies_of_packages_that_measure_are_not_the_trees_own(tmp_path: Path) -> None:
    for package in ("third_party/numpy", "third_party/other", "src/mujoco"):
        (tmp_path / package).mkdir(parents=True)
        (tmp_path / package / "__init__.py").touch()
    assert function_sides.own_packages(tmp_path) == {"mujoco", "other"}


def test_revisions_of_mjbench_are_refused(pool: WorkerPool, repository: Repository) -> None:
    (repository.top / "mjbench.py").touch()
    with pytest.raises(InputError, match="mjbench cannot compare revisions of itself"):
        targets(pool, repository, ("HEAD", WORKTREE), "own/__init__.py::step")


def test_commits_that_the_candidate_lacks_are_noted(repository: Repository) -> None:
    old, new = map(repository.parse, ("v1", "HEAD"))
    assert RevisionComparison(repository, old, new, [], repository.top).notes == []
    (note,) = RevisionComparison(repository, new, old, [], repository.top).notes
    assert note.startswith("HEAD has 1 commit that v1 lacks")
    worktree = repository.parse(WORKTREE)
    (note,) = RevisionComparison(repository, worktree, old, [], repository.top).notes
    assert "`git merge-base HEAD v1`" in note


@pytest.mark.parametrize(
    ("baseline", "file", "own_files", "is_noted"),
    [
        ("HEAD", "speed/bench.py", False, True),
        ("HEAD", "speed/bench.py", True, False),
        ("HEAD", "own/__init__.py", False, False),
        ("v1", "speed/bench.py", False, False),
    ],
)
def test_a_benchmark_that_differs_itself_is_noted(
    repository: Repository, baseline: str, file: str, own_files: bool, is_noted: bool
) -> None:
    revisions = map(repository.parse, (baseline, WORKTREE))
    function = FunctionName(f"{file}::step", "step", Path(file))
    comparison = RevisionComparison(repository, *revisions, [function], repository.top, own_files)
    note = (
        f"{file} itself differs, and both sides run that of WORKTREE; with --own-files, each side"
        " runs its own"
    )
    assert comparison.notes == ([note] if is_noted else [])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ({"pyproject.toml": "[project]\n"}, {"pyproject.toml": "[project]\n"}, ""),
        ({}, {"setup.py": "setup(ext_modules=[])"}, ""),  # the baseline cannot be installed
        ({"setup.py": ""}, {"setup.py": "cythonize('a')"}, "there are extension modules"),
        (
            {"pyproject.toml": "[project]\ndependencies = []\n"},
            {"pyproject.toml": "[project]\ndependencies = ['scipy']\n"},
            "they need other packages",
        ),
    ],
)
def test_only_what_has_to_be_built_is(
    tmp_path: Path, old: dict[str, str], new: dict[str, str], reason: str
) -> None:
    for folder, files in (("a", old), ("b", new)):
        (tmp_path / folder).mkdir()
        for name, text in files.items():
            (tmp_path / folder / name).write_text(text)
    assert function_sides.build_reason(tmp_path / "a", tmp_path / "b") == reason


def test_what_is_built_is_imported_from_where_it_is_installed(
    pool: WorkerPool, repository: Repository, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wheel = tmp_path / "own.whl"
    wheel.touch()
    release = ReleaseSpec("main", "4.0.0", own_wheels=(wheel,))
    monkeypatch.setattr(function_sides, "build_reason", lambda *trees: "a test")
    monkeypatch.setattr(function_sides.revision_builds, "built", lambda *_: release)
    for target in targets(pool, repository, ("v1", "HEAD"), "speed/bench.py::step"):
        assert not target.source.are_first
        assert target.origin.folders[1].endswith(release.key)
        assert target.release is release


def test_files_that_pin_other_versions_are_named(tmp_path: Path) -> None:
    for folder, text in (("a", "numpy==1"), ("b", "numpy==2")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "requirements.txt").write_text(text)
        (tmp_path / folder / "uv.lock").write_text("the same")
    (tmp_path / "b/poetry.lock").touch()
    changed = function_sides.changed_locks(tmp_path / "a", tmp_path / "b")
    assert changed == ["poetry.lock", "requirements.txt"]


# Of environments.

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
    parsed = function_sides.parse_functions(functions, cwd, Path(cwd.anchor))
    return EnvironmentComparison([OLD, NEW], parsed, cwd)


def test_both_sides_run_the_same_code_with_their_own_packages(tmp_path: Path, cache: Path) -> None:
    cwd = tmp_path / "work"
    cwd.mkdir()
    (cwd / "bench.py").write_text("def step(): pass\n")
    ((old, new),) = function_sides.install_all(comparison(cwd, "bench.py::step"))
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
    ((old, _),) = function_sides.install_all(comparison(tmp_path, "speed/bench.py::step"))
    assert (old.source.module, old.source.folders) == ("speed.bench", (str(tmp_path),))
