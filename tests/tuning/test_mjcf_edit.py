"""Editing MJCF changes what MuJoCo reads of an attribute, and no other byte of the file."""

import re
from collections.abc import Mapping

import mujoco
import pytest
from example_edits import ALL, BODIES, CG, EXCLUDE, FUSE, NO_ISLAND, STEP, checked_edit, disables
from hypothesis import given
from hypothesis import strategies as st

from mjbench.errors import InputError
from mjbench.tuning.mjcf_edit import edited
from mjbench.tuning.settings import Edit, Part


def _model(text: str, files: Mapping[str, str] | None = None) -> mujoco.MjModel:
    assets = {name: content.encode() for name, content in (files or {}).items()}
    return mujoco.MjModel.from_xml_string(text, assets)


# -- where an attribute goes ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "edit", "expected"),
    [
        ("<mujoco><option/></mujoco>", CG, '<mujoco><option solver="CG"/></mujoco>'),
        (
            '<mujoco>\n  <option timestep="0.1"\n          solver = "PGS" />\n</mujoco>\n',
            CG,
            '<mujoco>\n  <option timestep="0.1"\n          solver = "CG" />\n</mujoco>\n',
        ),
        (
            "<mujoco><option solver='PGS' cone='elliptic'></option></mujoco>",
            CG,
            "<mujoco><option solver='CG' cone='elliptic'></option></mujoco>",
        ),
        (
            "<mujoco><option cone='elliptic' /></mujoco>",
            CG,
            "<mujoco><option cone='elliptic' solver='CG' /></mujoco>",
        ),
        (
            '<mujoco>\n  <option solver="CG"/>\n</mujoco>',
            NO_ISLAND,
            '<mujoco>\n  <option solver="CG">\n    <flag island="disable"/>\n  </option>\n'
            "</mujoco>",
        ),
        (
            "<mujoco>\n\t<option>\n\t\t<!-- none -->\n\t</option>\n</mujoco>",
            NO_ISLAND,
            '<mujoco>\n\t<option>\n\t\t<!-- none -->\n\t\t<flag island="disable"/>\n\t</option>\n'
            "</mujoco>",
        ),
        (
            '<mujoco><option><flag energy="enable"/></option></mujoco>',
            NO_ISLAND,
            '<mujoco><option><flag energy="enable" island="disable"/></option></mujoco>',
        ),
        (
            '<mujoco>\n    <compiler angle="radian"/>\n\n</mujoco>',
            CG,
            '<mujoco>\n    <compiler angle="radian"/>\n    <option solver="CG"/>\n\n</mujoco>',
        ),
        ("<mujoco/>", FUSE, '<mujoco><compiler fusestatic="true"/></mujoco>'),
        (
            "<mujoco/>\n",
            NO_ISLAND,
            '<mujoco>\n  <option>\n    <flag island="disable"/>\n  </option>\n</mujoco>\n',
        ),
        (
            "<mujoco>\n  <contact/>\n</mujoco>",
            EXCLUDE,
            '<mujoco>\n  <contact>\n    <exclude body1="a" body2="b"/>\n  </contact>\n</mujoco>',
        ),
        (
            "<mujoco>\n<size/>\n</mujoco>",
            NO_ISLAND,
            '<mujoco>\n<size/>\n<option>\n  <flag island="disable"/>\n</option>\n</mujoco>',
        ),
    ],
)
def test_an_attribute_is_changed_or_added_as_the_file_is_laid_out(
    text: str, edit: Edit, expected: str
) -> None:
    assert checked_edit(text, edit) == expected


def test_the_section_that_sets_an_attribute_last_is_changed() -> None:
    text = f"""<mujoco>
  <option solver="PGS" timestep="0.001"/>
  {BODIES}
  <option solver="Newton"/>
</mujoco>"""
    changed = checked_edit(text, CG, STEP)
    assert changed == text.replace("Newton", "CG").replace("0.001", "0.003")
    model = _model(changed)
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.timestep == 0.003


def test_a_new_attribute_goes_to_the_last_section() -> None:
    text = f'<mujoco><option timestep="0.001"/>{BODIES}<option cone="elliptic"/></mujoco>'
    assert checked_edit(text, CG) == text.replace('"elliptic"', '"elliptic" solver="CG"')


@pytest.mark.parametrize("first", [True, False])
def test_a_flag_goes_to_the_flags_that_there_are(first: bool) -> None:
    flags = '<option><flag gravity="disable"/></option>'
    sections = [flags, '<option timestep="0.001"/>']
    text = f"<mujoco>{''.join(sections if first else sections[::-1])}{BODIES}</mujoco>"
    changed = checked_edit(text, NO_ISLAND)
    assert changed == text.replace('"disable"', '"disable" island="disable"')
    assert disables(_model(changed), "island")
    assert disables(_model(changed), "gravity")


def test_a_flag_that_two_sections_set_is_changed_in_the_last() -> None:
    island = '<option><flag island="enable"/></option>'
    text = f"<mujoco>{island}{BODIES}{island}</mujoco>"
    changed = checked_edit(text, NO_ISLAND)
    assert changed == f"<mujoco>{island}{BODIES}{island.replace('enable', 'disable')}</mujoco>"
    assert disables(_model(changed), "island")


def test_edits_of_one_section_share_it() -> None:
    changed = checked_edit(f"<mujoco>\n  {BODIES}\n</mujoco>\n", *ALL)
    assert (
        changed
        == f"""<mujoco>
  {BODIES}
  <option solver="CG" timestep="0.003">
    <flag island="disable" energy="enable"/>
  </option>
  <compiler fusestatic="true"/>
  <contact>
    <exclude body1="a" body2="b"/>
  </contact>
</mujoco>
"""
    )
    assert _model(changed).nexclude == 1


def test_a_later_edit_of_an_attribute_replaces_an_earlier_one() -> None:
    text = '<mujoco><option solver="Newton"/></mujoco>'
    pgs = Edit(Part.OPTION, "solver", "PGS")
    assert checked_edit(text, CG, pgs) == text.replace("Newton", "PGS")


def test_a_value_that_is_there_already_changes_nothing() -> None:
    text = "<mujoco><option solver = 'C&#71;'><flag island='disable'/></option></mujoco>"
    assert checked_edit(text, CG, NO_ISLAND) == text


# -- includes -----------------------------------------------------------------------------------

INCLUDED = {
    "options.xml": '<mujoco><option solver="PGS" timestep="0.5"><flag island="enable"/></option>'
    '<compiler fusestatic="false"/></mujoco>'
}


def test_an_include_before_the_section_leaves_it_last() -> None:
    text = f"""<mujoco>
  <include file="options.xml"/>
  <option solver="Newton"/>
  {BODIES}
</mujoco>"""
    changed = checked_edit(text, CG)
    assert changed == text.replace("Newton", "CG")
    assert _model(changed, INCLUDED).opt.solver == mujoco.mjtSolver.mjSOL_CG


@pytest.mark.parametrize("value", ["Newton", "CG"])
def test_an_include_behind_the_section_is_overridden_at_the_end(value: str) -> None:
    text = f"""<mujoco>
  <option solver="{value}" timestep="0.001"><flag island="enable"/></option>
  <include file="options.xml"/>
  {BODIES}
</mujoco>"""
    changed = checked_edit(text, CG, STEP, NO_ISLAND)
    new = """
  <option solver="CG" timestep="0.003">
    <flag island="disable"/>
  </option>"""
    assert changed == text.replace("\n</mujoco>", f"{new}\n</mujoco>")
    model = _model(changed, INCLUDED)
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG
    assert model.opt.timestep == 0.003
    assert disables(model, "island")


def test_a_section_behind_an_include_gets_what_one_before_it_sets() -> None:
    text = f"""<mujoco>
  <option solver="Newton"/>
  <include file="options.xml"/>
  <option cone="elliptic"/>
  {BODIES}
</mujoco>"""
    changed = checked_edit(text, CG)
    assert changed == text.replace('"elliptic"', '"elliptic" solver="CG"')
    assert _model(changed, INCLUDED).opt.solver == mujoco.mjtSolver.mjSOL_CG


def test_an_option_that_includes_flags_gets_none_of_its_own() -> None:
    """MuJoCo 4.0 reads no flag of such a file, but counts it: two are one too many."""
    text = f'<mujoco><option><include file="flags.xml"/></option>{BODIES}</mujoco>'
    changed = checked_edit(text, NO_ISLAND, CG)
    new = '<option><flag island="disable"/></option>'
    expected = text.replace("<option>", '<option solver="CG">', 1)
    assert changed == expected.replace("</mujoco>", f"{new}</mujoco>")
    model = _model(changed, {"flags.xml": '<mujoco><flag island="enable"/></mujoco>'})
    assert disables(model, "island")
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_CG


def test_an_include_inside_a_body_hides_nothing() -> None:
    text = '<mujoco><option solver="PGS"/><worldbody><include file="x"/></worldbody></mujoco>'
    assert checked_edit(text, CG) == text.replace("PGS", "CG")


# -- what only looks like a section -------------------------------------------------------------


@pytest.mark.parametrize(
    "decoy",
    [
        '<!-- <option solver="PGS"/> -- <contact/> -->',
        '<![CDATA[<option solver="PGS"/><contact></contact></mujoco>]]>',
        '<default><default class="x"><geom size="1"/></default><option solver="PGS"/></default>',
        '<deformable><flexcomp><contact selfcollide="none"/></flexcomp></deformable>',
        '<custom><text name="t" data="&lt;option solver=&quot;PGS&quot;/>"/></custom>',
        "<custom><text name='t' data='> /> \"'/></custom>",
    ],
)
def test_sections_within_other_elements_comments_and_text_stay(decoy: str) -> None:
    text = f"<mujoco>\n  {decoy}\n</mujoco>"
    changed = checked_edit(text, CG, EXCLUDE)
    new = """
  <option solver="CG"/>
  <contact>
    <exclude body1="a" body2="b"/>
  </contact>"""
    assert changed == text.replace("\n</mujoco>", f"{new}\n</mujoco>")


def test_a_value_may_hold_what_ends_a_tag() -> None:
    text = "<mujoco><option a='/>' b=\"&gt;'>\" solver='&gt;'/></mujoco>"
    assert checked_edit(text, CG) == text.replace("solver='&gt;'", "solver='CG'")


def test_comments_may_hold_what_xml_forbids_and_mujoco_reads() -> None:
    text = f"<mujoco>\n  <!-- -- 90\xb0 -- --->\n  <option/>{BODIES}</mujoco>".encode("latin-1")
    changed = edited(text, [CG])
    assert changed == text.replace(b"<option/>", b'<option solver="CG"/>')


# -- excluded pairs -----------------------------------------------------------------------------


def test_a_pair_is_excluded_once_in_either_order() -> None:
    text = f"""<mujoco>{BODIES}
  <contact><exclude body2="a" body1="b"/></contact>
  <contact>
    <pair geom1="x" geom2="y"/>
  </contact>
</mujoco>"""
    one, other = Edit(Part.EXCLUDE, "a", "c"), Edit(Part.EXCLUDE, "c", "a")
    changed = checked_edit(text, EXCLUDE, one, other)
    new = '\n    <exclude body1="a" body2="c"/>'
    assert changed == text.replace('"y"/>', f'"y"/>{new}')


@given(st.text(st.characters(codec="utf-8", min_codepoint=32), min_size=1, max_size=9))
def test_names_of_bodies_are_escaped(name: str) -> None:
    edit = Edit(Part.EXCLUDE, name, "b")
    if re.search("[\ufffe\uffff]", name):
        with pytest.raises(InputError, match="XML cannot hold"):
            edited(b"<mujoco/>", [edit])
        return
    changed = checked_edit(f"<mujoco>{BODIES}</mujoco>", edit)
    (exclude,) = mujoco.MjSpec.from_string(changed).excludes
    assert (exclude.bodyname1, exclude.bodyname2) == (name, "b")


def test_a_name_that_no_xml_holds_is_refused() -> None:
    with pytest.raises(InputError, match="a character that XML cannot hold"):
        edited(b"<mujoco/>", [Edit(Part.EXCLUDE, "a\x01", "b")])


# -- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'<robot name="r"/>', "it is URDF.*convert it to MJCF"),
        (b"<mujocoinclude/>", "tune the model that includes it"),
        (b"<svg/>", "its root is <svg>, not <mujoco>"),
        (b"<mujoco><option></mujoco>", "not well-formed XML: mismatched tag: line 1"),
        (b"", "not well-formed XML: no element"),
        (b"solver: CG", "not well-formed"),
        (b"<mujoco \xff/>", "not well-formed"),
        (b"<mujoco/><mujoco/>", "not well-formed XML: junk after document element"),
        (b"\x31\xd4\0\0\x08\0\0\0binary", "it is binary, not XML"),
        ("<mujoco/>".encode("utf-16"), "it is encoded in UTF-16, which MuJoCo does not read: save"),
        (b'<!DOCTYPE mujoco SYSTEM "x.dtd"><mujoco/>', "its DOCTYPE names another file"),
        (b'<!DOCTYPE m [<!ENTITY e SYSTEM "x">]><m>&e;</m>', "its entity e is in another file"),
        (b'<!DOCTYPE m [<!ENTITY % e SYSTEM "x">]><m/>', "its entity e is in another file"),
        (
            b'<!DOCTYPE mujoco [<!ENTITY e "<option/>">]><mujoco>&e;</mujoco>',
            "its <option> comes from an entity",
        ),
    ],
)
def test_what_is_no_model_of_its_own_is_refused_in_one_line(text: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        edited(text, [CG])
    assert "\n" not in str(raised.value)


def test_entities_that_expand_without_end_are_refused() -> None:
    nested = "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 20}">' for n in range(1, 12))
    text = f'<!DOCTYPE m [<!ENTITY e0 "lol">{nested}]><mujoco>&e11;</mujoco>'
    with pytest.raises(InputError, match="not well-formed XML"):
        edited(text.encode(), [CG])
