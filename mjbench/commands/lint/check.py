"""Find in a user's script what makes a stepping loop slow or its log wrong; nothing is executed.

The rules are in rules.py; stepping_script.py describes a script to them.
"""

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.commands.lint.python_source import PythonProgram, read_program
from mjbench.commands.lint.rule import Match, Rule
from mjbench.commands.lint.rules import RULES
from mjbench.commands.lint.script_files import UncheckedFile
from mjbench.commands.lint.settings import ALL_CODES, RuleChoice
from mjbench.commands.lint.stepping_script import SteppingScript
from mjbench.errors import InputError


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
      file: its name, as given.
      line: from 1.
      col: from 1, in characters.
      code: of the rule.
      message: what is wrong, and what to write instead.
      ns_per_step: about what it costs in each step; None where the rule is not about time.
      instead: functions of the engine, called with the model and the MjData, that do enough in the
        place of what is called; none where the call moves out of the loop or is deleted.
      is_wrong_result: whether the program computes or records something else than it says.
      last_line: of a finding about several lines, such as a loop over contacts; None for one line.
    """

    file: str
    line: NonNegativeInt
    col: NonNegativeInt
    code: str
    message: str
    ns_per_step: NonNegativeFloat | None
    instead: tuple[str, ...] = ()
    is_wrong_result: bool = False
    last_line: NonNegativeInt | None = None


def check_all(
    files: Iterable[str | UncheckedFile], choice: RuleChoice
) -> Iterator[Sequence[Finding] | UncheckedFile]:
    """Yield the findings of each file, or why it is unchecked."""
    for file in files:
        if isinstance(file, UncheckedFile):
            yield file
            continue
        try:
            yield check(file, choice.codes_for(file))
        except InputError as error:
            yield UncheckedFile(file, str(error).removeprefix(f"{file}: "))


def check(file: str, codes: Collection[str] = ALL_CODES) -> list[Finding]:
    """Return the findings of a file in the order of its lines; InputError if it is unfit."""
    try:
        program = read_program(file)
        of_rules = matches(program, SteppingScript(program.tree), codes)
        return [_finding(file, program, rule, match) for rule, match in of_rules]
    except (RecursionError, MemoryError) as error:
        raise InputError(
            f"{file}: nested too deeply, or too large, for Python's parser or for lint"
        ) from error


def _finding(file: str, program: PythonProgram, rule: Rule, match: Match) -> Finding:
    message = match.message or rule.message
    if isinstance(match.loop, ast.FunctionDef):
        message += f"; {match.loop.name}() in line {match.loop.lineno} calls this"
    elif match.loop is not None:
        message += f"; the loop in line {match.loop.lineno} calls this in every iteration"
    return Finding(
        file=file,
        line=match.node.lineno,
        col=program.column_of(match.node),
        code=rule.code,
        message=message,
        ns_per_step=match.ns_per_step,
        instead=match.instead,
        is_wrong_result=rule.is_wrong_result,
        last_line=match.node.end_lineno if match.node.end_lineno != match.node.lineno else None,
    )


def matches(
    program: PythonProgram, script: SteppingScript, codes: Collection[str] = ALL_CODES
) -> list[tuple[Rule, Match]]:
    """Return what breaks rules in a program and is not suppressed, in the order of its lines."""
    by_place = {}  # and rule: nested loops match the same node twice
    for rule in RULES:
        for match in rule.matches(script) if rule.code in codes else ():
            if not _is_suppressed(program.line_of(match.node), rule.code):
                place = (match.node.lineno, match.node.col_offset, rule.code)
                by_place[place] = rule, match
    return [by_place[place] for place in sorted(by_place)]


def _is_suppressed(line: str, code: str) -> bool:
    """Return whether a line has a `# noqa` comment without codes, or with this one."""
    noqa = re.search(r"#\s*noqa\b(?::\s*([\w, ]+))?", line, flags=re.IGNORECASE)
    return noqa is not None and (noqa[1] is None or code in re.split(r"[,\s]+", noqa[1].upper()))
