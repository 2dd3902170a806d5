"""Packages that a user names, and what an environment holds."""

import zipfile
from pathlib import Path

import pytest

from mjbench.errors import InputError
from mjbench.releases import install_check, named_packages, release_names
from mjbench.releases.named_packages import NamedPackages


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install_check, "installed_version", lambda: "4.0.0")


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    file = tmp_path / "own_tool-1.0-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("own_tool-1.0.dist-info/RECORD", "")
    return file


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("jax==0.7.0", True),
        ("jax==0.7.0,jaxlib==0.7.0", True),
        ("dist/own-1.0-py3-none-any.whl", True),
        ("dist/mujoco-4.1.0-cp311-cp311-linux_x86_64.whl", False),
        ("3.5.0", False),
        ("robot.xml", False),
        ("gymnasium:ant", False),
    ],
)
def test_packages_are_distinguished_from_releases_and_models(text: str, expected: bool) -> None:
    assert named_packages.are_packages(text) is expected


def test_packages_stand_beside_the_release_of_this_environment() -> None:
    release = release_names.parse_release("jax==0.7.0, jaxlib==0.7.0")
    assert (release.version, release.label) == ("4.0.0", "jax==0.7.0, jaxlib==0.7.0")
    assert release.beside == ("jax==0.7.0", "jaxlib==0.7.0")
    assert release.has_packages
    assert "-numpy" in release.key
    other = release_names.parse_release("jax==0.7.1,jaxlib==0.7.0")
    assert other.key != release.key


def test_a_comma_at_the_end_changes_nothing() -> None:
    assert release_names.parse_release("jax==0.7.0,").beside == ("jax==0.7.0",)


def test_mujoco_may_be_among_them() -> None:
    release = release_names.parse_release("mujoco==3.5.0,numpy==2.3.0")
    assert (release.version, release.beside) == ("3.5.0", ("numpy==2.3.0",))
    assert "-numpy" not in release.key


def test_mujoco_alone_is_a_release() -> None:
    assert release_names.parse_release("mujoco==3.5.0") == release_names.parse_release("3.5.0")


def test_wheels_may_be_among_them(wheel: Path) -> None:
    named = named_packages.parse(f"{wheel},jax==0.7.0")
    assert named == NamedPackages("", ("jax==0.7.0",), (wheel.resolve(),))
    release = release_names.parse_release(str(wheel))
    assert named_packages.names_of(release.beside) == {"own-tool"}
    assert release.files == (wheel.resolve(),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jax==", "is no package: give NAME==VERSION"),
        ("jax==0.7.0,JAX==0.7.1", "names jax twice"),
        ("none-1.0-py3-none-any.whl", "no such wheel"),
        ("mujoco==3.5.0,mujoco==3.6.0", "names mujoco twice"),
        ("mujoco>=3.5,numpy==2.3.0", "give one version"),
        ("mujoco==2.0.0", "too old"),
        (",==", "is no package"),
    ],
)
def test_what_names_no_packages_is_refused_in_a_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        release_names.parse_release(text)
    assert "\n" not in str(raised.value)


def write(folder: Path, name: str, version: str, *files: str) -> None:
    """Write what pip leaves of a package."""
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Name: {name}\nVersion: {version}\n")
    (info / "RECORD").write_text("".join(f"{file},,1\n" for file in files))


def test_what_an_environment_holds_is_read_from_what_pip_left(tmp_path: Path) -> None:
    write(tmp_path, "Own-Tool", "1.0", "own_tool/__init__.py", "_own.cpython-311.so", "../bin/own")
    write(tmp_path, "scipy", "1.17.0", "scipy/__init__.py")
    assert named_packages.versions(tmp_path) == {"own-tool": "1.0", "scipy": "1.17.0"}
    assert named_packages.modules(tmp_path, {"own-tool"}) == {"own_tool", "_own"}


def test_names_in_a_stored_text_are_read_as_far_as_it_has_any() -> None:
    assert named_packages.names_in("jax==0.7.0,\x1b[31m,jaxlib") == {"jax", "jaxlib"}
