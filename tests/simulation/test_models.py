import contextlib
import os
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.errors import InputError
from mjbench.simulation import models

XML = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
URDF = """
<robot name="arm">
  <mujoco><compiler meshdir="meshes"/></mujoco>
  <link name="base"/>
  <link name="arm">
    <inertial>
      <mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><geometry><mesh filename="part.stl"/></geometry></collision>
  </link>
  <joint name="hinge" type="continuous">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
  </joint>
</robot>
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with models in it, whose import would fail."""
    root = tmp_path / "robots_pkg"
    for name in ("ant.xml", "deep/arm.xml", "one/hand.xml", "two/hand.xml"):
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(XML)
    (root / "__init__.py").write_text("raise RuntimeError('must not be imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    return root


def test_shipped_models_are_found_by_name() -> None:
    assert "cartpole" in models.shipped()
    assert models.resolve("cartpole").path.name == "cartpole.xml"


def test_a_file_is_found_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    assert models.load(models.resolve(str(tmp_path / "robot.xml"))).nv == 6


def test_a_compiled_model_loads(tmp_path: Path) -> None:
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(XML), str(tmp_path / "robot.mjb"))
    assert models.load(models.resolve(str(tmp_path / "robot.mjb"))).nv == 6


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_model_in_utf_16_is_refused_with_what_to_do(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "robot.xml").write_text(XML, encoding)
    with pytest.raises(InputError, match="it is encoded in UTF-16, which MuJoCo does not read: "):
        models.load(models.resolve(str(tmp_path / "robot.xml")))


def test_a_packages_model_is_found_without_importing_the_package(package: Path) -> None:
    assert models.resolve("robots_pkg:ant").path == package / "ant.xml"
    assert models.resolve("robots_pkg:deep/arm").path == package / "deep/arm.xml"
    assert models.resolve("robots_pkg:one/hand.xml").path == package / "one/hand.xml"
    assert "robots_pkg" not in sys.modules


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robots_pkg:hand", "ambiguous, name one of: one/hand.xml, two/hand.xml"),
        ("robots_pkg:amt", "did you mean arm, ant"),
        ("robots_pkg:", "no model ''; it has ant, arm, hand"),
        ("robots_pkg:*", "no model"),
        ("robots_pkg:an?", "no model"),
        ("robots_pkg:[a]nt", "no model"),
        ("robots_pkg:a\0nt", "no model"),
        ("robots_pkg:" + "a" * 5000, "no model"),
        ("robots_pkg.deep:arm", "robots_pkg:deep/arm$"),
        ("math:x", "math is a module without a folder"),
        ("gymnasium_robotics:x", "pip install gymnasium-robotics"),
        ("cartpol", "did you mean cartpole"),
        ("nowhere/robot.xml", "no such file"),
    ],
)
def test_an_unknown_name_is_an_error_that_suggests_others(
    package: Path, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        models.resolve(name)


@pytest.mark.parametrize("name", ["/ant.xml", "../ant.xml", "deep/../../secret.xml"])
def test_a_packages_model_lies_inside_the_package(package: Path, name: str) -> None:
    (package.parent / "secret.xml").write_text(XML)
    (package.parent / "ant.xml").write_text(XML)
    with pytest.raises(InputError, match="must be a file inside the package"):
        models.resolve(f"robots_pkg:{name}")


def test_a_packages_file_may_be_a_link_because_installers_create_them(package: Path) -> None:
    elsewhere = package.parent / "cache.xml"
    elsewhere.write_text(XML)
    (package / "linked.xml").symlink_to(elsewhere)
    assert models.resolve("robots_pkg:linked").path == package / "linked.xml"


def test_a_robot_as_mjcf_and_as_urdf_is_not_ambiguous(package: Path) -> None:
    for name in ("ant.urdf", "deep/arm.urdf", "deep/wheel.urdf"):
        (package / name).write_text(URDF)
    assert models.resolve("robots_pkg:ant").path == package / "ant.xml"
    assert models.resolve("robots_pkg:arm").path == package / "deep/arm.xml"
    assert models.resolve("robots_pkg:ant.urdf").path == package / "ant.urdf"
    assert models.resolve("robots_pkg:wheel").path == package / "deep/wheel.urdf"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (r"C:\robots\a.xml", "no such file: C:.robots.a.xml"),
        ("C:/robots/a.xml", "no such file: C:/robots/a.xml"),
        ("https://example.org/a.xml", "is an address: download the model"),
        ("dm_kontrol:x", r"no package 'dm_kontrol' is installed here \(did you mean dm_control"),
        ("github.com:a/b", "no package 'github' is installed here"),
        ("requestes:x", "no package 'requestes' is installed here$"),
    ],
)
def test_only_well_known_packages_are_recommended(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        models.resolve(name)
    assert "pip" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "no model ''"),
        (" ", "no model ' '"),
        ("a" * 5000, "no model 'aaa"),
        ("a" * 5000 + ".xml", "no such file: aaa"),
        ("a\0b.xml", r"no such file: 'a\\x00b.xml'"),
        ("a\nb.xml", r"no such file: 'a\\nb.xml'"),
        ("\udc80.xml", r"no such file: '\\udc80.xml'"),
        ("~\0/a.xml", r"no home folder .~.x00. is known"),
        ("~no_such_user/a.xml", "no home folder ~no_such_user is known"),
    ],
)
def test_an_odd_name_is_an_error_of_one_short_line(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        models.resolve(name)
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 400


def test_a_home_folder_that_is_unknown_leaves_the_name_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Path, "expanduser", unknown)
    with pytest.raises(InputError, match="no home folder ~ is known"):
        models.resolve("~/robot.xml")
    (tmp_path / "~robot.xml").write_text(XML)
    assert models.resolve("~robot.xml").path == tmp_path / "~robot.xml"


def test_what_is_no_model_file_is_refused_by_what_it_is(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "empty.xml").touch()
    (tmp_path / "folder.xml").mkdir()
    (tmp_path / "dangling.xml").symlink_to("gone.xml")
    (tmp_path / "loop.xml").symlink_to("loop.xml")
    (tmp_path / "notes.txt").write_text("notes")
    (tmp_path / "train.py").write_text("pass")
    for name, message in {
        "pipe.xml": "is not a regular file",
        "/dev/zero": "is not a regular file",
        "empty.xml": "is empty",
        "folder.xml": "is a folder",
        "dangling.xml": r"is a link to gone\.xml, which does not exist",
        "loop.xml": "cannot read .*: Too many levels of symbolic links",
        "notes.txt": r"a model file ends in \.xml, \.urdf or \.mjb$",
        "train.py": r"\.mjb; `mjbench run \S+train\.py` runs a program$",
        "notes.txt/robot.xml": "no such file",
    }.items():
        with pytest.raises(InputError, match=message):
            models.resolve(str(tmp_path / name))


@pytest.mark.parametrize("refused", ["stat", "open"])
def test_a_file_that_may_not_be_read_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: str
) -> None:
    """The refusal is the operating system's; root, who may run the tests, gets none."""

    file = tmp_path / "robot.xml"
    file.write_text(XML)
    permitted = getattr(Path, refused)

    def refuse(path: Path, *arguments: Any, **options: Any) -> Any:
        if path == file:
            raise PermissionError(13, "Permission denied", str(path))
        return permitted(path, *arguments, **options)

    monkeypatch.setattr(Path, refused, refuse)
    with pytest.raises(InputError, match=r"^cannot read \S+robot.xml: Permission denied$"):
        models.resolve(str(file))


@pytest.mark.parametrize("name", ["robot.urdf", "ROBOT.URDF", "robot.xml"])
def test_urdf_loads_with_its_meshes_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = tmp_path / "robot"
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes/part.stl").write_bytes(tetrahedron())
    (folder / name).write_text(URDF)
    monkeypatch.chdir(tmp_path)
    source = models.resolve(f"robot/{name}")
    monkeypatch.chdir("/")
    assert models.load(source).nv == 1


def test_meshes_lie_beside_a_link_as_for_mujoco(tmp_path: Path) -> None:
    """Caches of downloads link each file to one of another name in another folder."""
    (tmp_path / "blobs").mkdir()
    (tmp_path / "blobs/0a1b").write_text(URDF)
    (tmp_path / "blobs/2c3d").write_bytes(tetrahedron())
    (tmp_path / "robot/meshes").mkdir(parents=True)
    (tmp_path / "robot/robot.urdf").symlink_to(tmp_path / "blobs/0a1b")
    (tmp_path / "robot/meshes/part.stl").symlink_to(tmp_path / "blobs/2c3d")
    assert models.load(models.resolve(str(tmp_path / "robot/robot.urdf"))).nv == 1


def test_meshes_of_a_ros_package_are_named_with_what_to_do(tmp_path: Path) -> None:
    """A mesh beside the URDF, named by its file alone, loads in each release."""
    (tmp_path / "part.stl").write_bytes(tetrahedron())
    file, urdf = tmp_path / "robot.urdf", URDF.replace(' meshdir="meshes"', "")
    file.write_text(urdf.replace("part.stl", "package://robot/meshes/part.stl"))
    with pytest.raises(InputError, match=r"part\.stl'; MuJoCo finds no packages of ROS: put "):
        models.load(models.resolve(str(file)))
    file.write_text(urdf)
    assert models.load(models.resolve(str(file))).nv == 1


def tetrahedron() -> bytes:
    """Return a mesh of four triangles as binary STL."""
    corners = ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1))
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
    triangles = (
        struct.pack("<12fH", 0, 0, 0, *(x for corner in face for x in corners[corner]), 0)
        for face in faces
    )
    return bytes(80) + struct.pack("<I", len(faces)) + b"".join(triangles)


@pytest.mark.parametrize("content", [b"mjb", b"\0" * 400])
def test_a_compiled_model_of_another_release_says_what_can_load_it(
    tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "robot.mjb").write_bytes(content)
    with pytest.raises(InputError, match=r"only the release that saved an \.mjb file can load it"):
        models.load(models.resolve(str(tmp_path / "robot.mjb")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The current folder, with a package in it whose import would fail."""
    folder = tmp_path_factory.mktemp("any_text")
    (folder / "robots_pkg" / "a").mkdir(parents=True)
    (folder / "robots_pkg" / "a" / "b.xml").write_text(XML)
    (folder / "robots_pkg" / "__init__.py").write_text("raise RuntimeError('was imported')")
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder


TEXT = st.text(st.sampled_from("ab./~:\\*?[]\0\n -") | st.characters(), max_size=40)


@settings(deadline=None)
@given(TEXT | TEXT.map("robots_pkg:{}".format) | TEXT.map("~{}".format))
def test_any_text_is_a_model_or_an_input_error(folder: Path, name: str) -> None:
    try:
        assert models.resolve(name).name == name
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco>", "cannot load"),
        ("", "is empty"),
        (" ", "cannot load"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "no degree of freedom"),
    ],
)
def test_a_broken_file_is_an_error_of_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        models.load(models.resolve(str(tmp_path / "bad.xml")))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("timestep", ["0", "-0.002", "nan", "inf", "1e-20"])
def test_a_timestep_by_which_no_time_passes_is_bad_input(tmp_path: Path, timestep: str) -> None:
    file = tmp_path / "still.xml"
    file.write_text(XML.replace("<mujoco>", f"<mujoco><option timestep='{timestep}'/>"))
    with pytest.raises(InputError, match="it must be above 0 and finite"):
        models.load(models.resolve(str(file)))
