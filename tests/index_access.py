"""Whether pip reaches a package index: tests that install a release skip without one."""

import subprocess
import sys


def index_has_mujoco() -> bool:
    """Return whether pip reaches a package index, asked by pip alone."""
    command = [sys.executable, "-m", "pip", "--retries=0", "index", "versions", "mujoco"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
