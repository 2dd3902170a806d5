"""A model travels with all that it refers to, and arrives as it was sent."""

import dataclasses
from pathlib import Path

import mujoco
import pytest
from example_models import CONTACT_XML

from mjbench.errors import InputError, MachineError
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.sweep import model_files

pytestmark = pytest.mark.usefixtures("inline")
CUBE = "\n".join(["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4", "f 1 4 3",
                  "f 2 3 4"])  # fmt: skip
WITH_MESH = """<mujoco><compiler meshdir="../meshes"/><include file="options.xml"/>
<asset><mesh name="cube" file="{file}"/></asset>
<worldbody><body><freejoint/><geom type="mesh" mesh="cube"/></body></worldbody></mujoco>"""
URDF = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="cube.obj"/></geometry></collision></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""


@pytest.fixture
def robot(tmp_path: Path) -> ModelSource:
    """Return a model with a mesh and an included file, beside a file that it does not need."""
    for folder in ("robots", "meshes", "other"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes/cube.obj").write_text(CUBE)
    (tmp_path / "meshes/unused.obj").write_text(CUBE)
    (tmp_path / "robots/options.xml").write_text("<mujoco><option timestep='0.001'/></mujoco>")
    (tmp_path / "robots/arm.xml").write_text(WITH_MESH.format(file="cube.obj"))
    return ModelSource("robots/arm.xml", tmp_path / "robots/arm.xml")


def test_a_model_takes_along_what_it_refers_to_and_nothing_else(robot: ModelSource) -> None:
    carried = model_files.carry(robot)
    assert carried.main == "robots/arm.xml"
    assert set(carried.files) == {
        "robots/arm.xml",
        "robots/options.xml",
        "meshes/cube.obj",
    }


def test_a_path_through_another_folder_takes_along_the_same(
    robot: ModelSource, tmp_path: Path
) -> None:
    roundabout = ModelSource(robot.name, tmp_path / "other" / ".." / "robots/arm.xml")
    assert model_files.carry(roundabout) == model_files.carry(robot)


def test_it_can_be_loaded_where_it_arrives_by_the_name_that_it_had(
    robot: ModelSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    carried = model_files.carry(robot)
    index = model_files.unpack([carried], tmp_path / "arrived")
    monkeypatch.setenv(models.CARRIED_VARIABLE, str(index))
    source = models.resolve("robots/arm.xml")
    assert source.name == "robots/arm.xml"
    assert source.path.is_relative_to(tmp_path / "arrived")
    assert models.load(source).opt.timestep == 0.001


def test_two_models_with_a_file_of_one_name_do_not_mix(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "robot.xml").write_text(
            CONTACT_XML.replace("<mujoco", f"<!--{name}--><mujoco")
        )
    carried = [
        model_files.carry(ModelSource(f"{name}/robot.xml", tmp_path / name / "robot.xml"))
        for name in ("a", "b")
    ]
    index = model_files.unpack(carried, tmp_path / "arrived")
    texts = [
        path.read_text().strip()[:8]
        for path in (index.parent / f"{number}/robot.xml" for number in (0, 1))
    ]
    assert texts == ["<!--a-->", "<!--b-->"]


def test_its_digest_changes_with_each_of_its_files(robot: ModelSource) -> None:
    before = model_files.carry(robot).digest
    assert model_files.carry(robot).digest == before
    (robot.path.parent / "options.xml").write_text("<mujoco><option timestep='0.002'/></mujoco>")
    assert model_files.carry(robot).digest != before


def test_what_was_damaged_on_its_way_is_refused(robot: ModelSource, tmp_path: Path) -> None:
    carried = model_files.carry(robot)
    longer = {path: content + b" " for path, content in carried.files.items()}
    damaged = dataclasses.replace(carried, files=longer)
    with pytest.raises(MachineError, match=r"robots/arm\.xml: its files were damaged"):
        model_files.unpack([damaged], tmp_path / "arrived")


def test_without_the_engines_list_of_files_the_folder_goes_along(
    robot: ModelSource, tmp_path: Path
) -> None:
    (tmp_path / "robots/cube.obj").write_text(CUBE)
    (tmp_path / "robots/robot.urdf").write_text(URDF)
    carried = model_files.carry(ModelSource("robot.urdf", tmp_path / "robots/robot.urdf"))
    assert set(carried.files) == {
        "arm.xml",
        "cube.obj",
        "options.xml",
        "robot.urdf",
    }


def test_a_compiled_model_is_one_file(tmp_path: Path, robot: ModelSource) -> None:
    file = tmp_path / "meshes/arm.mjb"
    mujoco.mj_saveModel(models.load(robot), str(file), None)
    carried = model_files.carry(ModelSource("arm.mjb", file))
    assert list(carried.files) == ["arm.mjb"]


def test_a_file_that_other_machines_do_not_have_is_named(
    robot: ModelSource, tmp_path: Path
) -> None:
    mesh = tmp_path / "meshes/cube.obj"
    robot.path.write_text(WITH_MESH.format(file=mesh))
    with pytest.raises(InputError, match=r"arm\.xml refers to .*cube\.obj by an absolute path"):
        model_files.carry(robot)


def test_a_model_that_does_not_load_is_refused_before_anything_is_measured(
    robot: ModelSource, tmp_path: Path
) -> None:
    (tmp_path / "meshes/cube.obj").unlink()
    with pytest.raises(InputError, match=r"arm\.xml: MuJoCo cannot load it"):
        model_files.carry(robot)


def test_a_model_that_is_too_large_is_refused(
    robot: ModelSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_files, "MAX_BYTES", 10)
    with pytest.raises(InputError, match="more than the 0 MiB that are sent to nodes"):
        model_files.carry(robot)


def test_shipped_models_are_on_every_node() -> None:
    assert model_files.is_shipped(models.resolve("pile"))
    assert not model_files.is_shipped(ModelSource("pile.xml", Path("/elsewhere/pile.xml")))
