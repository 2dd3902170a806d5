"""Run `mjbench` as a user types it, in this process or in one of its own."""

import contextlib
import functools
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from unittest import mock

from click.testing import CliRunner

TESTS = Path(__file__).parent
ROOT = TESTS.parent
PYTHONPATH = f"{ROOT}{os.pathsep}{TESTS}"

Completed = subprocess.CompletedProcess[str]


def mjbench(*words: str, cwd: Path = ROOT, env: Mapping[str, str] | None = None) -> Completed:
    """Return how a command ended that ran in this process; what it starts has `env`, too."""

    def invoke() -> Completed:
        from mjbench.cli import cli

        path = os.pathsep.join(filter(None, (PYTHONPATH, os.environ.get("PYTHONPATH"))))
        variables = {"PYTHONPATH": path, **(env or {})}
        with contextlib.chdir(cwd), mock.patch.dict(os.environ, variables):
            result = CliRunner().invoke(cli, words, prog_name="mjbench")
        if not isinstance(result.exception, SystemExit | None):
            raise result.exception
        return Completed(words, result.exit_code, result.stdout, result.stderr)

    return _without_traceback(invoke())


def mjbench_process(
    *words: str,
    cwd: Path = ROOT,
    env: Mapping[str, str] | None = None,
    preexec_fn: Callable[[], None] | None = None,
) -> Completed:
    """Return how a command ended that ran in a process of its own; `env` is added to this one's."""
    run = functools.partial(
        subprocess.run,
        [sys.executable, "-m", "mjbench", *words],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": PYTHONPATH, **(env or {})},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        preexec_fn=preexec_fn,
    )
    return _without_traceback(run())


def _without_traceback(done: Completed) -> Completed:
    assert "Traceback" not in done.stdout + done.stderr
    return done


def load_example(name: str) -> ModuleType:
    """Return a program of docs/examples as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"docs/examples/{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
