"""What generated pages in Markdown share: tables, and changes in percent."""

from collections.abc import Collection, Iterable, Iterator, Sequence


def table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    right_aligned: Collection[str] = (),
) -> Iterator[str]:
    """Yield the lines of a table.

    Args:
      headings: of the columns.
      rows: cells of each row.
      right_aligned: headings of columns that are right-aligned.
    """
    yield f"| {' | '.join(headings)} |"
    yield "|" + "|".join("---:" if h in right_aligned else "---" for h in headings) + "|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def change(ratio: float) -> str:
    """Return a ratio as a change in percent, or as a factor where it is at least twofold."""
    return f"×{ratio:.2f}" if ratio >= 2 or ratio <= 0.5 else f"{100 * (ratio - 1):+.1f} %"
