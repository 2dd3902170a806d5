"""Run `mjbench` as a user types it, in this process or in one of its own.

Every JSON document that a test has a command write is held against its type.
"""

import contextlib
import functools
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from unittest import mock

import msgspec
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

    return _checked(words, cwd, invoke)


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
    return _checked(words, cwd, run)


def _checked(words: tuple[str, ...], cwd: Path, run: Callable[[], Completed]) -> Completed:
    """Run a command; hold what it printed and wrote against what every command keeps to."""
    document = _document(words, cwd)
    earlier = document.read_text() if document and document.is_file() else ""
    done = run()
    assert "Traceback" not in done.stdout + done.stderr
    written = done.stdout
    if document is not None:
        written = document.read_text() if document.is_file() else ""
    if "--json" in words and written and written != earlier:
        check_document(_kind(words), written)
    return done


def _document(words: tuple[str, ...], cwd: Path) -> Path | None:
    """Return the file that a command is to write its JSON document to, if it is a file."""
    target = words[words.index("--json") + 1] if "--json" in words else "-"
    return None if target == "-" else cwd / target


def _kind(words: Sequence[str]) -> str:
    """Return the name of the document that a command line writes."""
    from mjbench.command_names import command_of
    from mjbench.report.kinds import DOCUMENTS

    for name in DOCUMENTS:
        command, _, mode = command_of(name).partition(" ")
        if mode and words[0] == command and mode in words:
            return name
    return words[0]


def check_document(command: str, text: str) -> None:
    """Hold a command's JSON document against its type; `show` has those of others."""
    from mjbench.report.kinds import DOCUMENTS
    from mjbench.store.json_form import json_type

    if command in DOCUMENTS:
        msgspec.convert(json.loads(text), json_type(DOCUMENTS[command]))
