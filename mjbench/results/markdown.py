"""Reports and pages in GitHub's Markdown: for a job's summary, a comment, or a document.

Names, messages and commands in run files are somebody else's: each goes through `escaped` or `code`
before it is part of a page, and then is no markup, no HTML and no role of MyST.
"""

import html
import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

from mjbench.errors import printable
from mjbench.results.content import DataTable, Report, Section, Tone

_MARKS = {
    Tone.CAUTION: "⚠️ ",
    Tone.GOOD: "✅ ",
    Tone.BAD: "❌ ",
    Tone.UNSURE: "❔ ",
    Tone.NEUTRAL: "",
}
# Characters that are not folded, and of conclusions among them.
_MOST_SHOWN, _MOST_CONCLUDED = 2800, 1400
# Characters that mean something in Markdown, MyST or HTML; `_` does not inside a word.
_SPECIAL = re.compile(r"[\\`*{}\[\]<>#&~]|(?<![^\W_])_|_(?![^\W_])")


def render(report: Report) -> Iterator[str]:
    """Yield the lines of a report: a few conclusions and what is advised; the rest is folded."""
    yield f"## {escaped(report.title)}"
    yield ""
    yield from filter(None, [escaped(report.subtitle)])
    yield ""
    lines = [*_conclusions((e.text, e.tone) for e in (*report.conclusions, *report.further))]
    lengths = itertools.accumulate(len(line) + 1 for line in lines)
    room = sum(length <= _MOST_CONCLUDED for length in lengths)
    yield from lines[:room]
    if lines[room:]:
        yield from folded(f"{len(lines) - room} further conclusions", lines[room:])
    left = _MOST_SHOWN - min(_MOST_CONCLUDED, sum(len(line) + 1 for line in lines))
    for section in report.summaries:
        table = [*tables(section)]
        left -= sum(len(line) + 1 for line in table)
        if left > 0:
            yield from table
            section = replace(section, tables=(), figures=())
        yield from folded(section.heading, _section_lines(section))
    for section in report.sections:
        yield from folded(section.heading, _section_lines(section))
    if report.machines.rows:
        yield from folded("Machines and versions", data_table(report.machines))


def brief(report: Report, notes: Iterable[str] = ()) -> Iterator[str]:
    """Yield the lines of a report in a notebook: conclusions, tables, and code that is folded."""
    yield from _conclusions((e.text, e.tone) for e in (*report.conclusions, *report.further))
    yield from (f"- **{escaped(note)}**" for note in notes)
    for section in (*report.summaries, *report.sections):
        yield ""
        yield f"**{escaped(section.heading)}**"
        yield ""
        yield from _content(replace(section, shows_code=False))
        for snippet in section.snippets:
            yield from folded(snippet.title, code_block(snippet.code))


def folded(heading: str, lines: Iterable[str]) -> Iterator[str]:
    yield ""
    yield f"<details><summary>{html.escape(heading, quote=False)}</summary>"
    yield ""
    yield from lines
    yield ""
    yield "</details>"


def _section_lines(section: Section) -> Iterator[str]:
    yield from _conclusions((each.sentence, each.tone) for each in section.conclusions)
    yield from _content(section)
    yield ""
    yield f"Measured by {code(section.command)}"


def _content(section: Section) -> Iterator[str]:
    yield from (f"- {escaped(fact)}" for fact in section.facts)
    yield from tables(section)
    yield ""
    yield from (f"- {escaped(note)}" for note in section.notes)


def tables(section: Section) -> Iterator[str]:
    """Yield the tables of a section, and the code that it shows."""
    for table in section.shown_tables:
        yield ""
        if len(section.shown_tables) > 1:
            yield f"{escaped(table.title)}:"
            yield ""
        yield from data_table(table)
    for snippet in section.snippets if section.shows_code else ():
        yield ""
        yield f"{escaped(snippet.title)}:"
        yield ""
        yield from code_block(snippet.code)


def _conclusions(conclusions: Iterable[tuple[str, Tone]]) -> Iterator[str]:
    for text, tone in conclusions:
        yield f"- {_MARKS[tone]}{escaped(text)}"


def data_table(table: DataTable) -> Iterator[str]:
    table = table.filled_columns(with_bars=False)
    headings = [escaped(column.title) or " " for column in table.columns]
    right = {escaped(column.title) for column in table.columns if column.is_right_aligned}
    rows = ([escaped(text) for text in row] for row in table.texts)
    yield from table_lines(headings, rows, right)


def escaped(text: str) -> str:
    """Return a text as one line in which nothing is markup."""
    # a backslash before a pipe has a meaning in tables alone
    return _SPECIAL.sub(r"\\\g<0>", _line(text)).replace("|", "&#124;")


def code(text: str) -> str:
    line = _line(text)
    if not line:
        return ""
    fence = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    padding = " " if "`" in (line[0], line[-1]) else ""
    return f"{fence}{padding}{line}{padding}{fence}"


def code_block(text: str) -> Iterator[str]:
    """Yield lines of code as a block, whatever backticks they have."""
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    yield fence
    yield from map(printable, text.split("\n"))
    yield fence


def _line(text: str) -> str:
    return printable(" ".join(text.split()))


def table_lines(
    headings: Sequence[str], rows: Iterable[Sequence[str]], right_aligned: Collection[str] = ()
) -> Iterator[str]:
    """Yield the lines of a table.

    Args:
      rows: cells of each row, in which only code may have pipes.
      right_aligned: headings of columns that are right-aligned.
    """
    yield f"| {' | '.join(headings)} |"
    yield "|" + "|".join("---:" if h in right_aligned else "---" for h in headings) + "|"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
