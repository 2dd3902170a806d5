"""`mjbench ab`: findings that fail the command, and targets that mean nothing."""

from pathlib import Path

import pytest
from commands import mjbench


def test_changed_work_can_fail_the_command(tmp_path: Path) -> None:
    words = ("ab", "model=cube_table", "iterations=1,solver=cg", "--time-limit", "0.2s")
    assert mjbench(*words, "--fail-on", "changed-work", cwd=tmp_path).returncode == 1
    assert mjbench(*words, cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("path=nothing", "path=rollout"), "no path 'nothing'"),
        (("speed=1", "path=rollout"), "no 'speed'"),
        (("threads", "path=rollout"), "is not KEY=VALUE"),
    ],
)
def test_bad_words_are_reported_in_one_line(
    tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    done = mjbench("ab", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
