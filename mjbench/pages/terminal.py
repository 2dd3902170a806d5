"""Sections on a terminal, or as plain text: the conclusions first, then facts, tables and notes."""

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from mjbench.errors import printable
from mjbench.report.content import DataTable, Section, Tone
from mjbench.status import ExitCode

_PLAIN_WIDTH, _MIN_WIDTH = 160, 80
# Characters between columns, and of a column that wraps at least.
_GAP, _LEAST_WRAPPED = 2, 16


class _Console(Console):
    """A console that prints text as it is: no markup, and no control character of foreign text.

    It ends the command with exit code 3 when nobody reads on (`… | head`).
    """

    def render_str(self, text: str, **style: Any) -> Text:  # every str in a line or a cell
        return super().render_str(_printable_lines(text), **style)

    def on_broken_pipe(self) -> None:
        try:
            super().on_broken_pipe()
        except SystemExit:
            raise SystemExit(ExitCode.ENVIRONMENT) from None


def console(stderr: bool = False) -> Console:
    """Return a console that never squeezes a table: the terminal wraps long lines."""
    out = _Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    out.width = max(out.width, _MIN_WIDTH) if out.is_terminal else _PLAIN_WIDTH
    return out


def text_of(sections: Iterable[Section], code: bool = False) -> str:
    """Return sections as plain text; `code`: with their snippets."""
    file = io.StringIO()
    # in a notebook, a console of Rich shows what it prints, whatever its file is
    out = _Console(
        file=file,
        width=_PLAIN_WIDTH,
        highlight=False,
        markup=False,
        emoji=False,
        color_system=None,
        force_terminal=False,
        force_jupyter=False,
    )
    print_sections(out, sections, code)
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").split("\n"))


def print_sections(out: Console, sections: Iterable[Section], code: bool = False) -> None:
    """Print sections, an empty line before each; `code`: with their snippets."""
    for section in sections:
        out.print()
        for part in section_parts(section, out.width):
            out.print(part, soft_wrap=True)
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
    tables = [table for table in section.tables if table.rows]
    for table in tables:
        if len(tables) > 1:
            yield Text(table.title, style="italic")
        yield rich_table(table, width)
    yield from section.notes


def rich_table(table: DataTable, width: int) -> Table:
    """Return a table without frames, in which no cell is cut.

    Without any column that wraps, the last one of text does. Where columns are wider than the
    console even so, the table is wider, and the terminal wraps its lines.
    """
    table = table.filled_columns()
    wrapped = [i for i, column in enumerate(table.columns) if column.wraps] or [
        i for i, column in enumerate(table.columns) if not column.is_number
    ][-1:]
    printed = Table(box=None, pad_edge=False, header_style="bold")
    rows = table.texts
    least_width = _GAP * (len(table.columns) - 1)
    for i, column in enumerate(table.columns):
        is_wrapped = i in wrapped
        natural = max(cell_len(printable(text)) for text in (column.title, *(r[i] for r in rows)))
        least = min(natural, _LEAST_WRAPPED) if is_wrapped else natural
        least_width += least
        printed.add_column(
            column.title,
            justify="right" if column.is_number else "left",
            no_wrap=not is_wrapped,
            overflow="fold",
            min_width=least,
        )
    if least_width > width:
        printed.width = least_width
    for row in rows:
        printed.add_row(*row)
    return printed


def _parted(text: str) -> tuple[str, str]:
    """Return the beginning of a sentence, which is bold, and the rest.

    It ends where the first clause after a colon ends; without a colon, nothing is bold.
    """
    begin = re.match(r"(.*?: .*?)(?=[,;] | \(|$)", text)
    end = begin.end() if begin else 0
    return text[:end], text[end:]


def print_lines(out: Console, lines: Sequence[str | Text]) -> None:
    """Print lines, which the terminal wraps."""
    for line in lines:
        out.print(line, soft_wrap=True)


def headed(heading: str, rest: str) -> Text:
    """Return a line whose beginning is bold."""
    return Text.assemble((_printable_lines(heading), "bold"), _printable_lines(rest))


def _printable_lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))
