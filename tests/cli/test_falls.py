"""`mjbench falls` as a user types it."""

import json
from pathlib import Path

from commands import mjbench


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


def test_an_angle_that_is_no_number_is_bad_input() -> None:
    done = mjbench("falls", "--angles", "0.1,steep")
    assert done.returncode == 2
    assert "steep" in done.stderr
