"""Which files a model is compiled from."""

import zlib
from pathlib import Path

import mujoco
import pytest

from mjbench.simulation import models

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def png(width: int) -> bytes:
    """Return a grey image whose columns get brighter."""
    rows = b"".join(b"\0" + bytes(range(width)) for _ in range(width))

    def chunk(kind: bytes, content: bytes) -> bytes:
        checksum = zlib.crc32(kind + content).to_bytes(4)
        return len(content).to_bytes(4) + kind + content + checksum

    size = width.to_bytes(4)
    header = chunk(b"IHDR", size + size + bytes([8, 0, 0, 0, 0]))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A model with an included file, a mesh, a texture and a height field, in several folders."""
    for folder in ("assets/textures", "parts"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "assets/tetrahedron.obj").write_text(TETRAHEDRON)
    (tmp_path / "assets/textures/grey.png").write_bytes(png(8))
    (tmp_path / "terrain.png").write_bytes(png(9))
    (tmp_path / "parts/arm.xml").write_text(
        "<mujoco><worldbody><body pos='1 0 1'><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    file = tmp_path / "robot.xml"
    file.write_text(
        "<mujoco><compiler meshdir='assets' texturedir='assets/textures'/>"
        "<include file='parts/arm.xml'/><asset><mesh name='m' file='tetrahedron.obj'/>"
        "<texture name='t' type='2d' file='grey.png'/>"
        "<hfield name='h' file='../terrain.png' size='1 1 .1 .1'/></asset>"
        "<worldbody><geom type='hfield' hfield='h'/>"
        "<body pos='0 0 1'><freejoint/><geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    )
    return file


@pytest.mark.skipif(
    not hasattr(mujoco, "mju_getXMLDependencies"), reason="needs a MuJoCo that lists files"
)
def test_all_files_of_a_model_are_found_its_own_first(robot: Path) -> None:
    files = models.files_of(robot)
    assert files[0] == str(robot)
    names = {str(Path(file).resolve().relative_to(robot.parent.resolve())) for file in files}
    assert names == {
        "robot.xml",
        "parts/arm.xml",
        "assets/tetrahedron.obj",
        "assets/textures/grey.png",
        "terrain.png",
    }


def test_a_copy_of_these_files_elsewhere_compiles(robot: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    for file in models.files_of(robot):
        target = copy / Path(file).resolve().relative_to(robot.parent.resolve())
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(Path(file).read_bytes())
    assert mujoco.MjModel.from_xml_path(str(copy / "robot.xml")).nmesh == 1


def test_a_compiled_model_is_one_file(robot: Path) -> None:
    compiled = robot.with_suffix(".mjb")
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_path(str(robot)), str(compiled), None)
    assert models.files_of(compiled) == (str(compiled),)
