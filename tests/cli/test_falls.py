"""`mjbench falls` as a user types it."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import mjbench

from mjbench.cli import cli


def test_it_prints_bars_and_writes_json(tmp_path: Path) -> None:
    done = mjbench(
        *("falls", "--angles", "0.1,0.4", "--samples", "10", "--threads", "1", "--json", "o.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "o.json").read_text())
    assert [row["angle"] for row in document["angles"]] == [0.1, 0.4]
    assert set(document["ways"][0]) == {"path", "threads", "seconds", "speedup", "counts"}
    assert "0.40 rad" in done.stdout
    assert "same falls" in done.stdout


def test_an_angle_that_is_given_twice_counts_once(tmp_path: Path) -> None:
    words = ["falls", "--angles", "0.1,0.10", "--samples", "2", "--threads", "1", "--json", "-"]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0
    assert [row["angle"] for row in json.loads(result.stdout)["angles"]] == [0.1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--angles", "0.1,steep"], "steep"),
        (["--angles", "nan"], "from -6.28 to 6.28 rad"),
        (["--angles", "1e308"], "from -6.28 to 6.28 rad"),
        (["--angles", ""], "not a list of angles"),
        (["--angles", ","], "not a list of angles"),
        (["--samples", str(10**12)], "not in the range"),
        (["--samples", str(10**9)], "reduce --samples"),
        (["--threads", "100000"], "100000 is above 1024"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(words: list[str], message: str) -> None:
    result = CliRunner().invoke(cli, ["falls", *words])
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stdout == ""
