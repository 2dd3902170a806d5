"""What generated pages in Markdown share: texts that are no markup, tables, and changes in percent.

Names, messages and commands in run files are somebody else's: each goes through `escaped` or `code`
before it is part of a page, and then is no markup, no HTML and no role of MyST.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

from mjbench.errors import printable

# Characters that mean something in Markdown, MyST or HTML; `_` does not inside a word.
_SPECIAL = re.compile(r"[\\`*{}\[\]<>#&~]|(?<![^\W_])_|_(?![^\W_])")


def escaped(text: str) -> str:
    """Return a text as one line in which nothing is markup."""
    # a backslash before a pipe has a meaning in tables alone
    return _SPECIAL.sub(r"\\\g<0>", _line(text)).replace("|", "&#124;")


def code(text: str) -> str:
    """Return a text as one line of code, whatever backticks it has; nothing for nothing."""
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


def table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    right_aligned: Collection[str] = (),
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


def change(ratio: float) -> str:
    """Return a ratio as a change in percent, or as a factor where it is at least twofold."""
    return f"×{ratio:.2f}" if _is_factor(ratio) else f"{100 * (ratio - 1):+.1f} %"


def change_with_error(ratio: float, log_deviation: float) -> str:
    """Return a ratio as `change` does, with its standard error, such as `+1.2 ±0.3 %`.

    Args:
      ratio: new over old.
      log_deviation: standard error of its natural logarithm.
    """
    error = ratio * log_deviation
    if _is_factor(ratio):
        return f"×{ratio:.2f} ±{error:.2f}"
    return f"{100 * (ratio - 1):+.1f} ±{100 * error:.1f} %"


def _is_factor(ratio: float) -> bool:
    return ratio >= 2 or ratio <= 0.5
