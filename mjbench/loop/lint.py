"""Find in a user's script what makes a stepping loop slow or its log wrong; nothing is executed.

The rules are in lint_rules.py; stepping_script.py knows the script that they look at.
"""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mjbench.errors import InputError
from mjbench.loop.lint_rules import RULES
from mjbench.loop.python_source import Program, read_program
from mjbench.loop.script_files import UncheckedFile
from mjbench.loop.stepping_script import SteppingScript


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
      file: its name, as given.
      line: from 1; of the cell, in a notebook.
      col: from 1, in characters.
      code: of the rule.
      message: of the rule.
      ns_per_step: about what it costs in each step; None where the rule is not about time.
      cell: of a notebook, from 1; None in a Python file.
    """

    file: str
    line: int
    col: int
    code: str
    message: str
    ns_per_step: float | None
    cell: int | None


def check(file: str) -> list[Finding]:
    """Return the findings of a Python file or a notebook, in the order of its lines.

    Raises:
      InputError: it cannot be read, is neither, or is too large or too deeply nested.
    """
    try:
        return _findings(file, read_program(file))
    except (RecursionError, MemoryError) as error:
        raise InputError(
            f"{file}: nested too deeply, or too large, for Python's parser or for lint"
        ) from error


def check_all(files: Iterable[str | UncheckedFile]) -> Iterator[Finding | UncheckedFile]:
    """Yield the findings of all files in turn; in place of those of a file, why it has none."""
    for file in files:
        if isinstance(file, UncheckedFile):
            yield file
            continue
        try:
            yield from check(file)
        except InputError as error:
            yield UncheckedFile.of(file, error)


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


def _findings(file: str, program: Program) -> list[Finding]:
    script = SteppingScript(program.tree)
    findings = {}  # by place and rule: nested loops match the same node twice
    for rule in RULES:
        for match in rule.matches(script):
            line = program.line_of(match.node)
            if _is_suppressed(line.text, rule.code):
                continue
            place = (match.node.lineno, match.node.col_offset, rule.code)
            findings[place] = Finding(
                file=file,
                line=line.number,
                col=line.column(match.node.col_offset),
                code=rule.code,
                message=rule.message,
                ns_per_step=costs_ns().get(match.habit),
                cell=line.cell,
            )
    return [finding for _, finding in sorted(findings.items())]


def _is_suppressed(line: str, code: str) -> bool:
    """Return whether a line has a `# noqa` comment without codes, or with this one."""
    noqa = re.search(r"#\s*noqa\b(?::\s*([\w, ]+))?", line, flags=re.IGNORECASE)
    if noqa is None:
        return False
    return noqa[1] is None or code in re.split(r"[,\s]+", noqa[1].upper())
