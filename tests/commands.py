"""Run `mjbench` as a user types it, in a process of its own."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
PYTHONPATH = f"{ROOT}{os.pathsep}{TESTS}"


def mjbench(
    *words: str,
    cwd: Path = ROOT,
    env: Mapping[str, str] | None = None,
    preexec_fn: Callable[[], None] | None = None,
) -> "subprocess.CompletedProcess[str]":
    """Return how a command ended; `env` is added to this process's environment."""
    done = subprocess.run(
        [sys.executable, "-m", "mjbench", *words],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, **(env or {})},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        preexec_fn=preexec_fn,
    )
    assert "Traceback" not in done.stdout + done.stderr
    return done
