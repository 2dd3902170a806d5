"""Lint a text."""

import tempfile
import textwrap
from pathlib import Path

from mjbench.commands.lint import check as lint

HEAD = "import copy, functools, threading\nimport mujoco\nimport numpy as np\n"


def check(text: str) -> list[lint.Finding]:
    """Return the findings of a script."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "script.py")
        file.write_text(textwrap.dedent(text))
        return lint.check(str(file))


def findings(text: str, *codes: str) -> list[lint.Finding]:
    """Return the findings of a script that begins with usual imports, of some rules or all."""
    return [f for f in check(HEAD + textwrap.dedent(text)) if not codes or f.code in codes]


def places(text: str, *codes: str) -> list[tuple[str, str]]:
    """Return the code of each finding, and its line without what surrounds it."""
    lines = (HEAD + textwrap.dedent(text)).splitlines()
    return [(f.code, lines[f.line - 1].strip()) for f in findings(text, *codes)]
