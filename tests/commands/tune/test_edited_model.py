"""A model with settings, compiled in memory."""

import warnings
from pathlib import Path

import mujoco
import pytest
from example_models import CONTACT_XML

from mjbench.commands.tune import edited_model
from mjbench.commands.tune.settings import Edit, Part
from mjbench.errors import InputError
from mjbench.simulation import models
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource

CG = Edit(Part.OPTION, "solver", "CG")
NO_ISLAND = Edit(Part.FLAG, "island", "disable")
SLEEP = Edit(Part.FLAG, "sleep", "enable")
FUSE = Edit(Part.COMPILER, "fusestatic", "true")
EDITS = (
    *(CG, NO_ISLAND, SLEEP, FUSE),
    Edit(Part.OPTION, "integrator", "implicitfast"),
    Edit(Part.OPTION, "cone", "elliptic"),
    Edit(Part.OPTION, "jacobian", "sparse"),
    Edit(Part.OPTION, "iterations", "3"),
    Edit(Part.OPTION, "tolerance", "1e-4"),
    Edit(Part.FLAG, "multiccd", "disable"),
    Edit(Part.FLAG, "energy", "enable"),
    Edit(Part.COMPILER, "discardvisual", "true"),
)


@pytest.fixture
def source(tmp_path: Path) -> ModelSource:
    """A model with two named bodies, a mesh beside it, and an included file."""
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "cube.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    (folder / "pairs.xml").write_text(
        '<mujoco><contact><exclude body1="a" body2="b"/></contact></mujoco>'
    )
    (folder / "robot.xml").write_text(
        """<mujoco>
  <asset><mesh file="cube.obj"/></asset>
  <worldbody>
    <body name="a"><freejoint/><geom type="mesh" mesh="cube"/></body>
    <body name="b" pos="0 0 3"><freejoint/><geom type="mesh" mesh="cube"/></body>
    <body name="c" pos="0 0 6"><freejoint/><geom type="mesh" mesh="cube"/></body>
  </worldbody>
  <include file="pairs.xml"/>
</mujoco>
"""
    )
    return ModelSource("robot.xml", folder / "robot.xml")


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_without_edits_it_is_the_model_itself(source: ModelSource) -> None:
    assert ModelGuard(models.load(source)).difference(edited_model.compiled(source, [])) is None


def test_options_flags_and_exclusions_are_applied(source: ModelSource) -> None:
    plain = models.load(source)
    model = edited_model.compiled(source, [CG, NO_ISLAND, SLEEP, Edit(Part.EXCLUDE, "c", "a")])
    assert plain.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.disableflags == int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    assert model.opt.enableflags == int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    assert (plain.nexclude, model.nexclude) == (1, 2)
    assert (1 << 16) + 3 in model.exclude_signature


def test_flags_that_a_model_sets_are_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "flags.xml"
    flags = '<option><flag island="disable" energy="enable"/></option>'
    path.write_text(CONTACT_XML.replace("<mujoco>", f"<mujoco>{flags}"))
    back = [Edit(Part.FLAG, "island", "enable"), Edit(Part.FLAG, "energy", "disable")]
    model = edited_model.compiled(ModelSource("flags", path), back)
    assert (model.opt.disableflags, model.opt.enableflags) == (0, 0)


def test_a_pair_that_an_included_file_excludes_is_not_excluded_again(source: ModelSource) -> None:
    pairs = [Edit(Part.EXCLUDE, one, other) for one, other in ("ba", "ac", "ca")]
    assert edited_model.compiled(source, pairs).nexclude == 2


def test_compiling_leaves_the_folder_as_it_is(source: ModelSource) -> None:
    before = _files(source.path.parent)
    edited_model.compiled(source, EDITS)
    assert _files(source.path.parent) == before


def test_urdf_can_have_settings_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(
        """<robot name="arm"><link name="base"/><link name="tip"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="continuous"><parent link="base"/><child link="tip"/>
        <axis xyz="0 0 1"/></joint></robot>"""
    )
    urdf = ModelSource("arm.urdf", path)
    assert edited_model.compiled(urdf, [CG]).opt.solver == mujoco.mjtSolver.mjSOL_CG


def test_a_compiled_file_can_have_options_alone(source: ModelSource, tmp_path: Path) -> None:
    path = tmp_path / "robot.mjb"
    mujoco.mj_saveModel(models.load(source), str(path))
    saved = ModelSource("robot.mjb", path)
    expected = ModelGuard(edited_model.compiled(source, [CG, NO_ISLAND]))
    assert expected.difference(edited_model.compiled(saved, [CG, NO_ISLAND])) is None
    with pytest.raises(InputError, match=r"robot\.mjb with compiler fusestatic=true: it is comp"):
        edited_model.compiled(saved, [CG, FUSE])


def test_a_release_without_mjspec_can_have_options_alone(
    source: ModelSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = ModelGuard(edited_model.compiled(source, [CG, NO_ISLAND]))
    monkeypatch.delattr(mujoco, "MjSpec")
    assert expected.difference(edited_model.compiled(source, [CG, NO_ISLAND])) is None
    with pytest.raises(InputError, match=r"robot\.xml with exclude a c: needs MjSpec"):
        edited_model.compiled(source, [Edit(Part.EXCLUDE, "a", "c")])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Edit(Part.OPTION, "solver", "quick"), r"option solver: 'quick' is not one of PGS"),
        (Edit(Part.OPTION, "solver", "1"), "option solver: in MJCF its value is a keyword, not 1"),
        (Edit(Part.OPTION, "timestep", "-1"), "option timestep: '-1' is not a number"),
        (Edit(Part.OPTION, "speed", "1"), "no option 'speed'"),
        (Edit(Part.OPTION, "disableflags", "1"), "flags are attributes of <flag>"),
        (Edit(Part.FLAG, "islands", "enable"), "flag islands: MuJoCo .* has no such flag"),
        (Edit(Part.FLAG, "island", "true"), "flag island: 'true' is not enable or disable"),
        (Edit(Part.COMPILER, "speed", "true"), "compiler speed=true: MuJoCo .* no such attribute"),
        (Edit(Part.EXCLUDE, "a", "nobody"), "with exclude a nobody: MuJoCo cannot compile it"),
        (Edit(Part.FLAG, "ipc", "enable"), "with flag ipc=enable: MuJoCo cannot compile it"),
        (Edit(Part.COMPILER, "settotalmass", "true"), "true: MuJoCo warns: .* deprecated"),
    ],
)
def test_what_mujoco_rejects_is_one_line_that_names_the_setting(
    source: ModelSource, edit: Edit, message: str
) -> None:
    if edit.name in ("ipc", "settotalmass") and not hasattr(mujoco.mjtEnableBit, "mjENBL_IPC"):
        pytest.skip("only newer releases reject or warn of this")
    with pytest.raises(InputError, match=message) as raised:
        edited_model.compiled(source, [edit])
    assert str(raised.value).startswith("robot.xml")
    assert "\n" not in str(raised.value)


def test_a_warning_that_the_model_has_without_settings_is_none_of_them(tmp_path: Path) -> None:
    path = tmp_path / "heavy.xml"
    path.write_text(CONTACT_XML.replace("<mujoco>", '<mujoco><compiler settotalmass="3"/>'))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = edited_model.compiled(ModelSource("heavy.xml", path), [CG])
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert not caught


def test_a_file_that_mujoco_rejects_blames_no_setting(tmp_path: Path) -> None:
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody/><nonsense/></mujoco>")
    with pytest.raises(InputError, match=r"^broken\.xml: MuJoCo cannot load it: .*nonsense"):
        edited_model.compiled(ModelSource("broken.xml", path), [CG])
