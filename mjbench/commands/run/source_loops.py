"""The loops of Python files: which lines belong to which outermost loop."""

import ast
import tokenize
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

from mjbench.bounds import NonNegativeInt
from mjbench.commands.run.hook import file_owners

_LOOPS = (
    ast.For,
    ast.AsyncFor,
    ast.While,
    ast.ListComp,
    ast.SetComp,
    ast.DictComp,
    ast.GeneratorExp,
)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
# Larger files are generated; nobody's loop is in them.
_MAX_BYTES = 5_000_000


@dataclass(frozen=True)
class SourceLoop:
    """A loop of a Python file.

    Attributes:
      file: path of the file.
      first: its first line, from 1.
      last: its last line.
    """

    file: str
    first: NonNegativeInt
    last: NonNegativeInt

    def holds(self, position: tuple[str, int]) -> bool:
        file, line = position
        return file == self.file and self.first <= line <= self.last


def outermost_loop(file: str, line: int) -> SourceLoop | None:
    holding = [loop for loop in _loops(file) if loop.first <= line <= loop.last]
    return min(holding, key=lambda loop: (loop.first, -loop.last)) if holding else None


@cache
def function_around(file: str, line: int) -> SourceLoop | None:
    """Return the innermost function that holds a line, as what repeats it."""
    functions = (node for node in ast.walk(_tree(file)) if isinstance(node, _FUNCTIONS))
    holding = [
        SourceLoop(file, node.lineno, node.end_lineno or node.lineno)
        for node in functions
        if node.lineno <= line <= (node.end_lineno or node.lineno)
    ]
    return min(holding, key=lambda function: function.last - function.first, default=None)


def program_loop(lines: Sequence[tuple[str, int]]) -> tuple[SourceLoop, int] | None:
    """Return the outermost loop that a stack runs, and the number of its line on the stack.

    A loop of a package is named by the user's line that calls it, if there is one. Loops of
    Python's standard library are not meant: they start threads and processes. Nor are mjbench's.

    Args:
      lines: file and number, the outermost first.
    """
    caller: tuple[SourceLoop, int] | None = None
    for i, (file, line) in enumerate(lines):
        if not file_owners.is_of_program(file):
            continue
        is_own, loop = file_owners.is_own(file), outermost_loop(file, line)
        if loop is not None:
            return (loop, i) if is_own or caller is None else caller
        if is_own:
            caller = SourceLoop(file, line, line), i
    return None


def loop_within_step(
    position: tuple[str, int], lines_to_step: Collection[tuple[str, int]]
) -> SourceLoop | None:
    """Return the innermost loop that runs a line, if it runs none of those that lead to a step."""
    file, line = position
    holding = [
        SourceLoop(file, node.lineno, node.end_lineno or node.lineno)
        for node in ast.walk(_tree(file))
        if isinstance(node, _LOOPS) and node.lineno <= line <= (node.end_lineno or node.lineno)
    ]
    innermost = min(holding, key=lambda loop: loop.last - loop.first, default=None)
    if innermost is None or any(innermost.holds(each) for each in lines_to_step):
        return None
    return innermost


@cache
def lines_reading(file: str, names: tuple[str, ...]) -> tuple[tuple[int, str], ...]:
    return tuple(
        (node.lineno, node.attr)
        for node in ast.walk(_tree(file))
        if isinstance(node, ast.Attribute) and node.attr in names
    )


@cache
def source_line(file: str, line: int) -> str:
    lines = _text(file).splitlines()
    return lines[line - 1].strip() if 0 < line <= len(lines) else ""


@cache
def _loops(file: str) -> tuple[SourceLoop, ...]:
    return tuple(
        SourceLoop(file, node.lineno, node.end_lineno or node.lineno)
        for node in _outermost(_tree(file))
    )


def _outermost(scope: ast.AST) -> list[ast.stmt | ast.expr]:
    loops: list[ast.stmt | ast.expr] = []
    for node in ast.iter_child_nodes(scope):
        if isinstance(node, _LOOPS):
            loops.append(node)
            # lines of functions that are defined inside a loop run when they are called
            functions = [each for each in ast.walk(node) if isinstance(each, _FUNCTIONS)]
            loops += [inner for function in functions for inner in _outermost(function)]
        else:
            loops += _outermost(node)
    return loops


@cache
def _tree(file: str) -> ast.Module:
    """Return the syntax of a file; that of an empty one where it cannot be parsed."""
    try:
        return ast.parse(_text(file))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return ast.Module(body=[], type_ignores=[])


@cache
def _text(file: str) -> str:
    try:
        with tokenize.open(file) as stream:
            text = stream.read(_MAX_BYTES + 1)
    except (OSError, SyntaxError, ValueError):
        return ""
    return text if len(text) <= _MAX_BYTES else ""
