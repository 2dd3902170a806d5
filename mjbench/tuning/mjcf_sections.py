"""Where the sections of an MJCF file lie in its bytes, and how its lines are indented.

The standard library's expat says where elements start and end. MuJoCo reads more leniently: any
comment will do, and bytes that are no UTF-8; so they are hidden from expat. MuJoCo reads every file
as UTF-8, whatever encoding it declares, and so does this module.
"""

import codecs
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from mjbench.errors import InputError, one_line
from mjbench.simulation import models

# Sections whose children are recorded; of other sections, only where they are.
_SECTIONS = frozenset({"option", "compiler", "contact"})
# Elements whose attribute `file` names another file of MJCF.
_REFERRING = frozenset({"include", "model"})
_COMMENT = re.compile(rb"<!--.*?-->|<!\[CDATA\[.*?\]\]>", re.DOTALL)
_NOT_LINE_END = re.compile(rb"[^\r\n]")
_TAG = re.compile(rb"""(<[^\s/>]+)(?:[^"'>]|"[^"]*"|'[^']*')*>""")
_ATTRIBUTE = re.compile(rb"""([^\s=]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_LINE_END = re.compile(rb"\r\n|\n|\r")
# What stands for a byte that is no UTF-8 after decoding with `surrogateescape`.
_NO_TEXT = re.compile("[\udc80-\udcff]")


@dataclass
class Element:
    """An element of a file.

    Attributes:
      attributes: as XML defines their values: entities replaced, line ends as spaces.
      start: byte at which its start tag begins.
      end: byte at which its end tag begins; without a meaning where it has none.
      children: of the root all, of `<option>`, `<compiler>` and `<contact>` all, of others none.
    """

    name: str
    attributes: Mapping[str, str]
    start: int
    depth: int
    end: int = 0
    children: list["Element"] = field(default_factory=list)

    def named(self, name: str) -> list["Element"]:
        return [child for child in self.children if child.name == name]


@dataclass(frozen=True)
class Value:
    """Where the value of an attribute lies: its bytes between the quotes, and the quote."""

    start: int
    end: int
    quote: str


@dataclass(frozen=True)
class StartTag:
    """Where the parts of a start tag lie, in bytes of the file.

    Attributes:
      end: behind its `>`.
      last: behind its last attribute; behind its name where it has none.
      quote: of its last attribute; `"` where it has none.
    """

    end: int
    last: int
    values: Mapping[str, Value]
    quote: str
    is_empty: bool


@dataclass(frozen=True)
class Document:
    """A file of XML.

    Attributes:
      visible: as many bytes as the text, with spaces for what comments hold.
      files: values of `file` of its `<include>` and `<model>` elements.
    """

    text: bytes
    visible: bytes
    root: Element
    files: tuple[str, ...]

    @property
    def newline(self) -> str:
        return _first_newline(self.visible)

    def tag(self, element: Element) -> StartTag:
        tag = _TAG.match(self.visible, element.start)
        assert tag is not None  # expat has read it
        last, quote, values = tag.end(1), '"', {}
        for match in _ATTRIBUTE.finditer(self.visible, tag.end(1), tag.end()):
            start, end = match.span(2) if match[2] is not None else match.span(3)
            last, quote = match.end(), chr(self.visible[start - 1])
            values[match[1].decode()] = Value(start, end, quote)
        return StartTag(tag.end(), last, values, quote, tag[0].endswith(b"/>"))

    def spliced(self, start: int, end: int, text: str) -> "Document":
        """Return the file with a text instead of the bytes from `start` to `end`, without `end`."""
        return _document(self.text[:start] + text.encode() + self.text[end:])

    def indentation(self, position: int) -> str | None:
        """Return the spaces and tabs before a position; None unless they begin a line."""
        start = self.behind_last(position, b" \t")
        before = self.visible[:start].removeprefix(codecs.BOM_UTF8)
        if before and not before.endswith((b"\r", b"\n")):
            return None
        return self.visible[start:position].decode()

    def line_end_before(self, position: int) -> str:
        """Return the first line end of the white space before a position, or nothing."""
        return _first_newline(self.visible[self.behind_last(position, b" \t\r\n") : position])

    def behind_last(self, position: int, skipped: bytes) -> int:
        return len(self.visible[:position].rstrip(skipped))


def parse(text: bytes) -> Document:
    if models.is_utf16(text):
        raise InputError(models.UTF16)
    if b"\0" in text[:64]:
        raise InputError("it is binary, not XML: give the MJCF file that it was compiled from")
    try:
        return _document(text)
    except expat.ExpatError as error:
        raise InputError(f"it is not well-formed XML: {one_line(error)}") from error


def _document(text: bytes) -> Document:
    characters = _COMMENT.sub(_hidden, text).decode(errors="surrogateescape")
    reader = _Reader(_NO_TEXT.sub("?", characters).encode())
    return Document(text, reader.visible, reader.root, tuple(reader.files))


def _hidden(match: re.Match[bytes]) -> bytes:
    """Return a comment with spaces for what it holds; CDATA as it is."""
    comment = match[0]
    if not comment.startswith(b"<!--"):
        return comment
    return b"<!--" + _NOT_LINE_END.sub(b" ", comment[4:-3]) + b"-->"


def _first_newline(text: bytes) -> str:
    match = _LINE_END.search(text)
    return match[0].decode() if match else ""


class _Reader:
    def __init__(self, visible: bytes):
        self.visible = visible
        self.files: list[str] = []
        self._depth = 0
        self._open: list[Element] = []
        self._parser = expat.ParserCreate("utf-8")
        self._parser.specified_attributes = True
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.EntityDeclHandler = self._entity
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.Parse(visible, True)

    def _doctype(self, name: str, system: str | None, public: str | None, internal: int) -> None:
        if system or public:
            _refuse_entities("its DOCTYPE names another file")

    def _entity(self, name: str, is_parameter: int, value: str | None, *_: str | None) -> None:
        if value is None:
            _refuse_entities(f"its entity {one_line(name, 40)} is in another file")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if name in _REFERRING and "file" in attributes:
            self.files.append(attributes["file"])
        if self._depth > 2 and not (self._depth == 3 and self._open[-1].name in _SECTIONS):
            return
        start = self._parser.CurrentByteIndex
        if not self.visible.startswith(f"<{name}".encode(), start):
            _refuse_entities(f"its <{one_line(name, 40)}> comes from an entity")
        element = Element(name, attributes, start, self._depth)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, name: str) -> None:
        if self._open[-1].depth == self._depth:
            self._open.pop().end = self._parser.CurrentByteIndex
        self._depth -= 1


def _refuse_entities(reason: str) -> NoReturn:
    raise InputError(f"{reason}, which MuJoCo does not read: write out its text in the model")
