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
    document = _document(words, cwd)
    earlier = document.read_text() if document and document.is_file() else ""
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
    written = done.stdout
    if document is not None:
        written = document.read_text() if document.is_file() else ""
    if "--json" in words and written and written != earlier:
        check_document(words[0], written)
    return done


def _document(words: tuple[str, ...], cwd: Path) -> Path | None:
    """Return the file that a command is to write its JSON document to, if it is a file."""
    target = words[words.index("--json") + 1] if "--json" in words else "-"
    return None if target == "-" else cwd / target


def check_document(command: str, text: str) -> None:
    """Hold a command's JSON document against its shipped schema; `show` has those of others."""
    schema_file = ROOT / "mjbench/schemas" / f"{command}.json"
    if schema_file.is_file():
        schema = json.loads(schema_file.read_text())
        jsonschema.Draft202012Validator(schema).validate(json.loads(text))
