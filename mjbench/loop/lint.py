"""Find in a user's script what makes a stepping loop slow or its log wrong; nothing is executed.

The rules are in lint_rules.py; stepping_script.py knows the script that they look at.
"""

import ast
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mjbench.errors import InputError, one_line
from mjbench.loop.lint_rules import RULES
from mjbench.loop.stepping_script import SteppingScript


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
      file: its name, as given.
      line: from 1.
      col: from 1.
      code: of the rule.
      message: of the rule.
      ns_per_step: about what it costs in each step; None where the rule is not about time.
    """

    file: str
    line: int
    col: int
    code: str
    message: str
    ns_per_step: float | None


def check(file: str) -> list[Finding]:
    """Return the findings of a Python file, in the order of its lines.

    Raises:
      InputError: it cannot be read, or is not Python.
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
        tree = ast.parse(text)
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{file}: {one_line(error)}") from error
    script = SteppingScript(tree)
    lines = re.split(r"\r\n|\r|\n", text)  # as ast counts them
    findings = {}  # by place and rule: nested loops match the same node twice
    for rule in RULES:
        for match in rule.matches(script):
            place = (match.node.lineno, match.node.col_offset + 1)
            findings[*place, rule.code] = Finding(
                file, *place, rule.code, rule.message, costs_ns().get(match.habit)
            )
    return [
        finding
        for _, finding in sorted(findings.items())
        if not _is_suppressed(lines[finding.line - 1], finding.code)
    ]


def python_files(names: Sequence[str]) -> list[str]:
    """Return the files that are named, and all Python files below the folders that are.

    Raises:
      InputError: no such file.
    """
    files = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            files += sorted(str(p) for p in path.rglob("*.py"))
        elif path.is_file():
            files.append(name)
        else:
            raise InputError(f"no such file: {name}")
    return files


@cache
def costs_ns() -> dict[str, float]:
    """Return about how many ns each habit adds to a step, by the stored overhead table.

    `mjbench overhead cartpole --json mjbench/loop/overhead.json` wrote the table on the machine
    that it names; on another machine, take the order of magnitude from it.
    """
    stored = Path(__file__).with_name("overhead.json")
    if not stored.is_file():
        return {}
    (row,) = json.loads(stored.read_text(encoding="utf-8"))["results"]
    return {cost["source"]: cost["ns"] for cost in row["costs"]}


def _is_suppressed(line: str, code: str) -> bool:
    """Return whether a line has a `# noqa` comment without codes, or with this one."""
    noqa = re.search(r"#\s*noqa\b(?::\s*([\w, ]+))?", line, flags=re.IGNORECASE)
    if noqa is None:
        return False
    return noqa[1] is None or code in re.split(r"[,\s]+", noqa[1].upper())
