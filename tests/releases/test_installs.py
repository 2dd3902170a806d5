"""Isolated installs of releases: names, locks, interruption. Nothing is downloaded."""

import base64
import errno
import hashlib
import multiprocessing
import os
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.host import platforms
from mjbench.releases import install_check, installs, package_index, release_names


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "cache"
    monkeypatch.setenv("MJBENCH_CACHE", str(folder))
    yield folder


@pytest.fixture
def pip(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Replace pip by a function that writes a package; return the releases it has to install."""
    requested: list[str] = []

    def install(
        version: str, wheels: Sequence[Path], target: Path, own_wheels: Sequence[Path]
    ) -> None:
        requested.append(version)
        write_package(target, version)

    monkeypatch.setattr(installs.pip, "install", install)
    return requested


def write_package(target: Path, version: str) -> None:
    """Write what pip leaves of a `mujoco` with one file."""
    content = f"__version__ = '{version}'\n".encode()
    sha256 = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
    record = f"mujoco/__init__.py,sha256={sha256},{len(content)}\n"
    for name, text in {
        "mujoco/__init__.py": content,
        f"mujoco-{version}.dist-info/RECORD": record.encode(),
    }.items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(text)


def test_a_release_is_installed_once(pip: list[str]) -> None:
    release = release_names.parse_release("v3.5.0")
    for _ in range(2):
        with installs.use(release) as folder:
            assert folder is not None
            assert "3.5.0" in (folder / "mujoco/__init__.py").read_text()
    assert pip == ["3.5.0"]
    assert [n.partition("-")[0] for n in installs.install_names()] == ["3.5.0"]


def test_the_environments_own_release_needs_no_install(pip: list[str]) -> None:
    with installs.use(release_names.parse_release("installed")) as folder:
        assert folder is None
    assert pip == []


def test_an_interrupted_install_is_not_used_and_is_repeated(
    pip: list[str], monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    release = release_names.parse_release("3.5.0")
    complete = installs.pip.install

    def interrupted(
        version: str, wheels: Sequence[Path], target: Path, own_wheels: Sequence[Path]
    ) -> None:
        complete(version, wheels, target, own_wheels)
        raise KeyboardInterrupt

    monkeypatch.setattr(installs.pip, "install", interrupted)
    with pytest.raises(KeyboardInterrupt):
        installs.install(release)
    assert installs.install_names() == []
    assert [p.name for p in cache.iterdir()] == ["locks"]
    # killed outright, it cannot remove what it installed so far
    partial = cache / f".{release.key}.partial"
    (partial / "mujoco").mkdir(parents=True)
    monkeypatch.setattr(installs.pip, "install", complete)
    folder = installs.install(release)
    assert folder.is_dir()
    assert not partial.exists()


def _install(text: str, cache: str, count: Any) -> None:
    os.environ["MJBENCH_CACHE"] = cache

    def slow(
        version: str, wheels: Sequence[Path], target: Path, own_wheels: Sequence[Path]
    ) -> None:
        with count.get_lock():
            count.value += 1
        write_package(target, version)
        for number in range(2000):
            (target / "file").write_text(str(number))

    installs.pip.install = slow
    installs.install(release_names.parse_release(text))


def test_two_processes_install_the_same_release_once(cache: Path) -> None:
    context = multiprocessing.get_context("spawn")
    count = context.Value("i", 0)
    workers = [
        context.Process(target=_install, args=("3.5.0", str(cache), count)) for _ in range(2)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [worker.exitcode for worker in workers] == [0, 0]
    assert count.value == 1
    assert len(installs.install_names()) == 1


def test_an_install_in_use_is_not_removed(pip: list[str]) -> None:
    release = release_names.parse_release("3.5.0")
    with installs.use(release), pytest.raises(MachineError, match="in use"):
        installs.remove(release.key)
    installs.remove(release.key)
    assert installs.install_names() == []


def _hold(cache: str, pipe: Any) -> None:
    os.environ["MJBENCH_CACHE"] = cache
    with installs.use(release_names.parse_release("3.5.0")):
        pipe.send("in use")
        pipe.recv()  # nothing comes: this process is killed


def test_an_install_in_use_needs_no_second_one(pip: list[str]) -> None:
    release = release_names.parse_release("3.5.0")
    with installs.use(release) as folder:
        assert installs.install(release) == folder  # does not wait for the other
    assert pip == ["3.5.0"]


def test_the_environments_own_release_is_not_installed_again(pip: list[str]) -> None:
    with pytest.raises(InputError, match="the MuJoCo of this environment"):
        installs.install(release_names.parse_release("installed"))
    assert pip == []


def test_a_killed_user_of_an_install_does_not_keep_it_locked(pip: list[str], cache: Path) -> None:
    release = release_names.parse_release("3.5.0")
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
    installs.install(release_names.parse_release("3.5.0"))
    with pytest.raises(InputError, match=r"no install '3\.6\.0'; there are 3\.5\.0-"):
        installs.remove("3.6.0")


@pytest.mark.skipif(sys.platform != "linux", reason="the place is that of Linux")
@pytest.mark.parametrize(("variable", "expected"), [("", ".cache/mjbench"), ("xdg", "xdg/mjbench")])
def test_installs_are_kept_in_the_users_cache_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, variable: str, expected: str
) -> None:
    monkeypatch.delenv("MJBENCH_CACHE")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / variable) if variable else "")
    assert installs.cache_folder() == tmp_path / expected


def test_a_cache_folder_that_cannot_be_written_is_reported(
    pip: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    monkeypatch.setenv("MJBENCH_CACHE", str(file / "below"))
    with pytest.raises(MachineError, match="MJBENCH_CACHE"):
        installs.install(release_names.parse_release("3.5.0"))


def test_a_missing_home_folder_is_reported_and_no_folder_is_called_tilde(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Python leaves `~` where neither HOME nor the list of users has a home folder."""
    monkeypatch.delenv("MJBENCH_CACHE")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MachineError, match=r"no home folder is known.* MJBENCH_CACHE"):
        installs.install(release_names.parse_release("3.5.0"))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_reported_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(
        version: str, wheels: Sequence[Path], target: Path, own_wheels: Sequence[Path]
    ) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))

    monkeypatch.setattr(installs.pip, "install", full)
    with pytest.raises(MachineError, match=r"^cannot install into \S+: No space left on device$"):
        installs.install(release_names.parse_release("3.5.0"))
    assert installs.install_names() == []


def test_a_file_system_without_locks_is_reported(
    pip: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int, **kind: bool) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(platforms, "lock_file", refuse)
    with pytest.raises(MachineError, match=r"cannot lock .*: No locks available"):
        installs.install(release_names.parse_release("3.5.0"))


def test_a_removal_that_was_killed_does_not_prevent_the_next(pip: list[str], cache: Path) -> None:
    release = release_names.parse_release("3.5.0")
    installs.install(release)
    (cache / f".{release.key}.removed" / "mujoco").mkdir(parents=True)
    installs.remove(release.key)
    assert installs.install_names() == []
    assert [p.name for p in cache.iterdir()] == ["locks"]


def test_a_damaged_install_is_refused_until_it_is_removed(pip: list[str]) -> None:
    release = release_names.parse_release("3.5.0")
    file = installs.install(release) / "mujoco" / "__init__.py"
    file.write_bytes(file.read_bytes().replace(b"3.5.0", b"3.5.1"))
    message = f"is damaged: mujoco/__init__.py has been changed; remove it by .* {release.key}"
    with pytest.raises(MachineError, match=re.escape(release.key)), installs.use(release):
        pass
    with pytest.raises(MachineError, match=message.replace("+", r"\+")):
        installs.install(release)
    installs.remove(release.key)
    with installs.use(release) as folder:
        assert folder is not None
    assert pip == ["3.5.0", "3.5.0"]


def test_a_changed_file_of_the_environments_own_release_is_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    release = release_names.parse_release("installed")
    with installs.use(release):
        assert caplog.messages == []
    monkeypatch.setattr(
        install_check, "changed_file", lambda: "mujoco/libmujoco.so has been changed"
    )
    with installs.use(release):
        pass
    said = f"mujoco/libmujoco.so has been changed since MuJoCo {release.version} was installed here"
    assert caplog.messages == [f"mjbench: {said}"]


@pytest.fixture
def index(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the index by one of 3.4.0 and 3.5.0, which is all that pip has."""
    files = {version: [f"mujoco-{version}-py3-none-any.whl"] for version in ("3.4.0", "3.5.0")}
    monkeypatch.setattr(package_index, "files", lambda: files)
    monkeypatch.setattr(installs.pip, "is_available", lambda version: version in files)


@pytest.mark.usefixtures("index")
def test_versions_that_do_not_exist_are_refused_before_any_is_installed(pip: list[str]) -> None:
    refusal = "there is no MuJoCo 9.9.9 on the package index; the nearest are 3.4.0, 3.5.0"
    for name in ("9.9.9", "mujoco==9.9.9,jax==0.7.0"):
        with pytest.raises(InputError, match=f"^{re.escape(refusal)}$"):
            installs.parse_available(["3.5.0", name, "9.9.8"])
    assert [release.version for release in installs.parse_available(["3.5.0", "3.4.0"])] == [
        "3.5.0",
        "3.4.0",
    ]
    assert pip == []


@pytest.mark.usefixtures("index")
def test_a_version_that_pip_has_from_elsewhere_is_not_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(installs.pip, "is_available", lambda version: True)
    assert installs.parse_available(["9.9.9"])[0].version == "9.9.9"


def test_without_an_index_no_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable() -> None:
        raise MachineError("cannot read the releases of mujoco from the package index: refused")

    monkeypatch.setattr(package_index, "files", unreachable)
    assert installs.parse_available(["9.9.9"])[0].version == "9.9.9"


def test_the_index_is_not_asked_for_what_is_there(
    pip: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    installs.install(release_names.parse_release("3.5.0"))
    monkeypatch.setattr(package_index, "files", lambda: pytest.fail("the index is asked"))
    assert len(installs.parse_available(["3.5.0", "installed"])) == 2
