"""The syntax of a Python file or a notebook, the place of each of its lines, and changes to it.

A file is decoded as Python decodes it: by its byte order mark, or by the encoding that it declares,
else as UTF-8.
"""

import ast
import re
import stat
import tokenize
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, one_line
from mjbench.loop import notebook
from mjbench.loop.notebook import NotebookPart
from mjbench.simulation import models

NOTEBOOK_SUFFIX = ".ipynb"
# The parser needs up to 1 GB of memory for 1 MB of Python; outputs make notebooks large.
MAX_PYTHON_BYTES, MAX_FILE_BYTES = 10_000_000, 500_000_000
# What is wrong with a model, and what to do.
_OF_MODELS = (
    "lint reads Python files and notebooks; `mjbench MODEL` and `mjbench tune MODEL` read a model"
)
_NEWLINE = re.compile(r"\r\n|\r|\n")  # as ast counts lines
_NEWLINE_BYTES = re.compile(_NEWLINE.pattern.encode())


@dataclass(frozen=True)
class SourceLine:
    """A line of a program.

    Attributes:
      is_command: whether it is not Python, but a command of IPython or a part of one.
      number: from 1; of the file, or of the cell.
    """

    text: str
    is_command: bool
    number: int
    cell: int | None

    @property
    def place(self) -> str:
        """How people name it: `line 3`, or `cell 2, line 3`."""
        return f"cell {self.cell}, line {self.number}" if self.cell else f"line {self.number}"

    def column(self, utf8_offset: int) -> int:
        """Return the column, from 1, of an offset in bytes of UTF-8."""
        return len(self.text.encode()[:utf8_offset].decode(errors="ignore")) + 1


@dataclass(frozen=True)
class PythonProgram:
    """A Python file, or all code cells of a notebook as one.

    Attributes:
      lines: the lines that the line numbers of `tree` count, from 1.
    """

    tree: ast.Module
    lines: Sequence[SourceLine]
    parts: Sequence[NotebookPart]
    data: bytes
    encoding: str | None

    def line_of(self, node: ast.expr | ast.stmt) -> SourceLine:
        return self.lines[min(node.lineno, len(self.lines)) - 1]

    def with_texts(self, texts: Sequence[str]) -> "PythonProgram":
        """Return the program with other texts in its parts; ValueError where that is impossible."""
        if self.encoding is None:
            changed = {
                part.cell: text
                for part, text in zip(self.parts, texts, strict=True)
                if part.cell is not None and text != part.text
            }
            return parse_notebook(notebook.with_texts(self.data, changed))
        (text,) = texts
        program = parse_python(text.encode(self.encoding))
        if program.encoding != self.encoding:
            raise ValueError("the declaration of the encoding moves")
        return program


def read_program(file: str) -> PythonProgram:
    try:
        data = _read(Path(file))
        return parse_notebook(data) if file.endswith(NOTEBOOK_SUFFIX) else parse_python(data)
    except FileNotFoundError as error:
        raise InputError(f"{file}: no such file") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except (SyntaxError, ValueError, LookupError) as error:  # LookupError: of an encoding
        is_model = Path(file).suffix.lower() in models.SUFFIXES
        raise InputError(f"{file}: {_OF_MODELS if is_model else one_line(error)}") from error


def parse_python(data: bytes) -> PythonProgram:
    """Return the program in a Python file; SyntaxError, ValueError, LookupError if it is none."""
    first_lines = _NEWLINE_BYTES.split(data, maxsplit=2)[:2]
    encoding, _ = tokenize.detect_encoding(iter([line + b"\n" for line in first_lines]).__next__)
    text = data.decode(encoding)
    return _parse([NotebookPart(text, text)], data, encoding)


def parse_notebook(data: bytes) -> PythonProgram:
    """Return the program in the bytes of a notebook; ValueError if it is none of Python."""
    return _parse(notebook.code_cells(data), data, None)


def _read(path: Path) -> bytes:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("not a regular file")  # a pipe or a device may never end
    with path.open("rb") as file:
        data = file.read(MAX_FILE_BYTES + 1) if status.st_size <= MAX_FILE_BYTES else b""
    if max(status.st_size, len(data)) > MAX_FILE_BYTES:
        raise ValueError(f"larger than {MAX_FILE_BYTES // 10**6} MB")
    return data


def _parse(parts: Sequence[NotebookPart], data: bytes, encoding: str | None) -> PythonProgram:
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
        lines += _source_lines(part)
    return PythonProgram(tree, lines, parts, data, encoding)


def _source_lines(part: NotebookPart) -> list[SourceLine]:
    texts = _NEWLINE.split(part.text)
    pythons = _NEWLINE.split(part.python) if part.python is not part.text else texts
    pythons += [""] * (len(texts) - len(pythons))  # a cell that is not Python has none
    return [
        SourceLine(text, text != python, number, part.cell)
        for number, (text, python) in enumerate(zip(texts, pythons, strict=True), 1)
    ]


def _parse_part(part: NotebookPart) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of escapes such as "\d": they are not ours to report
            return ast.parse(part.python)
    except SyntaxError as error:
        places = [f"cell {part.cell}"] if part.cell else []
        places += [f"line {error.lineno}"] if error.lineno else []
        raise ValueError(": ".join(filter(None, (", ".join(places), error.msg)))) from error
