"""Wheels that a user names. None is a real one: a zip file with the right names is enough."""

import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from packaging import tags

from mjbench.errors import InputError
from mjbench.releases import release_names, wheels

HERE = str(next(tags.sys_tags()))


def write_wheel(folder: Path, name: str, content: str = "") -> Path:
    """Write a wheel `PROJECT-VERSION`, or with tags behind it, that holds one file."""
    file = folder / f"{name}{'' if name.count('-') > 1 else '-py3-none-any'}.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("mujoco/__init__.py", content)
        archive.writestr(f"{'-'.join(name.split('-')[:2])}.dist-info/RECORD", "")
    return file


def test_local_wheels_are_distinguished_by_content(tmp_path: Path) -> None:
    keys = []
    for content in ("one", "two"):
        release = release_names.parse_release(str(write_wheel(tmp_path, "mujoco-4.1.0", content)))
        assert release.version == "4.1.0"
        keys.append(release.key)
    assert keys[0] != keys[1]


def test_a_wheel_with_a_local_version_is_a_release(tmp_path: Path) -> None:
    for name in ("mujoco-4.1.0+g1a2b3c", "mujoco_core-4.1.0+g1a2b3c", "mujoco_core-4.1.0"):
        write_wheel(tmp_path, name)
    release = release_names.parse_release(str(tmp_path))
    assert release.version == "4.1.0+g1a2b3c"
    assert [wheel.name.split("-")[0] for wheel in release.wheels] == ["mujoco", "mujoco_core"]


def test_a_folder_of_wheels_is_one_release(tmp_path: Path) -> None:
    for name in ("mujoco", "mujoco_core", "mujoco_studio", "mujoco_mjx"):
        write_wheel(tmp_path, f"{name}-4.1.0")
    one = str(tmp_path / "mujoco-4.1.0-py3-none-any.whl")
    for text in (str(tmp_path), one):
        assert release_names.is_release(text)
        release = release_names.parse_release(text)
        assert release.version == "4.1.0"
        projects = [wheel.name.split("-")[0] for wheel in release.wheels]
        assert projects == ["mujoco", "mujoco_core", "mujoco_studio"]


def test_the_current_folder_of_wheels_is_a_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_wheel(tmp_path, "mujoco-4.1.0")
    monkeypatch.chdir(tmp_path)
    assert release_names.is_release(".")
    assert release_names.parse_release(".").version == "4.1.0"
    assert not release_names.is_release("")


def test_of_a_build_for_several_pythons_the_wheels_for_this_one_are_taken(tmp_path: Path) -> None:
    for project in ("mujoco", "mujoco_core"):
        for tag in ("cp27-cp27m-win32", HERE, "cp32-cp32m-win32"):
            write_wheel(tmp_path, f"{project}-4.1.0-{tag}")
    names = [wheel.name for wheel in release_names.parse_release(str(tmp_path)).wheels]
    assert names == [f"mujoco-4.1.0-{HERE}.whl", f"mujoco_core-4.1.0-{HERE}.whl"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "holds no wheel of mujoco"),
        (("mujoco_core-4.1.0",), "holds no wheel of mujoco"),
        (("mujoco-4.0.0", "mujoco-4.1.0"), "holds several releases: name one of its wheels"),
        (("mujoco-4.0.0-cp27-cp27m-win32",), f"for this Python, {HERE}"),
    ],
)
def test_a_folder_without_the_one_wheel_is_refused(
    tmp_path: Path, names: tuple[str, ...], message: str
) -> None:
    for name in names:
        write_wheel(tmp_path, name)
    assert release_names.is_release(str(tmp_path)) == bool(names)
    with pytest.raises(InputError, match=message):
        release_names.parse_release(str(tmp_path))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mujoco_core-4.1.0", "is a wheel of mujoco-core, expected one of mujoco$"),
        ("mujoco-4.1.0-cp27-cp27m-win32", f"is for another Python or platform than this, {HERE}"),
        ("mujoco-4.1.0-py3-none", "a wheel is named PROJECT-VERSION-PYTHON-ABI-PLATFORM.whl"),
        ("mujoco-1.9" + "9" * 200, "a wheel is named|is too old"),
        ("mujoco-2.3.6", "MuJoCo 2.3.6 is too old"),
    ],
)
def test_a_wheel_that_is_no_mujoco_for_this_python_is_refused(
    tmp_path: Path, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        release_names.parse_release(str(write_wheel(tmp_path, name)))


@pytest.mark.parametrize("project", ["mujoco", "mujoco_core"])
def test_a_broken_wheel_is_refused(tmp_path: Path, project: str) -> None:
    write_wheel(tmp_path, "mujoco-4.1.0")
    broken = write_wheel(tmp_path, f"{project}-4.1.0", "content" * 99)
    whole = broken.read_bytes()
    for content in (b"", b"no zip", whole[: len(whole) // 2], whole[:-1]):
        broken.write_bytes(content)
        with pytest.raises(InputError, match=f"{broken.name} is broken: .*; copy it again"):
            release_names.parse_release(str(tmp_path))
    with zipfile.ZipFile(broken, "w") as archive:
        archive.writestr("notes.txt", "no package")
    with pytest.raises(InputError, match="holds no package"):
        release_names.parse_release(str(tmp_path))


def test_a_source_archive_is_refused(tmp_path: Path) -> None:
    archive = tmp_path / "mujoco-4.1.0.tar.gz"
    archive.write_bytes(b"archive")
    assert release_names.is_release(str(archive))
    with pytest.raises(InputError, match="is a source archive: name a wheel"):
        release_names.parse_release(str(archive))


def test_a_wheel_that_may_not_be_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The refusal is the operating system's; root, who may run the tests, gets none."""

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied")

    file = write_wheel(tmp_path, "mujoco-4.1.0")
    release = release_names.parse_release(str(file))
    with monkeypatch.context() as patch:
        patch.setattr(zipfile, "ZipFile", refuse)
        with pytest.raises(InputError, match=r"^cannot read \S+.whl: Permission denied$"):
            release_names.parse_release(str(file))
    file.unlink()  # after it was named
    with pytest.raises(InputError, match=r"^cannot read \S+.whl: No such file or directory$"):
        _ = release.key


@settings(deadline=None)
@given(st.binary(max_size=60) | st.binary(max_size=60).map(b"PK\5\6".__add__))
def test_any_content_is_a_wheel_or_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    file = tmp_path_factory.getbasetemp() / "mujoco-4.1.0-py3-none-any.whl"
    file.write_bytes(content)
    with pytest.raises(InputError):
        wheels.find(str(file))
