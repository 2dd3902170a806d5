"""Find in a user's script what makes a stepping loop slow or its log wrong; nothing is executed.

The rules are in lint_rules.py; stepping_script.py describes a script to them.
"""

import contextlib
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.errors import InputError
from mjbench.loop.lint_rule import Match, Rule
from mjbench.loop.lint_rules import RULES
from mjbench.loop.lint_settings import ALL_CODES
from mjbench.loop.python_source import PythonProgram, read_program
from mjbench.loop.stepping_script import SteppingScript


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
      file: its name, as given.
      line: from 1; of the cell, in a notebook.
      col: from 1, in characters.
      code: of the rule.
      message: what is wrong, and what to write instead.
      ns_per_step: about what it costs in each step; None where the rule is not about time.
      cell: of a notebook, from 1; None in a Python file.
      callee: what is called there, such as "mj_forward"; empty where the rule is not about a call.
      instead: functions of the engine, called with the model and the MjData, that do enough in the
        place of the callee; none where the call moves out of the loop or is deleted.
      is_wrong_result: whether the program computes or records something else than it says.
    """

    file: str
    line: NonNegativeInt
    col: NonNegativeInt
    code: str
    message: str
    ns_per_step: NonNegativeFloat | None
    cell: NonNegativeInt | None
    callee: str = ""
    instead: tuple[str, ...] = ()
    is_wrong_result: bool = False


def check(file: str, codes: Collection[str] = ALL_CODES) -> list[Finding]:
    """Return the findings of a file in the order of its lines; InputError if it is unfit."""
    with refusing_deep_nesting(file):
        return findings_of(file, read_program(file), codes)


@contextlib.contextmanager
def refusing_deep_nesting(file: str) -> Iterator[None]:
    """Turn what a parser or a rule raises for a file that is too deep or large into InputError."""
    try:
        yield
    except (RecursionError, MemoryError) as error:
        raise InputError(
            f"{file}: nested too deeply, or too large, for Python's parser or for lint"
        ) from error


def findings_of(file: str, program: PythonProgram, codes: Collection[str]) -> list[Finding]:
    of_rules = matches(program, SteppingScript(program.tree), codes)
    return [finding_of(file, program, rule, match) for rule, match in of_rules]


def finding_of(file: str, program: PythonProgram, rule: Rule, match: Match) -> Finding:
    line = program.line_of(match.node)
    message = match.message or rule.message
    if match.loop is not None:
        place = program.line_of(match.loop).place
        message += f"; the loop in {place} calls this in every iteration"
    return Finding(
        file=file,
        line=line.number,
        col=line.column(match.node.col_offset),
        code=rule.code,
        message=message,
        ns_per_step=match.ns_per_step,
        cell=line.cell,
        callee=match.callee,
        instead=match.instead,
        is_wrong_result=rule.is_wrong_result,
    )


def matches(
    program: PythonProgram, script: SteppingScript, codes: Collection[str] = ALL_CODES
) -> list[tuple[Rule, Match]]:
    """Return what breaks rules in a program and is not suppressed, in the order of its lines."""
    by_place = {}  # and rule: nested loops match the same node twice
    for rule in RULES:
        for match in rule.matches(script) if rule.code in codes else ():
            if not _is_suppressed(program.line_of(match.node).text, rule.code):
                place = (match.node.lineno, match.node.col_offset, rule.code)
                by_place[place] = rule, match
    return [by_place[place] for place in sorted(by_place)]


def _is_suppressed(line: str, code: str) -> bool:
    """Return whether a line has a `# noqa` comment without codes, or with this one."""
    noqa = re.search(r"#\s*noqa\b(?::\s*([\w, ]+))?", line, flags=re.IGNORECASE)
    return noqa is not None and (noqa[1] is None or code in re.split(r"[,\s]+", noqa[1].upper()))
