"""`mjbench bisect` over releases: what it refuses, before anything is measured."""

from pathlib import Path

import pytest
from commands import mjbench


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("4.0.0", "3.17.0", "cartpole"), "name the older release first"),
        (("3.17.0", "3.17.0", "cartpole"), "name the older release first"),
        (("3.2.7", "3.x", "cartpole"), "'3.x' is not a release"),
        (("3.2.7", "3.4.0", "none.xml"), "none.xml"),
        (("numpy==2.3.5", "numpy==2.4.0", "cartpole"), "searches releases of MuJoCo alone"),
        (("main", "HEAD", "cartpole"), "'main' is not a release"),
        (("main", "HEAD", "bench:step"), "a function is FILE.py::FUNCTION, such as bench.py::step"),
        (("3.2.7", "3.4.0", "cartpole", "--metric", "compile"), "is of paths that compile only"),
        (("main", "HEAD", "bench.py::step"), "in no checkout of a git repository"),
        (("rev=main", "3.4.0", "bench.py::step"), "in no checkout of a git repository"),
    ],
)
def test_what_cannot_be_searched_is_reported_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = mjbench("bisect", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()[-1:]
    assert message in line
    assert "Traceback" not in done.stderr
