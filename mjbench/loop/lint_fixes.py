"""Change a script where `mjbench lint` finds what has one safe remedy.

A view that goes into a log gets `.copy()`. A named access is bound to a name before its loop.
Every byte outside the changed expressions and the new lines stays. The changed file is parsed
again, and its syntax must be that of the old one with just these changes.
"""

import ast
import copy
import difflib
import re
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line, printable, writing
from mjbench.host import files
from mjbench.loop import lint
from mjbench.loop.lint_certain_names import CertainNames
from mjbench.loop.lint_fix_copies import Copying
from mjbench.loop.lint_fix_hoisting import Hoist, Hoisting
from mjbench.loop.lint_rule import Match, Rule
from mjbench.loop.lint_rules import NAMED_ACCESS, STORED_VIEW
from mjbench.loop.lint_settings import ALL_CODES, ALL_RULES, RuleChoice
from mjbench.loop.notebook import NotebookPart
from mjbench.loop.python_source import PythonProgram, read_program
from mjbench.loop.script_files import UncheckedFile
from mjbench.loop.stepping_script import SteppingScript

_LINE = re.compile(r".*?(?:\r\n|\r|\n|\Z)", re.DOTALL)
_LINE_END = re.compile(rb"\r\n|\r|\n")
_OF_IDENTIFIER = re.compile(rb"[\w\x80-\xff]")


@dataclass(frozen=True)
class _Plan:
    """What breaks rules in a program, and what to change.

    Attributes:
      copied: expressions that get `.copy()`.
      refusals: why a remedy is not certain to be safe, by the node that breaks a rule: in one
        sentence without its full stop.
    """

    matches: Sequence[tuple[Rule, Match]]
    copied: Sequence[ast.expr]
    hoists: Sequence[Hoist]
    refusals: Mapping[ast.AST, str]

    @property
    def changed(self) -> Sequence[ast.expr]:
        return [*self.copied, *(call for hoist in self.hoists for call in hoist.calls)]


@dataclass(frozen=True)
class Unfixed:
    """A finding, in the changed file, whose remedy is not certain to be safe there, and why."""

    finding: lint.Finding
    reason: str


@dataclass(frozen=True)
class LintedFile:
    """A file, what lint finds in it, and what can be changed in it.

    Attributes:
      after: as it is with all changes; `before` itself where there are none.
      unfixed: those of them that have a remedy.
      problem: why the file could not be written; empty where it could, or was not to be.
    """

    file: str
    before: PythonProgram
    after: PythonProgram
    fixed: int
    findings: Sequence[lint.Finding]
    unfixed: Sequence[Unfixed]
    problem: str = ""

    @classmethod
    def unchanged(
        cls, file: str, program: PythonProgram, codes: Collection[str], problem: str = ""
    ) -> "LintedFile":
        return cls(file, program, program, 0, lint.findings_of(file, program, codes), (), problem)

    def write(self) -> None:
        """Store the changed file in place of the old one; MachineError if that fails."""
        if self.after is not self.before:
            path = Path(self.file).resolve()  # a link stays a link
            with writing(path), files.replacing(path) as partial:
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


def lint_all(
    files: Iterable[str | UncheckedFile],
    choice: RuleChoice = ALL_RULES,
    fixes: bool = False,
    writes: bool = False,
) -> Iterator[LintedFile | UncheckedFile]:
    """Yield the findings of each file, with `fixes` also their changes; or why it is unchecked."""
    for file in files:
        if isinstance(file, UncheckedFile):
            yield file
            continue
        try:
            codes = choice.codes_for(file)
            linted = (fix if fixes else _check)(file, codes)
        except InputError as error:
            yield UncheckedFile(file, str(error).removeprefix(f"{file}: "))
            continue
        if writes:
            try:
                linted.write()
            except MachineError as error:
                linted = LintedFile.unchanged(file, linted.before, codes, str(error))
        yield linted


def _check(file: str, codes: Collection[str]) -> LintedFile:
    with lint.refusing_deep_nesting(file):
        return LintedFile.unchanged(file, read_program(file), codes)


def fix(file: str, codes: Collection[str] = ALL_CODES) -> LintedFile:
    """Return what can be changed in a Python file or a notebook; nothing is written."""
    with lint.refusing_deep_nesting(file):
        before = after = read_program(file)
        plan = _plan(before, codes)
        fixed = plan.changed
        if fixed:
            try:
                after = _changed(before, plan)
            except (SyntaxError, ValueError, LookupError) as error:
                failed: dict[ast.AST, str] = dict.fromkeys(fixed, one_line(error))
                plan, fixed = replace(plan, refusals={**plan.refusals, **failed}), []
            else:
                plan = _plan(after, codes)
        findings = [lint.finding_of(file, after, rule, match) for rule, match in plan.matches]
        unfixed = [
            Unfixed(finding, plan.refusals[match.node])
            for finding, (_, match) in zip(findings, plan.matches, strict=True)
            if match.node in plan.refusals
        ]
        return LintedFile(file, before, after, len(fixed), findings, unfixed)


def _plan(program: PythonProgram, codes: Collection[str]) -> _Plan:
    script = SteppingScript(program.tree)
    names = CertainNames(program, script)
    copying = Copying(names)
    matches = lint.matches(program, script, codes)
    copied: list[ast.expr] = []
    calls: list[ast.Call] = []
    refusals: dict[ast.AST, str] = {}
    for rule, match in matches:
        if rule.code == STORED_VIEW:
            assert isinstance(match.node, ast.expr)
            if reason := copying.refusal(match.node):
                refusals[match.node] = reason
            else:
                copied.append(match.node)
        elif rule.code == NAMED_ACCESS:
            assert isinstance(match.node, ast.Call)
            calls.append(match.node)
    hoists, not_hoisted = Hoisting(names).plan(calls)
    return _Plan(matches, copied, hoists, refusals | not_hoisted)


# Bytes of the text of a part that are replaced: from the first number to the second, without it.
_Edit = tuple[int, int, bytes]


class _PartText:
    def __init__(self, program: PythonProgram, part: NotebookPart):
        lines = [line.encode() for line in lines_of(part.text)]
        self.data = b"".join(lines)
        self._program = program
        self._starts = [0, *accumulate(map(len, lines))]

    def start(self, node: ast.expr | ast.stmt) -> int:
        return self._starts[self._program.line_of(node).number - 1] + node.col_offset

    def end(self, node: ast.expr | ast.stmt) -> int:
        assert node.end_lineno is not None  # the parser sets both
        assert node.end_col_offset is not None
        line = self._program.lines[node.end_lineno - 1]
        return self._starts[line.number - 1] + node.end_col_offset

    def replacing(self, call: ast.Call, name: str) -> _Edit:
        start, end = self.start(call), self.end(call)
        before, after = self.data[start - 1 : start], self.data[end : end + 1]
        text = name.encode()
        if _OF_IDENTIFIER.match(before):  # `return(data).joint("hip")`
            text = b" " + text
        if _OF_IDENTIFIER.match(after):
            text += b" "
        return start, end, text

    def binding(self, hoist: Hoist) -> _Edit:
        """Return the edit that binds a name on a line before the loop, which has its own lines."""
        first = hoist.calls[0]
        source = self.data[self.start(first) : self.end(first)]
        if _LINE_END.search(source):
            source = ast.unparse(first).encode()
        loop = self.start(hoist.loop)
        line = self._starts[bisect_right(self._starts, loop) - 1]
        indent, before = self.data[line:loop], self.data[:line].rstrip(b"\r\n")
        if indent.strip() or (line and before.endswith(b"\\")):
            raise ValueError("the loop does not stand on lines of its own")
        before_loop = self.data[max(line - 2, 0) : line]
        end = _LINE_END.search(self.data, loop) or _LINE_END.search(before_loop)
        line_end = end[0] if end else b"\n"
        return line, line, indent + hoist.name.encode() + b" = " + source + line_end

    def edited(self, edits: Sequence[_Edit]) -> str:
        pieces, behind = [], 0
        for start, end, text in sorted(edits, key=lambda edit: edit[0]):
            pieces += [self.data[behind:start], text]
            behind = end
        return b"".join([*pieces, self.data[behind:]]).decode()


def lines_of(text: str) -> list[str]:
    return [line for line in _LINE.findall(text) if line]


def _changed(program: PythonProgram, plan: _Plan) -> PythonProgram:
    """Return a program after changes.

    Raises:
      SyntaxError, ValueError, LookupError: they cannot be applied, or would change anything else.
    """
    try:
        copies: dict[int, Any] = {}
        tree = copy.deepcopy(program.tree, copies)
        expected = ast.dump(_Transformer(plan, copies).visit(tree))
        result = program.with_texts([_edited(program, part, plan) for part in program.parts])
        actual = ast.dump(result.tree)
    except (RecursionError, MemoryError) as error:
        raise ValueError("it is nested too deeply, or too large") from error
    if actual != expected:
        raise ValueError("the changed script would be another program")
    return result


def _edited(program: PythonProgram, part: NotebookPart, plan: _Plan) -> str:
    text = _PartText(program, part)
    in_part = [view for view in plan.copied if program.line_of(view).cell == part.cell]
    edits = [(text.end(view), text.end(view), b".copy()") for view in in_part]
    for hoist in plan.hoists:
        if program.line_of(hoist.loop).cell == part.cell:
            edits.append(text.binding(hoist))
            edits += [text.replacing(call, hoist.name) for call in hoist.calls]
    return text.edited(edits)


class _Transformer(ast.NodeTransformer):
    def __init__(self, plan: _Plan, copies: Mapping[int, Any]):
        self._copied = {copies[id(view)] for view in plan.copied}
        self._names = {copies[id(c)]: hoist.name for hoist in plan.hoists for c in hoist.calls}
        self._hoists: defaultdict[ast.AST, list[Hoist]] = defaultdict(list)
        for hoist in plan.hoists:
            self._hoists[copies[id(hoist.loop)]].append(hoist)

    def visit(self, node: ast.AST) -> Any:
        if node in self._names:
            return ast.Name(self._names[node], ast.Load())
        self.generic_visit(node)
        if node in self._copied:
            assert isinstance(node, ast.expr)
            return ast.Call(ast.Attribute(node, "copy", ast.Load()), [], [])
        bindings = [
            ast.Assign([ast.Name(hoist.name, ast.Store())], hoist.calls[0])
            for hoist in self._hoists.get(node, ())
        ]
        return [*bindings, node] if bindings else node
