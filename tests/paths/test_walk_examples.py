"""The two programs of docs/guides/story.md: the search is the same in Gymnasium and by a batch."""

import re
import subprocess
import sys

import pytest
from commands import ROOT


def test_the_search_by_a_batch_has_the_scores_of_the_one_in_gymnasium() -> None:
    pytest.importorskip("gymnasium")
    pytest.importorskip("mujoco.batch")
    scores = [
        re.findall(r"best score (\S+),", _run(f"walk_{name}.py")) for name in ("env", "batch")
    ]
    assert len(scores[0]) == 1
    assert scores[0] == scores[1]


def _run(program: str) -> str:
    command = [sys.executable, program, "--generations", "1"]
    folder = ROOT / "docs/examples"
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout
