"""A table of a report on the console."""

from rich.console import Console

from mjbench.pages.content import DataTable
from mjbench.report import tables


def print_table(out: Console, table: DataTable) -> None:
    """Print a table without its title; the last column may have several lines."""
    columns = table.columns
    right = [number for number, column in enumerate(columns) if column.is_number]
    printed = tables.plain_table([column.title for column in columns], right)
    for row in table.rows:
        printed.add_row(*(c.shown(cell) for c, cell in zip(columns, row, strict=True)))
    out.print(printed)
