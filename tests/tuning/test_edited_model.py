"""A model with settings: the same one in memory and in the copy, which appears whole or not."""

import os
import warnings
from pathlib import Path

import mujoco
import pytest
from example_models import CONTACT_XML

from mjbench.errors import InputError, MachineError
from mjbench.simulation import models
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.models import ModelSource
from mjbench.tuning import edited_model
from mjbench.tuning.settings import Edit, Part

CG = Edit(Part.OPTION, "solver", "CG")
NO_ISLAND = Edit(Part.FLAG, "island", "disable")
SLEEP = Edit(Part.FLAG, "sleep", "enable")
FUSE = Edit(Part.COMPILER, "fusestatic", "true")
MASS = Edit(Part.COMPILER, "boundmass", "700")
EDITS = (
    *(CG, NO_ISLAND, SLEEP, FUSE, MASS),
    Edit(Part.OPTION, "integrator", "implicitfast"),
    Edit(Part.OPTION, "cone", "elliptic"),
    Edit(Part.OPTION, "jacobian", "sparse"),
    Edit(Part.OPTION, "iterations", "3"),
    Edit(Part.OPTION, "tolerance", "1e-4"),
    Edit(Part.FLAG, "multiccd", "disable"),
    Edit(Part.FLAG, "energy", "enable"),
    Edit(Part.COMPILER, "discardvisual", "true"),
)


def _named(model: mujoco.MjModel, body: int) -> str:
    return str(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or "")


def _pair(model: mujoco.MjModel) -> Edit:
    """Return the exclusion of a pair of bodies that the model does not exclude yet."""
    taken = {*model.exclude_signature.tolist()}
    first, second = next(
        (one, other)
        for one in range(1, model.nbody)
        for other in range(one + 1, model.nbody)
        if (one << 16) + other not in taken and _named(model, one) and _named(model, other)
    )
    return Edit(Part.EXCLUDE, _named(model, second), _named(model, first))


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


# -- in memory ----------------------------------------------------------------------------------


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


def test_an_edit_of_the_compiler_changes_what_is_compiled(source: ModelSource) -> None:
    assert edited_model.compiled(source, [MASS]).body_mass[1] == 700


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
    with pytest.raises(InputError, match=r"arm\.urdf: it is URDF"):
        edited_model.write(urdf, [CG], tmp_path / "tuned.xml")
    assert [*_files(tmp_path)] == ["arm.urdf"]


def test_a_compiled_file_can_have_options_alone(source: ModelSource, tmp_path: Path) -> None:
    path = tmp_path / "robot.mjb"
    mujoco.mj_saveModel(models.load(source), str(path))
    saved = ModelSource("robot.mjb", path)
    expected = ModelGuard(edited_model.compiled(source, [CG, NO_ISLAND]))
    assert expected.difference(edited_model.compiled(saved, [CG, NO_ISLAND])) is None
    with pytest.raises(InputError, match=r"robot\.mjb with compiler fusestatic=true: it is comp"):
        edited_model.compiled(saved, [CG, FUSE])
    with pytest.raises(InputError, match="give the MJCF file that it comes from"):
        edited_model.write(saved, [CG], tmp_path / "tuned.xml")
    assert not (tmp_path / "tuned.xml").exists()


def test_a_release_without_mjspec_can_have_options_alone(
    source: ModelSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = ModelGuard(edited_model.compiled(source, [CG, NO_ISLAND]))
    monkeypatch.delattr(mujoco, "MjSpec")
    assert expected.difference(edited_model.compiled(source, [CG, NO_ISLAND])) is None
    with pytest.raises(InputError, match=r"robot\.xml with exclude a c: needs MjSpec"):
        edited_model.compiled(source, [Edit(Part.EXCLUDE, "a", "c")])
    edited_model.write(source, [CG], source.path.with_name("tuned.xml"))
    assert 'solver="CG"' in source.path.with_name("tuned.xml").read_text()


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
        (Edit(Part.COMPILER, "speed", "1"), "compiler speed=1: MuJoCo .* has no such attribute"),
        (Edit(Part.COMPILER, "meshdir", "x"), "compiler meshdir=x: MuJoCo .* no such attribute"),
        (Edit(Part.COMPILER, "fusestatic", "1"), "fusestatic=1: its value is true or false"),
        (Edit(Part.COMPILER, "boundmass", "x"), "boundmass=x: its value is a number"),
        (Edit(Part.EXCLUDE, "a", "nobody"), "with exclude a nobody: MuJoCo cannot compile it"),
        (Edit(Part.FLAG, "ipc", "enable"), "with flag ipc=enable: MuJoCo cannot compile it"),
        (Edit(Part.COMPILER, "settotalmass", "3"), "settotalmass=3: MuJoCo warns: .* deprecated"),
    ],
)
def test_what_mujoco_rejects_is_one_line_that_names_the_setting(
    source: ModelSource, edit: Edit, message: str
) -> None:
    if edit.name in ("ipc", "settotalmass") and not hasattr(mujoco.mjtEnableBit, "mjENBL_IPC"):
        pytest.skip("only newer releases reject or warn of this")
    target = source.path.with_name("tuned.xml")
    for fails in (
        lambda: edited_model.compiled(source, [edit]),
        lambda: edited_model.write(source, [edit], target),
    ):
        with pytest.raises(InputError, match=message) as raised:
            fails()
        assert str(raised.value).startswith("robot.xml")
        assert "\n" not in str(raised.value)
    assert not target.exists()


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


# -- the copy -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", models.shipped())
def test_copies_of_shipped_models_compile_to_what_was_compiled_in_memory(
    name: str, tmp_path: Path
) -> None:
    shipped = models.resolve(name)
    target = tmp_path / "tuned.xml"
    plain = models.load(shipped)
    pairs = [] if name in ("cloth", "cube_table", "pile") else [_pair(plain)]
    for edits in ([], *([edit] for edit in EDITS), *([edit] for edit in pairs), [*EDITS, *pairs]):
        edited_model.write(shipped, edits, target)
        expected = ModelGuard(edited_model.compiled(shipped, edits))
        assert expected.difference(models.load(ModelSource(name, target))) is None
    assert [*_files(tmp_path)] == ["tuned.xml"]


def test_a_copy_beside_the_model_finds_its_meshes_and_includes(source: ModelSource) -> None:
    target = source.path.with_name("tuned.xml")
    edits = [CG, NO_ISLAND, FUSE, Edit(Part.EXCLUDE, "a", "b"), Edit(Part.EXCLUDE, "a", "c")]
    before = _files(source.path.parent)
    edited_model.write(source, edits, target)
    after = _files(source.path.parent)
    written = after.pop("tuned.xml").decode()
    assert after == before
    assert written.count("<exclude") == 1  # the included file has the other
    assert models.load(ModelSource("tuned", target)).nexclude == 2
    edited_model.write(ModelSource("tuned", target), edits, source.path.with_name("again.xml"))
    assert source.path.with_name("again.xml").read_text() == written


def test_a_copy_without_its_meshes_is_not_written(source: ModelSource, tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    target = folder / "tuned.xml"
    message = r"tuned\.xml is not written: there, MuJoCo cannot load it: .*; write it to .*robot"
    with pytest.raises(InputError, match=message) as raised:
        edited_model.write(source, [CG], target)
    assert "\n" not in str(raised.value)
    assert _files(folder) == {}
    target.write_text("earlier")
    with pytest.raises(InputError, match="is not written"):
        edited_model.write(source, [CG], target)
    assert _files(folder) == {"tuned.xml": b"earlier"}


@pytest.mark.parametrize(
    ("file", "old", "new", "field"),
    [
        ("cube.obj", "v 1 0 0", "v 2 0 0", "body_"),
        ("pairs.xml", 'body2="b"', 'body2="c"', "exclude_signature"),
        ("pairs.xml", "<contact>", '<option timestep="1"/><contact>', "opt.timestep"),
    ],
)
def test_a_copy_that_compiles_to_another_model_is_not_written(
    source: ModelSource, tmp_path: Path, file: str, old: str, new: str, field: str
) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    for name in ("cube.obj", "pairs.xml"):
        content = (source.path.parent / name).read_text()
        (folder / name).write_text(content.replace(old, new) if name == file else content)
    before = _files(folder)
    message = rf"is not written: there, its {field}\w* is not that of robot\.xml with solver=CG"
    with pytest.raises(InputError, match=message):
        edited_model.write(source, [CG], folder / "tuned.xml")
    assert _files(folder) == before


def test_a_copy_elsewhere_is_written_where_all_that_it_refers_to_is(
    source: ModelSource, tmp_path: Path
) -> None:
    folder = tmp_path / "a folder with a longer name"
    folder.mkdir()
    for name in ("cube.obj", "pairs.xml"):
        (folder / name).write_bytes((source.path.parent / name).read_bytes())
    edited_model.write(source, [CG], folder / "tuned.xml")
    model = models.load(ModelSource("tuned", folder / "tuned.xml"))
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG


def test_a_file_that_is_there_is_replaced_with_its_permissions(source: ModelSource) -> None:
    target = source.path.with_name("tuned.xml")
    target.write_text("earlier")
    target.chmod(0o640)
    edited_model.write(source, [CG], target)
    assert 'solver="CG"' in target.read_text()
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_link_stays_and_the_file_behind_it_is_written(source: ModelSource) -> None:
    folder = source.path.parent
    (folder / "behind.xml").write_text("earlier")
    (folder / "link.xml").symlink_to("behind.xml")
    edited_model.write(source, [CG], folder / "link.xml")
    assert (folder / "link.xml").is_symlink()
    assert 'solver="CG"' in (folder / "behind.xml").read_text()


def test_what_the_model_is_read_from_is_never_replaced(source: ModelSource) -> None:
    folder = source.path.parent
    (folder / "link.xml").symlink_to("robot.xml")
    os.link(folder / "pairs.xml", folder / "same.xml")
    before = _files(folder)
    for name in ("robot.xml", "link.xml", "pairs.xml", "same.xml"):
        with pytest.raises(InputError, match=r"is a file that robot\.xml is read from"):
            edited_model.write(source, [CG], folder / name)
    assert _files(folder) == before


def test_a_copy_has_the_name_of_an_mjcf_file(source: ModelSource, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the name of a copy ends in \.xml"):
        edited_model.write(source, [CG], tmp_path / "tuned.mjb")
    folder = tmp_path / "folder.xml"
    folder.mkdir()
    with pytest.raises(InputError, match="is not a regular file"):
        edited_model.write(source, [CG], folder)


def test_a_folder_that_does_not_exist_is_one_line(source: ModelSource, tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"cannot write .*No such file or directory"):
        edited_model.write(source, [CG], tmp_path / "none" / "tuned.xml")


def test_broken_xml_that_mujoco_reads_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "loose.xml"
    path.write_text(CONTACT_XML.replace("<mujoco>", '<mujoco model="a & b">'))
    loose = ModelSource("loose.xml", path)
    assert edited_model.compiled(loose, [CG]).nv > 0
    with pytest.raises(InputError, match=r"loose\.xml: it is not well-formed XML: .*line 2"):
        edited_model.write(loose, [CG], tmp_path / "tuned.xml")
    assert [*_files(tmp_path)] == ["loose.xml"]


def test_a_place_for_a_copy_is_refused_before_there_are_settings(
    source: ModelSource, tmp_path: Path
) -> None:
    before = _files(source.path.parent)
    included = next(path for path in source.path.parent.rglob("*.xml") if path != source.path)
    with pytest.raises(InputError, match="is read from"):
        edited_model.check_target(source, included)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with pytest.raises(InputError, match="beside what it refers to"):
        edited_model.check_target(source, elsewhere / "tuned.xml")
    edited_model.check_target(source, source.path.with_name("tuned.xml"))
    assert _files(source.path.parent) == before
    assert not any(elsewhere.iterdir())
