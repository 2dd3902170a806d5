"""Run `mjbench` as a user types it, in this process or in one of its own."""

import contextlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any
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


def mjbench_process(*words: str, **options: Any) -> Completed:
    """Return how a command ended that ran in a process of its own."""
    return _without_traceback(python("-m", "mjbench", *words, **options))


def python(*arguments: str, **options: Any) -> Completed:
    """Return how Python ended in a process of its own; see `_of_python`."""
    return subprocess.run(check=False, timeout=300, **_of_python(arguments, **options))


def started(*arguments: str, **options: Any) -> "subprocess.Popen[str]":
    """Return a process of Python that has started; see `_of_python`."""
    return subprocess.Popen(**_of_python(arguments, **options))


def _of_python(
    arguments: Sequence[str],
    cwd: Path = ROOT,
    env: Mapping[str, str] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Return how to start a Python that finds mjbench; `env` is added to this process's."""
    return {
        "args": [sys.executable, *arguments],
        "cwd": cwd,
        "env": {**os.environ, "PYTHONPATH": PYTHONPATH, **(env or {})},
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "text": True,
        **options,
    }


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
