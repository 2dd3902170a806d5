"""The syntax of a Python file or a notebook, and the place of each of its lines.

A file is decoded as Python decodes it: by its byte order mark, or by the encoding that it declares,
else as UTF-8.
"""

import ast
import re
import stat
import tokenize
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.errors import InputError, one_line
from mjbench.loop import notebook

NOTEBOOK_SUFFIX = ".ipynb"
# The parser needs up to 1 GB of memory for 1 MB of Python; outputs make notebooks large.
MAX_PYTHON_BYTES, MAX_FILE_BYTES = 10_000_000, 500_000_000
_NEWLINE = re.compile(r"\r\n|\r|\n")  # as ast counts lines
_NEWLINE_BYTES = re.compile(_NEWLINE.pattern.encode())


@dataclass(frozen=True)
class SourceLine:
    """A line of a program.

    Attributes:
      text: without its end.
      number: from 1; of the file, or of the cell.
      cell: of a notebook, from 1; None in a Python file.
    """

    text: str
    number: int
    cell: int | None

    def column(self, utf8_offset: int) -> int:
        """Return the column, from 1, of an offset in bytes of UTF-8."""
        return len(self.text.encode()[:utf8_offset].decode(errors="ignore")) + 1


@dataclass(frozen=True)
class Program:
    """A Python file, or all code cells of a notebook as one.

    Attributes:
      tree: its syntax.
      lines: the lines that the line numbers of `tree` count, from 1.
      encoding: of a Python file; that of notebooks is UTF-8.
    """

    tree: ast.Module
    lines: Sequence[SourceLine]
    encoding: str = "utf-8"

    def line_of(self, node: ast.expr | ast.stmt) -> SourceLine:
        """Return the line at which a node begins."""
        return self.lines[min(node.lineno, len(self.lines)) - 1]


@dataclass(frozen=True)
class _Part:
    """A cell of a notebook, or a whole Python file.

    Attributes:
      text: as stored.
      python: what is parsed; its lines have the numbers of those of `text`.
      cell: number of the cell.
    """

    text: str
    python: str
    cell: int | None = None


def read_program(file: str) -> Program:
    """Return the program in a Python file or a notebook.

    Raises:
      InputError: it cannot be read, or is neither.
      RecursionError, MemoryError: it is nested too deeply, or too large, for the parser.
    """
    try:
        data = _read(Path(file))
        if file.endswith(NOTEBOOK_SUFFIX):
            return _parse(_notebook_parts(data))
        encoding = _encoding(data)
        text = data.decode(encoding)
        return replace(_parse([_Part(text, text)]), encoding=encoding)
    except FileNotFoundError as error:
        raise InputError(f"{file}: no such file") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except (SyntaxError, ValueError, LookupError) as error:  # LookupError: of an encoding
        raise InputError(f"{file}: {one_line(error)}") from error


def _read(path: Path) -> bytes:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("not a regular file")  # a pipe or a device may never end
    with path.open("rb") as file:
        data = file.read(MAX_FILE_BYTES + 1) if status.st_size <= MAX_FILE_BYTES else b""
    if max(status.st_size, len(data)) > MAX_FILE_BYTES:
        raise ValueError(f"larger than {MAX_FILE_BYTES // 10**6} MB")
    return data


def _notebook_parts(data: bytes) -> list[_Part]:
    return [_Part(cell.text, cell.python, cell.number) for cell in notebook.code_cells(data)]


def _encoding(data: bytes) -> str:
    first_lines = _NEWLINE_BYTES.split(data, maxsplit=2)[:2]
    encoding, _ = tokenize.detect_encoding(iter([line + b"\n" for line in first_lines]).__next__)
    return encoding


def _parse(parts: Sequence[_Part]) -> Program:
    """Return the parts as one program; each is parsed by itself, as IPython executes cells."""
    if sum(len(part.python) for part in parts) > MAX_PYTHON_BYTES:
        raise ValueError(f"more than {MAX_PYTHON_BYTES // 10**6} MB of Python")
    tree = ast.Module(body=[], type_ignores=[])
    lines: list[SourceLine] = []
    for part in parts:
        body = _parse_part(part)
        if lines:
            ast.increment_lineno(body, len(lines))
        tree.body += body.body
        texts = _NEWLINE.split(part.text)
        lines += [SourceLine(text, number, part.cell) for number, text in enumerate(texts, 1)]
    return Program(tree, lines)


def _parse_part(part: _Part) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of escapes such as "\d": they are not ours to report
            return ast.parse(part.python)
    except SyntaxError as error:
        places = [f"cell {part.cell}"] if part.cell else []
        places += [f"line {error.lineno}"] if error.lineno else []
        place = f"{', '.join(places)}: " if places else ""
        raise ValueError(f"{place}{error.msg}") from error
