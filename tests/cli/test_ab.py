"""`mjbench ab`: findings that fail the command, and targets that mean nothing."""

from pathlib import Path

import pytest
from commands import mjbench


def test_changed_work_can_fail_the_command(tmp_path: Path) -> None:
    arguments = ("ab", "cube_table", "iterations=1,solver=cg", "--budget", "0.2s")
    assert mjbench(*arguments, "--fail-on", "changed-work", cwd=tmp_path).returncode == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("cartpole,path=nothing", "path=rollout"), "no path 'nothing'"),
        (("cartpole,speed=1", "path=rollout"), "no 'speed'"),
        (("threads", "path=rollout"), "no model 'threads'"),
        (("path=rollout", "solver=cg"), "name a model, one of cartpole, "),
        (("cartpole", "solver=cg", "--fail-on", ""), "is not one of slower, faster"),
        (("cartpole,path=rollout,threads=100000", ""), "at most 1024"),
        (("3.4.0", "3.5.0"), "a release is release=3.4.0"),
        (("pile", "solver=cg", "--metric", "instructions"), "without solver: leave out solver"),
        (("pile", "cloth", "--own-files"), "--own-files is for functions: name one"),
        (("pile", "cloth", "--metric", "compile"), "is of paths that compile only"),
    ],
)
def test_bad_arguments_are_reported_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = mjbench("ab", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
