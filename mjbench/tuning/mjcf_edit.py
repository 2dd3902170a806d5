"""Edit MJCF in place: attributes change, and every other byte of the file stays.

MuJoCo merges repeated sections attribute by attribute, and the last one wins. An included file
counts where its `<include>` is. So an attribute changes where the file sets it last; if an
`<include>` follows, or no section fits, it goes to a new section at the end of the file.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.sax import saxutils

from mjbench.errors import InputError, one_line
from mjbench.tuning import mjcf_sections
from mjbench.tuning.mjcf_sections import Document, Element
from mjbench.tuning.settings import Edit, Part

_INDENTATION = "  "  # of a file that shows none
# Characters that no XML holds, even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ESCAPES = {"\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
_QUOTE_ESCAPES = {'"': "&quot;", "'": "&apos;"}


def edited(text: bytes, edits: Sequence[Edit]) -> bytes:
    """Return the bytes of an MJCF file with edits applied; applied again, they change nothing.

    A later edit of the same attribute replaces an earlier one. A pair of bodies that the file
    excludes already, in either order, is not excluded again.

    Raises:
      InputError: the file is no MJCF of its own, or no well-formed XML.
    """
    document = mjcf_sections.parse(text)
    _check_root(document.root)
    for edit in sorted(edits, key=lambda edit: edit.part == Part.FLAG):  # see `_with_flag`
        if edit.part == Part.FLAG:
            document = _with_flag(document, edit.name, edit.value)
        elif edit.part != Part.EXCLUDE:
            document = _with_setting(document, edit.part.value, edit.name, edit.value)
    pairs = [(edit.name, edit.value) for edit in edits if edit.part == Part.EXCLUDE]
    return _excluding(document, pairs).text


def _check_root(root: Element) -> None:
    if root.name == "mujoco":
        return
    if root.name == "robot":
        raise InputError(
            "it is URDF, which cannot hold these settings: convert it to MJCF"
            " (mujoco.MjSpec.from_file(…).to_file(…)) and tune that"
        )
    if root.name == "mujocoinclude":
        raise InputError(
            "it is a part of a model (<mujocoinclude>): tune the model that includes it"
        )
    raise InputError(f"it is no MJCF: its root is <{one_line(root.name, 40)}>, not <mujoco>")


@dataclass(frozen=True)
class _New:
    name: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    children: Sequence["_New"] = ()


# -- where an edit goes ---------------------------------------------------------------------------


def _with_setting(document: Document, section: str, name: str, value: str) -> Document:
    root = document.root
    element = _owner(_after_last(root.children, section, root.named("include")), name)
    if element:
        return _with_attribute(document, element, name, value)
    return _with_children(document, root, [_New(section, {name: value})])


def _with_flag(document: Document, name: str, value: str) -> Document:
    """Return the file with a flag; where it needs an `<option>` of its own, that is the last."""
    root = document.root
    # a file that an <option> includes may hold its <flag>, and no <option> has two
    includes = [option for option in root.named("option") if option.named("include")]
    options = _after_last(root.children, "option", [*root.named("include"), *includes])
    flag = _owner([flag for option in options for flag in option.named("flag")], name)
    if flag:
        return _with_attribute(document, flag, name, value)
    new = _New("flag", {name: value})
    if options:
        return _with_children(document, options[-1], [new])
    return _with_children(document, root, [_New("option", children=[new])])


def _excluding(document: Document, pairs: Sequence[tuple[str, str]]) -> Document:
    contacts = document.root.named("contact")
    excludes = [exclude.attributes for contact in contacts for exclude in contact.named("exclude")]
    excluded = {frozenset((each.get("body1", ""), each.get("body2", ""))) for each in excludes}
    new = []
    for body1, body2 in pairs:
        if frozenset((body1, body2)) not in excluded:
            excluded.add(frozenset((body1, body2)))
            new.append(_New("exclude", {"body1": body1, "body2": body2}))
    if not new:
        return document
    if contacts:
        return _with_children(document, contacts[-1], new)
    return _with_children(document, document.root, [_New("contact", children=new)])


# -- the text of an edit --------------------------------------------------------------------------


def _with_attribute(document: Document, element: Element, name: str, value: str) -> Document:
    tag = document.tag(element)
    present = tag.values.get(name)
    if present is None:
        attribute = f" {name}={tag.quote}{_escaped(value, tag.quote)}{tag.quote}"
        return document.spliced(tag.last, tag.last, attribute)
    if element.attributes[name] == value:
        return document
    return document.spliced(present.start, present.end, _escaped(value, present.quote))


def _with_children(document: Document, element: Element, children: Sequence[_New]) -> Document:
    unit, tag = _unit(document), document.tag(element)
    own = document.indentation(element.start)
    if tag.is_empty:
        newline = "" if own is None else document.newline
        inside = _markup(children, (own or "") + unit, unit, newline)
        end = f"{newline}{own or ''}" if newline else ""
        slash = tag.end - len("/>")
        return document.spliced(slash, tag.end, f">{inside}{end}</{element.name}>")
    newline = document.line_end_before(element.end)
    position = document.behind_last(element.end, b" \t\r\n") if newline else element.end
    indentations = (document.indentation(child.start) for child in reversed(element.children))
    inner = next((each for each in indentations if each is not None), (own or "") + unit)
    return document.spliced(position, position, _markup(children, inner, unit, newline))


def _unit(document: Document) -> str:
    outer = document.indentation(document.root.start) or ""
    for section in document.root.children:
        inner = document.indentation(section.start)
        if inner and inner.startswith(outer) and inner != outer:
            return inner.removeprefix(outer)
    return _INDENTATION


def _after_last(
    children: Sequence[Element], section: str, includes: Sequence[Element]
) -> list[Element]:
    """Return the sections of a name behind all of some elements, whose content is unknown."""
    last = max((element.start for element in includes), default=-1)
    return [child for child in children if child.name == section and child.start > last]


def _owner(elements: Sequence[Element], name: str) -> Element | None:
    """Return the last element with an attribute, or else the last of all; None if there is none."""
    holders = [element for element in elements if name in element.attributes]
    return next(reversed(holders or elements), None)


def _markup(elements: Sequence[_New], indentation: str, unit: str, newline: str) -> str:
    """Return elements on lines of their own; on one line if `newline` is empty."""
    before = f"{newline}{indentation}" if newline else ""
    text = ""
    for new in elements:
        text += f"{before}<{new.name}"
        for name, value in new.attributes.items():
            text += f' {name}="{_escaped(value, chr(34))}"'
        inside = _markup(new.children, indentation + unit, unit, newline)
        text += f">{inside}{before}</{new.name}>" if inside else "/>"
    return text


def _escaped(value: str, quote: str) -> str:
    if _FORBIDDEN.search(value):
        raise InputError(f"{one_line(repr(value), 60)} has a character that XML cannot hold")
    return saxutils.escape(value, {**_ESCAPES, quote: _QUOTE_ESCAPES[quote]})
