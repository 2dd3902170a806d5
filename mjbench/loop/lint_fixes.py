"""Change a script where `mjbench lint` finds what has one safe remedy.

A view that is stored gets `.copy()`. Nothing else in the file changes. Notebooks are left alone.
"""

import ast
import re
from collections.abc import Collection
from pathlib import Path

from mjbench.errors import InputError, writing
from mjbench.instrument import files
from mjbench.loop import lint
from mjbench.loop.lint_rules import STORED_VIEW
from mjbench.loop.python_source import NOTEBOOK_SUFFIX, read_program

# The codes of the rules whose findings can be changed.
FIXABLE = (STORED_VIEW,)
_COPY = ".copy()"
_LINES = re.compile(r".*?(?:\r\n|\r|\n|\Z)", re.DOTALL)


def fix(file: str, codes: Collection[str] = lint.ALL_CODES) -> int:
    """Change a Python file; return how many findings it has no more.

    Args:
      file: its name; a notebook is left alone.
      codes: of the rules to check.

    Raises:
      InputError: it cannot be read, or is no Python file.
      MachineError: it cannot be written.
    """
    if file.endswith(NOTEBOOK_SUFFIX):
        return 0
    program = read_program(file)
    nodes = [
        match.node
        for rule, match in lint.matches(program, codes)
        if rule.code in FIXABLE and _ends(match.node) is not None
    ]
    if not nodes:
        return 0
    path = Path(file).resolve()  # a link stays a link
    with path.open(encoding=program.encoding, newline="") as stored:
        text = stored.read()
    changed = _with_copies(text, nodes)
    try:
        ast.parse(changed)
    except (SyntaxError, ValueError) as error:
        raise InputError(f"{file}: cannot be changed safely: {error}") from error
    with writing(path), files.replacing(path) as partial:
        partial.write_bytes(changed.encode(program.encoding))
    return len(nodes)


def _ends(node: ast.expr | ast.stmt) -> tuple[int, int] | None:
    """Return where a node ends, as line and offset in bytes; None where that is not known."""
    if node.end_lineno is None or node.end_col_offset is None:
        return None
    return node.end_lineno, node.end_col_offset


def _with_copies(text: str, nodes: Collection[ast.expr | ast.stmt]) -> str:
    """Return a text with a call of `copy` behind each node."""
    lines = [line.encode() for line in _LINES.findall(text)]
    places = {place for node in nodes if (place := _ends(node)) is not None}
    for number, offset in sorted(places, reverse=True):  # from the end: places before stay
        line = lines[number - 1]
        lines[number - 1] = line[:offset] + _COPY.encode() + line[offset:]
    return b"".join(lines).decode()
