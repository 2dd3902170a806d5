"""Run pytest on a file of tests in a project of its own, with the fixture `mjbench`."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from commands import ROOT

BENCHMARK, PLUGIN = "pytest_benchmark.plugin", "mjbench.testing"


def run_pytest(
    folder: Path,
    content: str,
    *arguments: str,
    plugins: tuple[str, ...] = (BENCHMARK, PLUGIN),
    env: Mapping[str, str] | None = None,
) -> "subprocess.CompletedProcess[str]":
    """Return how pytest ended on a file of tests."""
    (folder / "test_speed.py").write_text(content)
    loaded = [option for plugin in plugins for option in ("-p", plugin)]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rs", *loaded, *arguments, "test_speed.py"],
        cwd=folder,
        env={
            **{name: value for name, value in os.environ.items() if "PYTEST" not in name},
            "PYTHONPATH": str(ROOT),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            **(env or {}),
        },
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
