"""Sections on a terminal, or as plain text: the conclusions first, then facts, tables and notes."""

import io
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from mjbench.errors import printable
from mjbench.results.content import DataTable, Section, Tone
from mjbench.status import ExitCode

# Of what is no terminal, and of a narrow one at least.
_PLAIN_WIDTH, _MIN_WIDTH = 160, 60
# Characters between columns, and of a word that is cut only where a table would be too wide.
_GAP, _LEAST_WRAPPED = 2, 10
# Columns leave rather than that a text is narrower.
_READABLE = 16


class _Console(Console):
    """A console that prints text as it is: no markup, and no control character of foreign text.

    It ends the command with exit code 3 when nobody reads on (`… | head`).
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **style: Any) -> Text:  # every str in a line or a cell
        return super().render_str(_printable_lines(text), **style)

    def on_broken_pipe(self) -> None:
        try:
            super().on_broken_pipe()
        except SystemExit:
            raise SystemExit(ExitCode.ENVIRONMENT) from None


def console(stderr: bool = False) -> Console:
    """Return a console as wide as the terminal, or as COLUMNS says."""
    out = _Console(stderr=stderr)
    knows_width = out.is_terminal or os.environ.get("COLUMNS", "").isdecimal()
    out.width = max(out.width, _MIN_WIDTH) if knows_width else _PLAIN_WIDTH
    return out


def text_of(sections: Iterable[Section]) -> str:
    """Return sections as plain text."""
    file = io.StringIO()
    # in a notebook, a console of Rich shows what it prints, whatever its file is
    out = _Console(
        file=file, width=_PLAIN_WIDTH, color_system=None, force_terminal=False, force_jupyter=False
    )
    print_sections(out, sections)
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").split("\n"))


def print_sections(out: Console, sections: Iterable[Section], code: bool = False) -> None:
    """Print sections, an empty line before each; `code`: with their snippets."""
    for section in sections:
        out.print()
        print_lines(out, section_parts(section, out.width))
        for snippet in section.snippets if code or section.shows_code else ():
            out.print()
            out.print(headed(snippet.title, ":"), soft_wrap=True)
            for line in snippet.code.splitlines():
                out.print(f"    {line}", soft_wrap=True)


def section_parts(section: Section, width: int) -> Iterator[RenderableType]:
    """Yield what is printed of a section on a console of some width, without its snippets."""
    for conclusion in section.conclusions:
        if conclusion.tone == Tone.CAUTION:
            yield Text(_printable_lines(conclusion.sentence), style="yellow")
    sentences = [each for each in section.conclusions if each.tone != Tone.CAUTION]
    if all(each.subject for each in sentences):
        yield headed(section.heading, "")
    for conclusion in sentences:
        yield headed(*_parted(conclusion.sentence))
    yield from section.facts
    for table in section.tables:
        if len(section.tables) > 1:
            yield Text(table.title, style="italic")
        yield from table_parts(table, width)
    yield from section.notes


def table_parts(table: DataTable, width: int) -> Iterator[RenderableType]:
    """Yield a table without frames, in which no cell is cut, and which columns it lacks.

    Where it is too wide for the console, columns leave in their order and texts wrap, first those
    that are sentences. A table that is too wide even so is wider, and the terminal wraps its lines.
    """
    table, left_out = _fitting(table.filled_columns(), width)
    widths = _widths(table, width)
    printed = Table(box=None, pad_edge=False, header_style="bold", width=_total(widths))
    for column, column_width in zip(table.columns, widths, strict=True):
        printed.add_column(
            column.title,
            justify="right" if column.is_right_aligned else "left",
            overflow="fold",
            width=column_width,
        )
    for row in table.texts:
        printed.add_row(*row)
    yield printed
    if names := ", ".join(filter(None, left_out)):
        yield Text(_printable_lines(f"Columns that need a wider terminal: {names}"), style="dim")


def _fitting(table: DataTable, width: int) -> tuple[DataTable, list[str]]:
    """Return a table whose least widths fit, where that is possible, and which columns it lost."""
    optional = [column for column in table.columns if column.leaves or column.is_bar]
    optional.sort(key=lambda column: column.leaves)  # bars first
    left_out: list[str] = []
    for column in optional:
        natural, least = _natural_widths(table), _least_widths(table)
        readable = [
            max(narrow, min(wide, _READABLE)) for narrow, wide in zip(least, natural, strict=True)
        ]
        if _total(readable) <= width:
            break
        table = table.without([column.title])
        left_out.append(column.title)
    return table, left_out


def _widths(table: DataTable, width: int) -> list[int]:
    """Return the widths of columns, of which none is less than it needs."""
    least = _least_widths(table)
    if _total(least) > width:
        least = _least_widths(table, longest_word=_LEAST_WRAPPED)
    widths = _natural_widths(table)
    for only_sentences in (True, False):
        while _total(widths) > width:
            reducible = [
                i
                for i, column in enumerate(table.columns)
                if widths[i] > least[i] and (column.wraps or not only_sentences)
            ]
            if not reducible:
                break
            widths[max(reducible, key=lambda i: widths[i])] -= 1
    return widths


def _natural_widths(table: DataTable) -> list[int]:
    return [
        max(cell_len(printable(text)) for text in (column.title, *(row[i] for row in table.texts)))
        for i, column in enumerate(table.columns)
    ]


def _least_widths(table: DataTable, longest_word: int = 1000) -> list[int]:
    """Return the widths below which a number would be cut, or a word.

    Args:
      longest_word: longer words of texts are cut.
    """
    least = []
    for i, column in enumerate(table.columns):
        cells = [row[i] for row in table.texts]
        words = [word for text in (column.title, *cells) for word in text.split(" ")]
        width = max(cell_len(printable(word)) for word in words)
        if column.is_right_aligned:
            width = max(width, *(cell_len(printable(text)) for text in cells))
        elif width > longest_word:
            width = max(longest_word, max(map(cell_len, column.title.split(" "))))
        least.append(width)
    return least


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + _GAP * (len(widths) - 1)


def _parted(text: str) -> tuple[str, str]:
    """Return the beginning of a sentence, which is bold, and the rest.

    It ends where the first clause after a colon ends; without a colon, nothing is bold.
    """
    begin = re.match(r"(.*?: .*?)(?=[,;] | \(|$)", text)
    end = begin.end() if begin else 0
    return text[:end], text[end:]


def print_lines(out: Console, lines: Iterable[RenderableType]) -> None:
    """Print lines and tables; on a terminal, lines wrap at words."""
    for line in lines:
        out.print(line, soft_wrap=isinstance(line, Table) or not out.is_terminal)


def headed(heading: str, rest: str) -> Text:
    return Text.assemble((_printable_lines(heading), "bold"), _printable_lines(rest))


def _printable_lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))
