"""The lab's logic, under Node."""

import shutil
import subprocess
from pathlib import Path

import pytest

TESTS = Path(__file__).with_name("lab_modules.mjs")


def test_the_modules_do_what_they_say() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node.js")
    done = subprocess.run([node, "--test", TESTS], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
