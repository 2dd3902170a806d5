"""Which lines of a file belong to which outermost loop."""

import pytest

from mjbench.commands.run import source_loops
from mjbench.commands.run.source_loops import SourceLoop

SOURCE = """\
import os

def observe():
    for i in range(3):
        pass
    return [j for j in range(3)]

def main():
    for epoch in range(2):
        for step in range(3):
            step_once()
        def inner():
            while True:
                break
    after()

while waiting():
    main()
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "program.py"
    path.write_text(SOURCE)
    return str(path)


@pytest.mark.parametrize(
    ("line", "lines"),
    [(1, None), (5, (4, 5)), (6, (6, 6)), (10, (9, 14)), (11, (9, 14)), (15, None), (18, (17, 18))],
)
def test_outermost_loop_of_a_line(file, line, lines):
    loop = source_loops.outermost_loop(file, line)
    assert (loop and (loop.first, loop.last)) == lines


@pytest.mark.parametrize("text", ["", "not python (", "\0", "# -*- coding: nothing -*-\n"])
def test_a_file_that_is_no_python_has_no_loops(tmp_path, text):
    path = tmp_path / "broken.py"
    path.write_text(text)
    assert source_loops.outermost_loop(str(path), 1) is None


def test_a_file_that_is_missing_has_neither_loops_nor_lines(tmp_path):
    missing = str(tmp_path / "missing.py")
    assert source_loops.outermost_loop(missing, 1) is None
    assert source_loops.source_line(missing, 1) == ""


def test_a_line_is_returned_without_its_spaces(file):
    assert source_loops.source_line(file, 11) == "step_once()"
    assert source_loops.source_line(file, 99) == ""


@pytest.mark.parametrize(("line", "is_within"), [(4, True), (5, True), (6, False), (7, True)])
def test_a_loop_runs_within_a_step_if_no_line_that_leads_to_the_step_is_in_it(
    tmp_path, line, is_within
):
    path = tmp_path / "program.py"
    path.write_text(
        "for episode in range(9):\n"
        "    for i in range(9):\n"
        "        env.advance()\n"
        "        for name in names:\n"
        "            read(name)\n"
        "        read('torso')\n"
        "        log.append([read(name) for name in names])\n"
    )
    lines_to_step = [(str(path), 3), (str(tmp_path / "environment.py"), 5)]
    loop = source_loops.loop_within_step((str(path), line), lines_to_step)
    assert (loop is not None) == is_within
    assert loop is None or loop.holds((str(path), line))


def test_a_loop_of_a_package_is_named_by_the_line_that_calls_it(tmp_path):
    package = tmp_path / "site-packages" / "trainer.py"
    package.parent.mkdir()
    package.write_text("def learn(env):\n    for _ in range(9):\n        env.step()\n")
    own = tmp_path / "train.py"
    own.write_text("from trainer import learn\n\nlearn(env)\n")
    stack = [(str(own), 3), (str(package), 3)]
    assert source_loops.program_loop(stack) == (SourceLoop(str(own), 3, 3), 0)
    in_package = SourceLoop(str(package), 2, 3)
    assert source_loops.program_loop(stack[1:]) == (in_package, 0), "no line is the user's"
