"""The run file: everything a run measured, one JSON record a line, readable at any moment.

A record is a frozen dataclass with a class variable `record_type`. It is appended and flushed when
its measurement ends, so a killed run leaves every earlier record readable; a last line cut short
is left out. docs/formats.md has an example of each.
"""

import contextlib
import hashlib
import io
import itertools
import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, ClassVar, Protocol, TypeVar

import msgspec

from mjbench.errors import InputError, one_line, printable, reason
from mjbench.host.machine import Machine

# The version of run files and of every document that `--json` writes.
#   1  first version
SCHEMA = 1
# Keys whose texts have several lines; line breaks in other texts are foreign.
_MULTILINE_KEYS = {"snippet", "code"}

# Numbers are not larger: their products and ratios do not overflow.
_LARGEST = 1e100

_T = TypeVar("_T")


class Record(Protocol):
    """A frozen dataclass that is stored in a run file."""

    record_type: ClassVar[str]


@dataclass(frozen=True)
class InputFile:
    """A file that a command was given.

    Attributes:
      name: without its folder.
      sha256: of its content, in hexadecimal; empty where it could not be read.
    """

    name: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "InputFile":
        try:
            with path.open("rb") as file:
                return cls(printable(path.name), hashlib.file_digest(file, "sha256").hexdigest())
        except OSError:
            return cls(printable(path.name), "")


@dataclass(frozen=True)
class RunHeader:
    """The first line of a run file.

    Attributes:
      arguments: they must be the same for `resume`.
      command_line: the words after `mjbench`.
      began: in UTC, as ISO 8601.
    """

    record_type: ClassVar[str] = "run"
    schema: int
    command: str
    machine: Machine
    arguments: dict[str, Any]
    files: tuple[InputFile, ...] = ()
    command_line: tuple[str, ...] = ()
    began: str = ""

    @property
    def typed_command(self) -> str:
        """The words after `mjbench`, for a shell."""
        return shlex.join(self.command_line)

    def files_of(self, models: Iterable[str]) -> tuple[InputFile, ...]:
        """Return the files that models were loaded from, which their names name."""
        names = {PurePath(model).name for model in models}
        return tuple(file for file in self.files if file.name in names)


@dataclass(frozen=True)
class Run:
    """A run file, read back; `is_torn` if its last line was cut short, and is left out."""

    header: RunHeader
    records: tuple[Record, ...]
    is_torn: bool = False

    def of_type(self, kind: type[_T]) -> list[_T]:
        return [record for record in self.records if isinstance(record, kind)]


def to_json(value: Any) -> Any:
    """Return a dataclass, or a container of them, as JSON-ready values.

    Paths become the names of their files, as folders are only of this machine; a number that is not
    finite, which JSON cannot hold, becomes None, as does one that is beyond what is read.
    """
    return _finite(msgspec.to_builtins(value, enc_hook=_text))


def _text(value: object) -> str:
    return printable(value.name if isinstance(value, PurePath) else value)


def _finite(value: Any) -> Any:
    match value:
        case float():
            return value if abs(value) <= _LARGEST else None
        case list() | tuple():
            return [_finite(item) for item in value]
        case dict():
            return {key: _finite(item) for key, item in value.items()}
    return value


def as_stored(value: Any) -> Any:
    """Return JSON-ready values as they come back from a run file."""
    return _printable_texts(json.loads(json.dumps(value)))


def load(path: Path, record_types: Mapping[str, type]) -> Run:
    """Read a run file; InputError for what is none, of another format, or of unknown records."""
    return parse(path, read_lines(path), record_types)


def read_lines(path: Path) -> list[bytes]:
    """Return the lines of a file with their line breaks, which the last one may lack."""
    try:
        if not (path.is_file() or path.is_fifo() or not path.exists()):
            raise InputError(f"{path}: not a file")
        return io.BytesIO(path.read_bytes()).readlines()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {reason(error)}") from error


def parse(path: Path, lines: Sequence[bytes], record_types: Mapping[str, type]) -> Run:
    """Return the run that lines of a file hold, the run's header first."""
    values, is_torn = _values(path, lines)
    if not values or not isinstance(values[0], dict) or values[0].get("type") != "run":
        raise InputError(f"{path}: not a run file (its first line must be the run's header)")
    if values[0].get("schema") != SCHEMA:
        raise InputError(
            f"{path}: format {values[0].get('schema')!r}, this version of mjbench reads {SCHEMA}"
        )
    types = {**record_types, RunHeader.record_type: RunHeader}
    header, *records = (
        _typed(path, number, value, types) for number, value in enumerate(values, 1)
    )
    for number, record in enumerate(records, 2):
        if isinstance(record, RunHeader):
            raise InputError(f"{path}, line {number}: a second header")
    return Run(header, tuple(records), is_torn)


def _values(path: Path, lines: Sequence[bytes]) -> tuple[list[Any], bool]:
    """Return the JSON value of each line, and whether a last line that is cut short is left out."""
    values: list[Any] = []
    for number, line in enumerate(lines, 1):
        try:
            values.append(_printable_texts(msgspec.json.decode(line)))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            if len(values) + 1 == len(lines) and values:
                return values, True  # the writer was killed in the middle of its last line
            raise InputError(f"{path}, line {number}: not JSON; not a run file?") from error
        except ValueError as error:
            raise InputError(f"{path}, line {number}: {one_line(error)}") from error
    return values, False


def _printable_texts(value: Any, key: str = "") -> Any:
    """Return a JSON value whose texts have no control characters, nor line breaks in a name."""
    if isinstance(value, str):
        lines = value.split("\n") if key in _MULTILINE_KEYS else [value]
        return "\n".join(map(printable, lines))
    if isinstance(value, list):  # most are of numbers
        numbers = [v for v in value if isinstance(v, float | int)]
        if numbers and not -_LARGEST <= min(numbers) <= max(numbers) <= _LARGEST:
            raise ValueError(f"a number beyond {_LARGEST:g}")
        if len(numbers) == len(value):
            return value
        return [_printable_texts(v, key) for v in value]
    if isinstance(value, dict):
        return {printable(k): _printable_texts(item, k) for k, item in value.items()}
    if isinstance(value, float | int) and not -_LARGEST <= value <= _LARGEST:
        raise ValueError(f"a number beyond {_LARGEST:g}")
    return value


def _typed(path: Path, number: int, value: Any, types: Mapping[str, type]) -> Any:
    name = str(value.get("type")) if isinstance(value, dict) else ""
    kind = types.get(name)
    if kind is None:
        raise InputError(f"{path}, line {number}: not a record of a run file")
    try:
        return msgspec.convert(value, kind)
    except (msgspec.ValidationError, RecursionError) as error:
        raise InputError(f"{path}, line {number}: {one_line(error)}") from error


def of_name(name: Path, folder: Path) -> Path:
    """Return a run file: -1 is the newest of a folder, -2 the one before it, and so on."""
    if not re.fullmatch(r"-[1-9]\d*", str(name)):
        return name
    stored, number = newest_first(folder), -int(str(name))
    if number > len(stored):
        raise InputError(
            f"{name}: {folder} has {len(stored)} run files; `mjbench show --list` lists them"
        )
    return stored[number - 1]


def newest_first(folder: Path) -> list[Path]:
    """Return the run files of a folder that have a record, or all if none has; or InputError."""
    written: list[tuple[float, Path]] = []
    for path in folder.glob("*.jsonl"):
        with contextlib.suppress(OSError):  # a link to nothing, or no permission
            status = path.stat()
            if path.is_file() and status.st_size:
                written.append((status.st_mtime, path))
    if not written:
        raise InputError(f"no run file in {folder}; `mjbench compare` writes one")
    stored = [path for _, path in sorted(written, reverse=True)]
    return [path for path in stored if _has_record(path)] or stored


def _has_record(file: Path) -> bool:
    """Return whether a line follows the header: a command may fail before it has a result."""
    try:
        with file.open("rb") as lines:
            return next(itertools.islice(lines, 1, None), None) is not None
    except OSError:
        return False
