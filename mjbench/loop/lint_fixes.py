"""Change a script where `mjbench lint` finds what has one safe remedy.

A view that goes into a log gets `.copy()`. A named access is bound to a name before its loop.
Nothing else in the file changes: the changed file is parsed again, and its syntax must be that of
the old one with just these changes.
"""

import ast
import difflib
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import one_line, printable, writing
from mjbench.loop import lint
from mjbench.loop.certain_names import CertainNames
from mjbench.loop.copying import Copying
from mjbench.loop.hoisting import Hoisting, Refusal
from mjbench.loop.lint_rules import NAMED_ACCESS, STORED_VIEW
from mjbench.loop.lint_settings import ALL_CODES, ALL_RULES, RuleChoice
from mjbench.loop.python_source import Program, read_program
from mjbench.loop.script_changes import Changes, changed, lines_of
from mjbench.loop.script_files import UncheckedFile, each_checked
from mjbench.loop.stepping_script import SteppingScript
from mjbench.store import files as stored_files


@dataclass(frozen=True)
class Unfixed:
    """A finding, in the changed file, whose remedy is not certain to be safe there, and why."""

    finding: lint.Finding
    reason: str


@dataclass(frozen=True)
class FixedFile:
    """A file, and what can be changed in it.

    Attributes:
      before: as it is stored.
      after: as it is with all changes; `before` itself where there are none.
      fixed: number of findings that the changes remove.
      findings: that remain, in the order of its lines.
      unfixed: those of them that have a remedy.
    """

    file: str
    before: Program
    after: Program
    fixed: int
    findings: Sequence[lint.Finding]
    unfixed: Sequence[Unfixed]

    def write(self) -> None:
        """Store the changed file in place of the old one.

        Raises:
          MachineError: it cannot be written.
        """
        if self.after is not self.before:
            path = Path(self.file).resolve()  # a link stays a link
            with writing(path), stored_files.replacing(path) as partial:
                partial.write_bytes(self.after.data)

    def diff(self) -> str:
        """Return the changes as a unified diff; those of a notebook, cell by cell."""
        lines: list[str] = []
        for old, new in zip(self.before.parts, self.after.parts, strict=True):
            name = printable(f"{self.file}:cell {old.cell}" if old.cell else self.file)
            lines += difflib.unified_diff(lines_of(old.text), lines_of(new.text), name, name)
        return "".join(
            line if line.endswith(("\n", "\r")) else f"{line}\n\\ No newline at end of file\n"
            for line in lines
        )


def fix_all(
    files: Iterable[str | UncheckedFile], choice: RuleChoice = ALL_RULES
) -> Iterator[FixedFile | UncheckedFile]:
    """Yield what can be changed in each file; in place of one that cannot be checked, why."""
    return each_checked(files, lambda file: [fix(file, choice.codes_for(file))])


def fix(file: str, codes: Collection[str] = ALL_CODES) -> FixedFile:
    """Return what can be changed in a Python file or a notebook; nothing is written.

    Raises:
      InputError: it cannot be read, is neither, or is too large or too deeply nested.
    """
    with lint.refusing_deep_nesting(file):
        before = after = read_program(file)
        changes, refusals = _plan(before, codes)
        if changes.count:
            try:
                after = changed(before, changes)
            except (SyntaxError, ValueError, LookupError) as error:
                refusals += _refusals(changes, one_line(error))
                changes = Changes((), ())
            else:
                _, refusals = _plan(after, codes)
        findings = lint.findings_of(file, after, codes)
        unfixed = list(_unfixed(after, findings, refusals))
        return FixedFile(file, before, after, changes.count, findings, unfixed)


def _refusals(changes: Changes, reason: str) -> list[Refusal]:
    """Return the refusals of all changes, for one reason."""
    calls = (call for hoist in changes.hoists for call in hoist.calls)
    copied = [Refusal(STORED_VIEW, view, reason) for view in changes.copied]
    return [*copied, *(Refusal(NAMED_ACCESS, call, reason) for call in calls)]


def _unfixed(
    program: Program, findings: Sequence[lint.Finding], refusals: Sequence[Refusal]
) -> Iterator[Unfixed]:
    """Yield the findings whose remedy is refused."""
    reasons = {}
    for refusal in refusals:
        line = program.line_of(refusal.node)
        column = line.column(refusal.node.col_offset)
        reasons[refusal.code, line.cell, line.number, column] = refusal.reason
    for finding in findings:
        place = finding.code, finding.cell, finding.line, finding.col
        if place in reasons:
            yield Unfixed(finding, reasons[place])


def _plan(program: Program, codes: Collection[str]) -> tuple[Changes, list[Refusal]]:
    """Return the changes of a program that are safe, and the findings whose remedy may not be."""
    script = SteppingScript(program.tree)
    names = CertainNames(program, script)
    copying = Copying(names)
    copied: list[ast.expr] = []
    calls: list[ast.Call] = []
    refusals = []
    for rule, match in lint.matches(program, script, codes):
        if rule.code == STORED_VIEW:
            assert isinstance(match.node, ast.expr)
            if reason := copying.refusal(match.node):
                refusals.append(Refusal(STORED_VIEW, match.node, reason))
            else:
                copied.append(match.node)
        elif rule.code == NAMED_ACCESS:
            assert isinstance(match.node, ast.Call)
            calls.append(match.node)
    hoists, not_hoisted = Hoisting(names).plan(calls)
    return Changes(copied, hoists), [*refusals, *not_hoisted]
