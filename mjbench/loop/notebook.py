"""The Python of a Jupyter notebook: its code cells, without the commands of IPython; new texts.

Cells that begin with a magic such as `%%bash` hold no Python. In the others, `pass` replaces lines
such as `%env` or `!pip`, so that every other line keeps its number and its column.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

# Cell magics below whose line there is Python.
_PYTHON_MAGICS = {"capture", "debug", "prun", "python", "python3", "time", "timeit"}
# At the beginning of a statement: `%env`, `!pip`, `?name`, the rarer `/`, `,` and `;`, `a = !ls`
# and `name?`. None of them is Python there.
_COMMAND = re.compile(
    r"[ \t]*(?P<command>[%!?/,;]|\w[\w.,'\"\[\] \t]*=[ \t]*[%!]|[%\w.*]+\?{1,2}[ \t]*$)"
    r"(?:.*\\\n)*.*",
    re.MULTILINE,
)
# What decides where a statement ends: strings, comments, brackets, line breaks.
_TOKEN = re.compile(
    r"(?s:(?P<quotes>'''|\"\"\")(?:\\.|.)*?(?:(?P=quotes)|\Z))"
    r"|'(?:\\(?s:.)|[^'\\\n])*'?|\"(?:\\(?s:.)|[^\"\\\n])*\"?"
    r"|#.*|\\\n|(?P<open>[(\[{])|(?P<close>[)\]}])|(?P<end>\n)"
)
_NEWLINE = re.compile(r"\r\n?")


@dataclass(frozen=True)
class NotebookPart:
    """A code cell of a notebook, or a whole Python file.

    Attributes:
      cell: number in the notebook, from 1, where cells of text count; None for a Python file.
    """

    text: str
    python: str
    cell: int | None = None


@dataclass(frozen=True)
class _Cell:
    cell_type: str
    source: str | list[str] = ""
    input: str | list[str] = ""  # what version 3 of the format calls the source


@dataclass(frozen=True)
class _Worksheet:
    cells: list[_Cell]


@dataclass(frozen=True)
class _KernelSpec:
    language: str = ""


@dataclass(frozen=True)
class _LanguageInfo:
    name: str = ""


@dataclass(frozen=True)
class _Metadata:
    kernelspec: _KernelSpec = _KernelSpec()
    language_info: _LanguageInfo = _LanguageInfo()


@dataclass(frozen=True)
class _Notebook:
    cells: list[_Cell] | None = None
    worksheets: list[_Worksheet] | None = None  # version 3 of the format
    metadata: _Metadata = _Metadata()


def code_cells(data: bytes) -> list[NotebookPart]:
    """Return the code cells of a notebook of Python, in its order; else ValueError."""
    notebook = _notebook(data)
    language = notebook.metadata.kernelspec.language or notebook.metadata.language_info.name
    if language and "python" not in language.lower():
        raise ValueError(f"a notebook of {language}, not of Python")
    cells = []
    for number, cell in enumerate(_all_cells(notebook), 1):
        if cell.cell_type == "code":
            source = cell.source or cell.input
            text = _NEWLINE.sub("\n", source if isinstance(source, str) else "".join(source))
            cells.append(NotebookPart(text, _python(text), number))
    return cells


def with_texts(data: bytes, texts: Mapping[int, str]) -> bytes:
    """Return a notebook with other texts in some cells, all else as it was; else ValueError."""
    try:
        document = json.loads(data)
        if _encoded(document, data) == data:
            for number, text in texts.items():
                _set_text(_stored_cell(document, number), text)
            return _encoded(document, data)
    except UnicodeEncodeError:  # a lone surrogate
        pass
    raise ValueError("the JSON of the notebook is not laid out as Jupyter writes it")


def _encoded(document: Any, like: bytes) -> bytes:
    """Return a document as JSON, laid out like another one: indentation, escapes, line ends."""
    indent = re.match(rb"\{(?P<end>\r?\n)(?P<indent>[ \t]+)", like)
    text = json.dumps(
        document, ensure_ascii=like.isascii(), indent=indent["indent"].decode() if indent else None
    )
    content = text.replace("\n", indent["end"].decode() if indent else "\n").encode()
    return content + like[len(like.rstrip(b"\r\n")) :]


def _stored_cell(document: Any, number: int) -> dict[str, Any]:
    worksheets = document["worksheets"] if document.get("cells") is None else [document]
    cells = [cell for worksheet in worksheets for cell in worksheet["cells"]]
    cell: dict[str, Any] = cells[number - 1]
    return cell


def _set_text(cell: dict[str, Any], text: str) -> None:
    key = "source" if cell.get("source") else "input"
    stored = cell[key]
    if isinstance(stored, str) and "\r" not in stored:
        cell[key] = text
    elif stored == _lines("".join(stored)):
        cell[key] = _lines(text)
    else:
        raise ValueError("the lines of a cell are not stored as Jupyter does it")


def _lines(text: str) -> list[str]:
    return re.findall(r".*\n|.+", text)


def _notebook(data: bytes) -> _Notebook:
    try:
        return msgspec.convert(json.loads(data), _Notebook)
    except UnicodeDecodeError as error:
        raise ValueError("not a Jupyter notebook: not UTF-8 text") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"not a Jupyter notebook: not JSON ({error})") from error
    except msgspec.ValidationError as error:
        raise ValueError(f"not a Jupyter notebook: {error}") from error


def _all_cells(notebook: _Notebook) -> Sequence[_Cell]:
    if notebook.cells is not None:
        return notebook.cells
    if notebook.worksheets is not None:
        return [cell for worksheet in notebook.worksheets for cell in worksheet.cells]
    raise ValueError("not a Jupyter notebook: it has no cells")


def _python(text: str) -> str:
    """Return the lines of a cell, those that are not Python empty or replaced by `pass`."""
    magic = re.match(r"(?P<above>\s*)%%(?P<name>\S*).*", text)
    if magic is None:
        return _without_commands(text)
    if magic["name"] not in _PYTHON_MAGICS:
        return ""
    return magic["above"] + _without_commands(text[magic.end() :])


def _without_commands(text: str) -> str:
    """Return a cell with `pass` for each command of IPython that stands as a statement."""
    parts = []
    start = 0  # of the line at which a statement begins
    while start < len(text):
        command = _COMMAND.match(text, start)
        if command is None:
            end = _statement_end(text, start)
            parts.append(text[start:end])
        else:
            end = min(command.end() + 1, len(text))
            indent = text[start : command.start("command")]
            parts.append(f"{indent}pass" + "\n" * text.count("\n", start, end))
        start = end
    return "".join(parts)


def _statement_end(text: str, start: int) -> int:
    """Return where the next statement begins, after the line break that ends the one at `start`."""
    depth = 0  # of brackets
    for token in _TOKEN.finditer(text, start):
        if token["open"]:
            depth += 1
        elif token["close"]:
            depth = max(depth - 1, 0)
        elif token["end"] and depth == 0:
            return token.end()
    return len(text)
