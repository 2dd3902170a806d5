"""Isolated installs of releases: names, locks, interruption. Nothing is downloaded."""

import multiprocessing
import os
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.releases import installs


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "cache"
    monkeypatch.setenv("MJBENCH_CACHE", str(folder))
    yield folder


@pytest.fixture
def pip(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Replace pip by a function that writes a file; return the releases it has to install."""
    requested: list[str] = []

    def install(release: installs.ReleaseSpec, target: Path) -> None:
        requested.append(release.version)
        (target / "mujoco").mkdir(parents=True)
        (target / "mujoco" / "__init__.py").write_text(f"__version__ = '{release.version}'\n")

    monkeypatch.setattr(installs, "_pip_install", install)
    return requested


@pytest.mark.parametrize(
    ("text", "release"),
    [
        ("3.5.0", True),
        ("v3.5.0", True),
        ("4.1.0rc1", True),
        ("2.3.1.post1", True),
        ("4.1.0.dev20260101", True),
        ("4.1.0+g1a2b3c", True),
        ("installed", True),
        ("dist/mujoco-4.1.0-cp311-cp311-linux_x86_64.whl", True),
        ("3.5", True),
        ("cartpole", False),
        ("robot.xml", False),
        ("3", False),
        ("v3", False),
        ("3.x", False),
    ],
)
def test_releases_are_distinguished_from_models(text: str, release: bool) -> None:
    assert installs.is_release(text) is release


def test_a_release_is_installed_once(pip: list[str]) -> None:
    release = installs.parse_release("v3.5.0")
    for _ in range(2):
        with installs.use(release) as folder:
            assert folder is not None
            assert "3.5.0" in (folder / "mujoco/__init__.py").read_text()
    assert pip == ["3.5.0"]
    assert [n.partition("-")[0] for n in installs.install_names()] == ["3.5.0"]


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("3.5.0", "3.5.0"),
        ("v3.5.0", "3.5.0"),
        ("3.5", "3.5.0"),
        ("v3.5", "3.5.0"),
        ("3.5rc1", "3.5.0rc1"),
        ("4.1.0rc1", "4.1.0rc1"),
        ("4.1.0.dev3", "4.1.0.dev3"),
        ("4.1.0dev3", "4.1.0.dev3"),
        ("2.3.1.post1", "2.3.1.post1"),
        ("4.1.0+g1a2b3c", "4.1.0+g1a2b3c"),
    ],
)
def test_a_version_is_read_as_packaging_reads_it_and_a_short_one_is_the_first_of_its_minor(
    text: str, version: str
) -> None:
    release = installs.parse_release(text)
    assert release.version == version
    assert release.key.startswith(f"{version}-cpython-")


@pytest.mark.parametrize("text", ["3", "cartpole", "no/such/mujoco-3.5.0-py3-none-any.whl"])
def test_what_names_no_release_is_refused_with_what_was_given(text: str) -> None:
    with pytest.raises(InputError, match=text):
        installs.parse_release(text)


def test_the_environments_own_release_is_not_the_same_one_of_the_index() -> None:
    here = installs.parse_release("installed")
    assert here.key != installs.parse_release(here.version).key


def test_the_environments_own_release_needs_no_install(pip: list[str]) -> None:
    with installs.use(installs.parse_release("installed")) as folder:
        assert folder is None
    assert pip == []


def test_an_interrupted_install_is_not_used_and_is_repeated(
    pip: list[str], monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    release = installs.parse_release("3.5.0")
    complete = installs._pip_install

    def interrupted(release: installs.ReleaseSpec, target: Path) -> None:
        complete(release, target)
        raise KeyboardInterrupt

    monkeypatch.setattr(installs, "_pip_install", interrupted)
    with pytest.raises(KeyboardInterrupt):
        installs.install(release)
    assert installs.install_names() == []
    assert [p.name for p in cache.iterdir()] == ["locks"]
    # killed outright, it cannot remove what it installed so far
    partial = cache / f".{release.key}.partial"
    (partial / "mujoco").mkdir(parents=True)
    monkeypatch.setattr(installs, "_pip_install", complete)
    folder = installs.install(release)
    assert folder.is_dir()
    assert not partial.exists()


def _install(text: str, cache: str, count: Any) -> None:
    os.environ["MJBENCH_CACHE"] = cache

    def slow(release: installs.ReleaseSpec, target: Path) -> None:
        with count.get_lock():
            count.value += 1
        target.mkdir(parents=True)
        for number in range(2000):
            (target / "file").write_text(str(number))

    installs._pip_install = slow
    installs.install(installs.parse_release(text))


def test_two_processes_install_the_same_release_once(cache: Path) -> None:
    context = multiprocessing.get_context("spawn")
    count = context.Value("i", 0)
    workers = [
        context.Process(target=_install, args=("3.5.0", str(cache), count)) for _ in range(3)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [worker.exitcode for worker in workers] == [0, 0, 0]
    assert count.value == 1
    assert len(installs.install_names()) == 1


def test_an_install_in_use_is_not_removed(pip: list[str]) -> None:
    release = installs.parse_release("3.5.0")
    with installs.use(release), pytest.raises(MachineError, match="in use"):
        installs.remove(release.key)
    installs.remove(release.key)
    assert installs.install_names() == []


def _hold(cache: str, pipe: Any) -> None:
    os.environ["MJBENCH_CACHE"] = cache
    with installs.use(installs.parse_release("3.5.0")):
        pipe.send("in use")
        pipe.recv()  # nothing comes: this process is killed


def test_a_killed_user_of_an_install_does_not_keep_it_locked(pip: list[str], cache: Path) -> None:
    release = installs.parse_release("3.5.0")
    installs.install(release)
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    user = context.Process(target=_hold, args=(str(cache), theirs))
    user.start()
    assert ours.recv() == "in use"
    with pytest.raises(MachineError, match="in use"):
        installs.remove(release.key)
    user.kill()
    user.join()
    installs.remove(release.key)
    assert installs.install_names() == []


def test_removing_an_unknown_install_names_the_known_ones(pip: list[str]) -> None:
    installs.install(installs.parse_release("3.5.0"))
    with pytest.raises(InputError, match=r"no install '3\.6\.0'; there are 3\.5\.0-"):
        installs.remove("3.6.0")


def test_local_wheels_are_distinguished_by_content(tmp_path: Path) -> None:
    wheel = tmp_path / "mujoco-4.1.0-py3-none-any.whl"
    keys = []
    for content in ("one", "two"):
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr("mujoco/__init__.py", content)
        release = installs.parse_release(str(wheel))
        assert release.version == "4.1.0"
        keys.append(release.key)
    assert keys[0] != keys[1]


def test_a_wheel_with_a_local_version_is_a_release(tmp_path: Path) -> None:
    for name in ("mujoco-4.1.0+g1a2b3c", "mujoco_core-4.1.0+g1a2b3c", "mujoco_core-4.1.0"):
        (tmp_path / f"{name}-py3-none-any.whl").write_bytes(b"x")
    release = installs.parse_release(str(tmp_path))
    assert release.version == "4.1.0+g1a2b3c"
    assert [wheel.name.split("-")[0] for wheel in release.wheels] == ["mujoco", "mujoco_core"]


@pytest.mark.skipif(sys.platform != "linux", reason="the place is that of Linux")
@pytest.mark.parametrize(("variable", "expected"), [("", ".cache/mjbench"), ("xdg", "xdg/mjbench")])
def test_installs_are_kept_in_the_users_cache_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, variable: str, expected: str
) -> None:
    monkeypatch.delenv("MJBENCH_CACHE")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / variable) if variable else "")
    assert installs.cache_folder() == tmp_path / expected


def test_a_folder_of_wheels_is_one_release(tmp_path: Path) -> None:
    for name in ("mujoco", "mujoco_core", "mujoco_studio"):
        (tmp_path / f"{name}-4.1.0-py3-none-any.whl").write_bytes(b"x")
    one = str(tmp_path / "mujoco-4.1.0-py3-none-any.whl")
    for text in (str(tmp_path), one):
        release = installs.parse_release(text)
        assert release.version == "4.1.0"
        assert len(release.wheels) == 3


def test_a_cache_folder_that_cannot_be_written_is_reported(
    pip: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    monkeypatch.setenv("MJBENCH_CACHE", str(file / "below"))
    with pytest.raises(MachineError, match="MJBENCH_CACHE"):
        installs.install(installs.parse_release("3.5.0"))


def test_an_unreachable_index_is_reported_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_RETRIES", "0")
    with pytest.raises(MachineError) as caught:
        installs.install(installs.parse_release("3.5.0"))
    assert "cannot install MuJoCo 3.5.0" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert installs.install_names() == []
