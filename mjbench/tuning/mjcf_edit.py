"""Edit MJCF in place: attributes change, and every other byte of the file stays.

MuJoCo merges repeated sections attribute by attribute, and the last one wins. An included file
counts where its `<include>` is. So an attribute changes where the file sets it last; if an
`<include>` follows, or no section fits, it goes to a new section at the end of the file.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from mjbench.errors import InputError, one_line
from mjbench.tuning import mjcf_sections
from mjbench.tuning.mjcf_sections import Document, Element
from mjbench.tuning.settings import Edit, Part

_INDENTATION = "  "  # of a file that shows none
# Characters that no XML holds, even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ESCAPES = {
    "&": "&amp;",
    "<": "&lt;",
    ">": "&gt;",
    "\t": "&#9;",
    "\n": "&#10;",
    "\r": "&#13;",
}
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
    changes = _Changes(document)
    for edit in edits:
        changes.add(edit)
    return changes.text()


def _check_root(root: Element) -> None:
    """Refuse what is no MJCF of its own."""
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


@dataclass
class _New:
    """An element to add."""

    name: str
    attributes: dict[str, str] = field(default_factory=dict)
    children: list["_New"] = field(default_factory=list)


@dataclass
class _Changed:
    """An element of the file, the attributes to set, and the children to add."""

    element: Element
    attributes: dict[str, str] = field(default_factory=dict)
    children: list[_New] = field(default_factory=list)


@dataclass(frozen=True, order=True)
class _Splice:
    """Text for the bytes from `start` to `end`, without `end`."""

    start: int
    end: int
    text: str


class _Changes:
    """Changes of a file, collected edit by edit, and then spliced into its bytes at once."""

    def __init__(self, document: Document):
        self._document = document
        self._changed: dict[int, _Changed] = {}
        self._unit = _unit(document)
        self._contacts = document.root.named("contact")
        self._excluded = {
            frozenset(_bodies(exclude))
            for contact in self._contacts
            for exclude in contact.named("exclude")
        }

    def add(self, edit: Edit) -> None:
        """Add an edit."""
        if edit.part == Part.EXCLUDE:
            self._exclude(edit.name, edit.value)
        elif edit.part == Part.FLAG:
            self._set_flag(edit.name, edit.value)
        else:
            self._set_attribute(edit.part.value, edit.name, edit.value)

    def text(self) -> bytes:
        """Return the bytes of the file with all changes."""
        splices: list[_Splice] = []
        for changed in self._changed.values():
            splices += self._attribute_splices(changed)
            if changed.children:
                splices.append(self._children_splice(changed))
        document, parts, position = self._document, [], 0
        for splice in sorted(splices):
            parts += [
                document.text[position : splice.start],
                splice.text.encode(document.codec, "xmlcharrefreplace"),
            ]
            position = splice.end
        return b"".join([*parts, document.text[position:]])

    # -- where an edit goes -----------------------------------------------------------------------

    def _set_attribute(self, section: str, name: str, value: str) -> None:
        root = self._document.root
        element = _owner(_after_last(root.children, section, root.named("include")), name)
        if element:
            self._of(element).attributes[name] = value
        else:
            _child(self._of(root), section).attributes[name] = value

    def _set_flag(self, name: str, value: str) -> None:
        root = self._document.root
        # a file that an <option> includes may hold its <flag>, and no <option> has two
        includes = [option for option in root.named("option") if option.named("include")]
        options = _after_last(root.children, "option", [*root.named("include"), *includes])
        flag = _owner([flag for option in options for flag in option.named("flag")], name)
        if flag:
            self._of(flag).attributes[name] = value
        else:
            option = self._of(options[-1]) if options else _child(self._of(root), "option")
            _child(option, "flag").attributes[name] = value

    def _exclude(self, body1: str, body2: str) -> None:
        pair = frozenset((body1, body2))
        if pair in self._excluded:
            return
        self._excluded.add(pair)
        if self._contacts:
            contact: _Changed | _New = self._of(self._contacts[-1])
        else:
            contact = _child(self._of(self._document.root), "contact")
        contact.children.append(_New("exclude", {"body1": body1, "body2": body2}))

    def _of(self, element: Element) -> _Changed:
        """Return the changes of an element."""
        return self._changed.setdefault(element.start, _Changed(element))

    # -- splices ----------------------------------------------------------------------------------

    def _attribute_splices(self, changed: _Changed) -> list[_Splice]:
        """Return the splices that set an element's attributes; none for those that are set."""
        tag = self._document.tag(changed.element)
        splices, added = [], ""
        for name, value in changed.attributes.items():
            present = tag.values.get(name)
            if present is None:
                added += f" {name}={tag.quote}{_escaped(value, tag.quote)}{tag.quote}"
            elif changed.element.attributes[name] != value:
                text = _escaped(value, present.quote)
                splices.append(_Splice(present.start, present.end, text))
        return [*splices, _Splice(tag.last, tag.last, added)] if added else splices

    def _children_splice(self, changed: _Changed) -> _Splice:
        """Return the splice that adds an element's children, behind those that it has."""
        document, element = self._document, changed.element
        tag = document.tag(element)
        own = document.indentation(element.start)
        if tag.is_empty:
            newline = "" if own is None else document.newline
            inside = "".join(
                _markup(child, (own or "") + self._unit, self._unit, newline)
                for child in changed.children
            )
            end = f"{newline}{own or ''}" if newline else ""
            slash = tag.end - len("/>".encode(document.codec))
            return _Splice(slash, tag.end, f">{inside}{end}</{element.name}>")
        newline = document.line_end_before(element.end)
        position = document.behind_last(element.end, " \t\r\n") if newline else element.end
        indentation = self._indentation_inside(element)
        text = "".join(
            _markup(child, indentation, self._unit, newline) for child in changed.children
        )
        return _Splice(position, position, text)

    def _indentation_inside(self, element: Element) -> str:
        """Return the indentation of an element's children."""
        for child in reversed(element.children):
            indentation = self._document.indentation(child.start)
            if indentation is not None:
                return indentation
        return (self._document.indentation(element.start) or "") + self._unit


def _unit(document: Document) -> str:
    """Return by how much the sections of a file are indented."""
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


def _child(parent: _Changed | _New, name: str) -> _New:
    """Return the element of a name to add to `parent`; there is one of each name."""
    for child in parent.children:
        if child.name == name:
            return child
    parent.children.append(_New(name))
    return parent.children[-1]


def _bodies(exclude: Element) -> tuple[str, str]:
    """Return the names of the two bodies of an `<exclude>`."""
    return exclude.attributes.get("body1", ""), exclude.attributes.get("body2", "")


def _markup(new: _New, indentation: str, unit: str, newline: str) -> str:
    """Return an element on lines of its own; on the line where it stands if `newline` is empty."""
    before = f"{newline}{indentation}" if newline else ""
    attributes = "".join(f' {name}="{_escaped(v, chr(34))}"' for name, v in new.attributes.items())
    if not new.children:
        return f"{before}<{new.name}{attributes}/>"
    inside = "".join(_markup(child, indentation + unit, unit, newline) for child in new.children)
    return f"{before}<{new.name}{attributes}>{inside}{before}</{new.name}>"


def _escaped(value: str, quote: str) -> str:
    """Return an attribute's value as XML holds it between two quotes."""
    if _FORBIDDEN.search(value):
        raise InputError(f"{one_line(repr(value), 60)} has a character that XML cannot hold")
    escapes = {**_ESCAPES, quote: _QUOTE_ESCAPES[quote]}
    return "".join(escapes.get(character, character) for character in value)
