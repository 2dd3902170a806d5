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
