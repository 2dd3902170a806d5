"""The blocks of docs/guides/code.md run on the release that each one names."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ROOT

from mjbench.errors import MachineError
from mjbench.releases import installs
from mjbench.releases.release_names import parse_release

PAGE = ROOT / "docs/guides/code.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), flags=re.M | re.S)


def first_line(block: str) -> str:
    return block.partition("\n")[0]


@pytest.mark.parametrize("block", BLOCKS, ids=first_line)
def test_a_block_runs_on_the_release_that_it_names(block: str, tmp_path: Path) -> None:
    """On the installed release with MJX, which has no install of its own."""
    (release,) = re.findall(r"^# MuJoCo ([\d.]+)(?: and mujoco-mjx)?$", first_line(block))
    folders = [str(ROOT)]
    if "mjx" in first_line(block):
        pytest.importorskip("mujoco.mjx")
    else:
        try:
            folders.insert(0, str(installs.install(parse_release(release))))
        except MachineError as error:
            pytest.skip(str(error))
    (tmp_path / "robot.xml").symlink_to(ROOT / "models/cartpole.xml")
    (tmp_path / "block.py").write_text(block)
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run(
        [sys.executable, "block.py"], cwd=tmp_path, env=variables, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
