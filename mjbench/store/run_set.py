"""The run set: runs of one or several machines in one file, each once and as its run file has it.

The first line says that it is a set. Then follow sections: a line that says how many lines follow
and which SHA-256 they have, and those lines, which are a run file's. A section is written at once;
one that was cut short, because its writer was killed, is left out, and cut off when the file is
continued. Nothing else in the file ever changes. docs/formats.md describes it.
"""

import contextlib
import functools
import hashlib
import json
import os
import re
import stat
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import ClassVar, TypeVar

import msgspec

from mjbench.errors import InputError, one_line, printable, writing
from mjbench.store.run_writer import EARLIER_IS_THERE, lock
from mjbench.store.runs import SCHEMA, Run, parse, read_lines, split_lines

# The first line of a set or of a section; no line of a run file matches.
_OWN_LINE = re.compile(rb'\s*\{\s*"type"\s*:\s*"(set|section)"')

_Header = TypeVar("_Header", "SetHeader", "SectionHeader")


@dataclass(frozen=True)
class SetHeader:
    """The first line of a run set."""

    record_type: ClassVar[str] = "set"
    schema: int = SCHEMA


@dataclass(frozen=True)
class SectionHeader:
    """The line before the lines of a run.

    Attributes:
      lines: lines of a run file that follow.
      sha256: of these lines as bytes, with their line breaks, in hexadecimal.
      cell: which cell of a sweep they are; empty otherwise.
    """

    record_type: ClassVar[str] = "section"
    lines: int
    sha256: str
    cell: str = ""


@dataclass(frozen=True)
class RunSection:
    """A run within a set."""

    cell: str
    run: Run
    lines: tuple[bytes, ...]

    @functools.cached_property
    def sha256(self) -> str:
        return hashlib.sha256(b"".join(self.lines)).hexdigest()

    def continues(self, other: "RunSection") -> bool:
        """Return whether this is a later state of the same run file: it begins with the other."""
        count = len(other.lines)
        return len(self.lines) > count and self.lines[:count] == other.lines


@dataclass(frozen=True)
class RunSet:
    """A run set, read back.

    Attributes:
      is_torn: whether the last section, or the last line of a run file, was cut short and left out.
      is_run_file: whether it was read from a run file, as a set of one section.
    """

    sections: tuple[RunSection, ...]
    is_torn: bool = False
    is_run_file: bool = False

    @property
    def runs(self) -> tuple[Run, ...]:
        """Each run once: a section that another repeats or continues is left out.

        Cells of a sweep that one command measured are one run, as they were in its run file.
        """
        whole: dict[bytes, list[RunSection]] = {}
        for section in distinct(self.sections):
            # the header of a run file has the second in which it began
            whole.setdefault(
                section.lines[0] if section.cell else section.sha256.encode(), []
            ).append(section)
        return tuple(_joined(sections) for sections in whole.values())


def distinct(sections: Iterable[RunSection]) -> tuple[RunSection, ...]:
    """Return the sections without those that an earlier one repeats or another continues."""
    unique = tuple({section.sha256: section for section in sections}.values())
    of_header: dict[bytes, list[RunSection]] = defaultdict(list)
    for section in unique:
        of_header[section.lines[0]].append(section)
    return tuple(
        s for s in unique if not any(other.continues(s) for other in of_header[s.lines[0]])
    )


def _joined(sections: Sequence[RunSection]) -> Run:
    first, *others = sections
    if not others:
        return first.run
    records = {
        line: record
        for section in sections
        for line, record in zip(section.lines[1:], section.run.records, strict=True)
    }
    return Run(first.run.header, tuple(records.values()))


class RunSetFile:
    """A run set that is being written; it is locked while it is open."""

    def __init__(self, path: Path, file: FileIO):
        """Append to an open file; `create` and `open` open one."""
        self.path, self._file = path, file

    @classmethod
    def create(cls, path: Path) -> "RunSetFile":
        """Create a file with no section; its folder must be there."""
        with writing(path):
            file = _open(path, os.O_CREAT | os.O_EXCL)
            try:
                _begin_or_repair(path, file)
            except OSError:
                file.close()
                path.unlink(missing_ok=True)
                raise
        return cls(path, file)

    @classmethod
    def open(cls, path: Path) -> "RunSetFile":
        """Open a file for more sections, and cut off what a killed writer left unfinished.

        Raises:
          InputError: it is no run set, or is damaged; then nothing changes.
          MachineError: there is none, it cannot be written, or another process writes it.
        """
        with writing(path), contextlib.ExitStack() as on_error:
            file = on_error.enter_context(_open(path))
            _begin_or_repair(path, file)
            on_error.pop_all()
        return cls(path, file)

    def append(self, section: RunSection) -> None:
        """Write one section at once, so that a reader sees all of it or none."""
        header = SectionHeader(len(section.lines), section.sha256, printable(section.cell))
        with writing(self.path, EARLIER_IS_THERE):
            _write(self._file, b"".join((_line(header), *section.lines)))

    def close(self) -> None:
        """Close the file; `append` has already reported any failure to write."""
        with contextlib.suppress(OSError):
            self._file.close()


def read(path: Path, record_types: Mapping[str, type]) -> RunSet:
    """Read a run set, or a run file as a set of one section; InputError for what is neither."""
    lines = read_lines(path)
    if not lines or not _OWN_LINE.match(lines[0]):
        section = _section(path, lines, record_types)
        return RunSet((section,), section.run.is_torn, is_run_file=True)
    headers, end = _headers(path, lines)
    sections = []
    for begin, header in headers.items():
        own = lines[begin : begin + header.lines]
        run = parse(path, own, record_types, begin + 1, may_be_torn=False)
        sections.append(RunSection(printable(header.cell), run, tuple(own)))
    return RunSet(tuple(sections), end < len(lines))


def read_together(paths: Sequence[Path], record_types: Mapping[str, type]) -> RunSet:
    """Return what a file holds, or what several hold as one set."""
    if len(paths) == 1:
        return read(paths[0], record_types)
    return RunSet(tuple(section for _, section in load_files(paths, record_types)))


def load_files(
    paths: Iterable[Path], record_types: Mapping[str, type]
) -> list[tuple[Path, RunSection]]:
    """Read run files and run sets: each run once, with the first file that holds it."""
    by_digest: dict[str, tuple[Path, RunSection]] = {}
    for path in paths:
        for section in read(path, record_types).sections:
            by_digest.setdefault(section.sha256, (path, section))
    return [by_digest[s.sha256] for s in distinct(s for _, s in by_digest.values())]


def _section(path: Path, lines: Sequence[bytes], record_types: Mapping[str, type]) -> RunSection:
    """Return a run file as a section, without a last line that was cut short."""
    run = parse(path, lines, record_types)
    whole = lines[: 1 + len(run.records)]
    # the last line break may be missing: the writer was killed before it, or an editor left it out
    return RunSection("", run, tuple(line.rstrip(b"\n") + b"\n" for line in whole))


def _open(path: Path, flags: int = 0) -> FileIO:
    extra = os.O_APPEND | flags
    file = FileIO(path, "r+", opener=lambda name, mode: os.open(name, mode | extra, 0o666))
    with contextlib.ExitStack() as on_error:
        on_error.callback(file.close)
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise InputError(f"{path}: not a file")
        lock(file)
        on_error.pop_all()
    return file


def _begin_or_repair(path: Path, file: FileIO) -> None:
    """Write the first line where there is none, or cut off a section that is not complete."""
    lines = split_lines(file.readall())
    first = _line(SetHeader())
    if not lines or (len(lines) == 1 and first.startswith(lines[0]) and lines[0] != first):
        file.truncate(0)  # the writer was killed before it had written the first line
        _write(file, first)
        return
    _, end = _headers(path, lines)
    if end < len(lines):
        file.truncate(sum(map(len, lines[:end])))


def _headers(path: Path, lines: Sequence[bytes]) -> tuple[dict[int, SectionHeader], int]:
    """Return the header before each section, which begins at a line; and where whole ones end."""
    if not lines or not _OWN_LINE.match(lines[0]):
        raise InputError(f'{path}: not a run set (its first line must be {{"type": "set", …}})')
    schema = _decoded(path, lines, 0, SetHeader).schema
    if schema != SCHEMA:
        raise InputError(f"{path}: format {schema!r}, this version of mjbench reads {SCHEMA}")
    headers: dict[int, SectionHeader] = {}
    at = 1
    while at < len(lines) and lines[at].endswith(b"\n"):
        header = _decoded(path, lines, at, SectionHeader)
        begin, end = at + 1, at + 1 + header.lines
        own = [n for n in range(begin, min(end, len(lines))) if _OWN_LINE.match(lines[n])]
        if own:
            raise InputError(
                f"{path}, line {own[0] + 1}: a section begins within the one of line {at + 1}"
            )
        is_whole = end <= len(lines) and lines[end - 1].endswith(b"\n")
        digest = hashlib.sha256(b"".join(lines[begin:end])).hexdigest()
        if is_whole != (digest == header.sha256):
            raise InputError(
                f"{path}, line {at + 1}: the section is not as it was written"
                f" (its {header.lines} lines have another SHA-256); merge its run file again"
            )
        if not is_whole:
            break
        headers[begin], at = header, end
    return headers, at


def _decoded(path: Path, lines: Sequence[bytes], at: int, kind: type[_Header]) -> _Header:
    try:
        value = msgspec.json.decode(lines[at])
        if not isinstance(value, dict) or value.get("type") != kind.record_type:
            raise InputError(f"{path}, line {at + 1}: not the first line of a {kind.record_type}")
        header = msgspec.convert(value, kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}, line {at + 1}: {one_line(error)}") from error
    if isinstance(header, SectionHeader) and header.lines < 1:
        raise InputError(f"{path}, line {at + 1}: a section of {header.lines} lines")
    return header


def _line(header: SetHeader | SectionHeader) -> bytes:
    value = {"type": header.record_type, **msgspec.to_builtins(header)}
    return json.dumps(value).encode() + b"\n"


def _write(file: FileIO, content: bytes) -> None:
    """Append all bytes, or none where that fails."""
    size = os.fstat(file.fileno()).st_size
    try:
        written = 0
        while written < len(content):  # less than all: the disk is full, which the next one reports
            written += file.write(content[written:])
    except BaseException:
        with contextlib.suppress(OSError):
            file.truncate(size)
        raise
