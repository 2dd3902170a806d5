"""Which lines of a notebook are Python."""

import json
from typing import Any

import pytest

from mjbench.loop.notebook import code_cells


def notebook(*sources: Any, **keys: Any) -> bytes:
    cells = [{"cell_type": "code", "source": source, "outputs": []} for source in sources]
    return json.dumps({"nbformat": 4, "metadata": {}, "cells": cells, **keys}).encode()


def python(source: str) -> str:
    (cell,) = code_cells(notebook(source))
    assert cell.text == source
    return cell.python


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("%env A=1\nx = 1", "pass\nx = 1"),
        ("if x:\n    !pip install mujoco\n", "if x:\n    pass\n"),
        ("!echo 'it\nx = 1", "pass\nx = 1"),
        ("!apt install \\\n  ffmpeg \\\n  git\nx = 1", "pass\n\n\nx = 1"),
        ("files = !ls\nt = %timeit -o f()\na, b = !ls\n", "pass\npass\npass\n"),
        ("?len\nlen?\nmujoco.mj_step??\n%env?", "pass\npass\npass\npass"),
        ("/print 1\n,print a\n;print a\n", "pass\npass\npass\n"),
    ],
)
def test_commands_of_ipython_become_pass(source: str, expected: str) -> None:
    assert python(source) == expected


@pytest.mark.parametrize(
    "source",
    [
        "x = (7\n  % 4)",
        "x = 7 \\\n  % 4",
        "s = '''\n!no command\n'''\n",
        's = """it\'s\n%no command\n"""',
        "s = 'a # b (' # it's (\ny = {'%a': [\n  1,\n]}\n",
        "s = 'a\\\n%b'",
        "s = 'open\n[x\n%y]",
        "x = y  # why?",
        "plt.plot(x);",
        "",
    ],
)
def test_python_stays_as_it_is(source: str) -> None:
    assert python(source) == source


@pytest.mark.parametrize("magic", ["time", "timeit -n 3", "capture output", "prun"])
def test_a_cell_that_is_timed_is_python(magic: str) -> None:
    assert python(f"\n%%{magic}\nx = 1\n%env\n") == "\n\nx = 1\npass\n"


@pytest.mark.parametrize("magic", ["bash", "html", "writefile a.py", ""])
def test_a_cell_of_another_language_holds_no_python(magic: str) -> None:
    assert python(f"%%{magic}\nfor i in *; do (\n") == ""


def test_a_source_is_a_list_of_lines_or_a_text() -> None:
    cells = code_cells(notebook(["x = 1\n", "y = 2"], "x = 1\r\ny = 2"))
    assert [cell.python for cell in cells] == ["x = 1\ny = 2"] * 2


def test_cells_of_text_count_and_hold_no_python() -> None:
    (cell,) = code_cells(
        json.dumps(
            {
                "cells": [
                    {"cell_type": "markdown", "source": "a text ("},
                    {"cell_type": "raw", "source": "raw ("},
                    {"cell_type": "code", "source": "x = 1"},
                ]
            }
        ).encode()
    )
    assert (cell.cell, cell.python) == (3, "x = 1")


def test_version_3_of_the_format_is_read() -> None:
    sheets = [[{"cell_type": "code", "input": "x = 1"}], [{"cell_type": "code", "input": ["y"]}]]
    data = json.dumps({"worksheets": [{"cells": cells} for cells in sheets]}).encode()
    assert [(cell.cell, cell.python) for cell in code_cells(data)] == [(1, "x = 1"), (2, "y")]


@pytest.mark.parametrize("language", ["python", "ipython", "Python 3"])
def test_python_is_recognised_by_the_language_of_the_kernel(language: str) -> None:
    metadata = {"language_info": {"name": language, "version": "3"}}
    assert len(code_cells(notebook("x = 1", metadata=metadata))) == 1


def test_a_notebook_of_another_language_is_refused() -> None:
    with pytest.raises(ValueError, match="a notebook of julia"):
        code_cells(notebook("x = 1", metadata={"kernelspec": {"language": "julia"}}))


def test_a_byte_order_mark_and_nan_in_an_output_are_read() -> None:
    data = b'\xef\xbb\xbf{"cells": [{"cell_type": "code", "source": "x", "outputs": [NaN]}]}'
    assert len(code_cells(data)) == 1


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not JSON"),
        (b'{"cells": [', "not JSON"),
        (b"\xff\x00\xfe", "not UTF-8"),
        (b"[]", "got `array`"),
        (b"{}", "it has no cells"),
        (notebook(3), r"got `int` - at `\$.cells"),
        (notebook(["x", None]), r"got `null` - at `\$.cells"),
        (b'{"cells": [{"source": "x"}]}', "cell_type"),
        (notebook("x", metadata=3), r"at `\$.metadata`"),
    ],
)
def test_what_is_not_a_notebook_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=f"^not a Jupyter notebook: .*{message}"):
        code_cells(data)
