"""The syntax of a Python file, and its lines.

A file is decoded as Python decodes it: by its byte order mark, or by the encoding that it declares,
else as UTF-8.
"""

import ast
import re
import shlex
import stat
import tokenize
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, file_argument, one_line
from mjbench.simulation import models

NOTEBOOK_SUFFIX = ".ipynb"
# The parser needs up to 1 GB of memory for 1 MB of Python.
MAX_PYTHON_BYTES = 10_000_000
# What is wrong with a model, and what to do.
_OF_MODELS = "lint reads Python files; `mjbench MODEL` and `mjbench tune MODEL` read a model"
_NEWLINE = re.compile(r"\r\n|\r|\n")  # as ast counts lines
_NEWLINE_BYTES = re.compile(_NEWLINE.pattern.encode())


@dataclass(frozen=True)
class PythonProgram:
    """A Python file.

    Attributes:
      lines: the lines that the line numbers of `tree` count, from 1.
    """

    tree: ast.Module
    lines: Sequence[str]

    def line_of(self, node: ast.expr | ast.stmt) -> str:
        return self.lines[node.lineno - 1]

    def column_of(self, node: ast.expr | ast.stmt) -> int:
        """Return the column in which a node begins, from 1, in characters."""
        before = self.line_of(node).encode()[: node.col_offset]
        return len(before.decode(errors="ignore")) + 1


def read_program(file: str) -> PythonProgram:
    if file.endswith(NOTEBOOK_SUFFIX):
        raise InputError(f"{file}: {save_as_python(file)}")
    try:
        return parse_python(_read(Path(file)))
    except FileNotFoundError as error:
        raise InputError(f"{file}: no such file") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except (SyntaxError, ValueError, LookupError) as error:  # LookupError: of an encoding
        is_model = Path(file).suffix.lower() in models.SUFFIXES
        raise InputError(f"{file}: {_OF_MODELS if is_model else one_line(error)}") from error


def save_as_python(file: str) -> str:
    """Return what is wrong with a notebook, and what to do."""
    command = f"jupyter nbconvert --to script {shlex.quote(file_argument(file))}"
    return f"a notebook; save it as a Python file: {command}"


def parse_python(data: bytes) -> PythonProgram:
    """Return the program in a Python file; SyntaxError, ValueError, LookupError if it is none."""
    first_lines = _NEWLINE_BYTES.split(data, maxsplit=2)[:2]
    encoding, _ = tokenize.detect_encoding(iter([line + b"\n" for line in first_lines]).__next__)
    text = data.decode(encoding)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of escapes such as "\d": they are not ours to report
            return PythonProgram(ast.parse(text), _NEWLINE.split(text))
    except SyntaxError as error:
        place = f"line {error.lineno}: " if error.lineno else ""
        raise ValueError(f"{place}{error.msg}") from error


def _read(path: Path) -> bytes:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("not a regular file")  # a pipe or a device may never end
    with path.open("rb") as file:
        data = file.read(MAX_PYTHON_BYTES + 1) if status.st_size <= MAX_PYTHON_BYTES else b""
    if max(status.st_size, len(data)) > MAX_PYTHON_BYTES:
        raise ValueError(f"larger than {MAX_PYTHON_BYTES // 10**6} MB")
    return data
