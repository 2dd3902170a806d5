"""How a Python file is decoded, parsed and counted in lines."""

import ast
import os
from pathlib import Path

import pytest

from mjbench.commands.lint import python_source
from mjbench.commands.lint.python_source import PythonProgram, read_program
from mjbench.errors import InputError


def program(tmp_path: Path, data: bytes) -> PythonProgram:
    file = tmp_path / "script.py"
    file.write_bytes(data)
    return read_program(str(file))


def name_of(program: PythonProgram) -> str:
    (statement,) = program.tree.body
    assert isinstance(statement, ast.Expr)
    return ast.unparse(statement)


@pytest.mark.parametrize(
    "data",
    [
        "é".encode(),
        "\ufeffé".encode(),
        "# -*- coding: latin-1 -*-\né".encode("latin-1"),
        "#!/usr/bin/env python\n# vim: set fileencoding=cp1252 :\né".encode("cp1252"),
        "# coding: latin-1\ré".encode("latin-1"),
        "\n# coding: latin-1\né".encode("latin-1"),
        "\n\n# coding: latin-1\né".encode(),
        "# a comment\r# another\ré  # coding: latin-1".encode(),
    ],
)
def test_a_file_is_decoded_as_python_does(tmp_path: Path, data: bytes) -> None:
    assert name_of(program(tmp_path, data)) == "é"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xe9", "encoding"),
        (b"x\n" * 9 + b"\xe9", "decode"),
        (b"# coding: klingon\n", "klingon"),
        (b"# coding: rot13\n", "rot13"),
        ("x".encode("utf-16"), "encoding"),
        (b"\xef\xbb\xbf# coding: latin-1\n", "encoding"),
        (b"\x00", "null bytes"),
        (b"x = 1\ny = (\n", "line 2: "),
        (b"# coding: raw_unicode_escape\n'\\ud800'", "surrogates"),
        (b"x = " + b"9" * 5000, "line 1: "),
        (b"(" * 100_000, "parentheses"),
    ],
)
def test_what_is_not_python_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=rf"script\.py: [^\n]*{message}"):
        program(tmp_path, data)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_are_those_that_the_parser_counts(tmp_path: Path, end: str) -> None:
    text = end.join(["x = '\x0b\x85\u2028'", "\x0c", "\x0cif x:", "    pass", "y"])
    parsed = program(tmp_path, text.encode())
    assert len(parsed.lines) == 5
    assert [node.lineno for node in parsed.tree.body] == [1, 3, 5]
    assert parsed.line_of(parsed.tree.body[-1]) == "y"


def test_columns_count_characters(tmp_path: Path) -> None:
    parsed = program(tmp_path, "é; 𝔁; x".encode())
    columns = [parsed.column_of(node) for node in parsed.tree.body]
    assert columns == [1, 4, 7]


def test_what_python_warns_about_is_no_error(tmp_path: Path) -> None:
    assert name_of(program(tmp_path, rb"'\d'")) == repr(r"\d")


def test_a_notebook_is_refused_with_what_makes_it_a_python_file(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"a notebook; .*: jupyter nbconvert --to script .*n\.ipynb"
    ):
        read_program(str(tmp_path / "n.ipynb"))


def test_what_is_not_a_regular_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "loop.py").symlink_to("loop.py")
    for name in (tmp_path, tmp_path / "pipe.py", "/dev/zero", ""):
        with pytest.raises(InputError, match="not a regular file"):
            read_program(str(name))
    with pytest.raises(InputError, match=r"loop\.py: cannot be read: Too many levels"):
        read_program(str(tmp_path / "loop.py"))
    with pytest.raises(InputError, match="cannot be read: File name too long"):
        read_program("x" * 5000)
    with pytest.raises(InputError, match=r"missing\.py: no such file"):
        read_program(str(tmp_path / "missing.py"))


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large.py").open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(InputError, match="larger than 10 MB"):
        read_program(str(tmp_path / "large.py"))


def test_more_python_than_the_parser_has_memory_for_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(python_source, "MAX_PYTHON_BYTES", 3)
    assert name_of(program(tmp_path, b"xyz")) == "xyz"
    with pytest.raises(InputError, match="larger than 0 MB"):
        program(tmp_path, b"wxyz")
