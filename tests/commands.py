"""Run `mjbench` as a user types it, in a process of its own.

Every JSON document that a test has a command write is held against the shipped schema.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import jsonschema

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
    _check_document(words, cwd, done.stdout)
    return done


def _check_document(words: tuple[str, ...], cwd: Path, stdout: str) -> None:
    """Hold the JSON document of a command, where it wrote one, against its shipped schema."""
    schema_file = ROOT / "mjbench/schemas" / f"{words[0]}.json"
    if "--json" not in words or not schema_file.is_file():
        return
    target = words[words.index("--json") + 1]
    text = stdout if target == "-" else ""
    if target != "-" and (cwd / target).is_file():
        text = (cwd / target).read_text()
    if text:
        schema = json.loads(schema_file.read_text())
        jsonschema.Draft202012Validator(schema).validate(json.loads(text))
