"""Markdown of generated pages."""

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
