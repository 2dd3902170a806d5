"""Lint a text."""

import textwrap
from pathlib import Path

from mjbench.commands.lint import check as lint

HEAD = "import copy, functools, threading\nimport mujoco\nimport numpy as np\n"


def findings(tmp_path: Path, text: str, *codes: str) -> list[lint.Finding]:
    """Return the findings of a script that begins with usual imports, of some rules or all."""
    file = tmp_path / "script.py"
    file.write_text(HEAD + textwrap.dedent(text))
    return [f for f in lint.check(str(file)) if not codes or f.code in codes]


def places(tmp_path: Path, text: str, *codes: str) -> list[tuple[str, str]]:
    """Return the code of each finding, and its line without what surrounds it."""
    lines = (HEAD + textwrap.dedent(text)).splitlines()
    return [(f.code, lines[f.line - 1].strip()) for f in findings(tmp_path, text, *codes)]
