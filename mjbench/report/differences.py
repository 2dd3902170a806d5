"""What `mjbench diff` prints."""

from collections.abc import Sequence

from mjbench.comparison.plan import describe_options
from mjbench.report import formats
from mjbench.report.content import Column, DataTable
from mjbench.report.run_differences import RunDifference


def difference_cautions(rows: Sequence[RunDifference]) -> list[str]:
    """Return what to know before the ratios of `mjbench diff`, a line each."""
    lines = (
        f"{', '.join(filter(None, (row.machine, row.model)))}: {caution}"
        for row in rows
        for caution in row.cautions
    )
    return list(dict.fromkeys(lines))


def differences_table(rows: Sequence[RunDifference]) -> DataTable:
    """Return the table of `mjbench diff`; of sets, with a column for the machine."""
    columns = (
        Column("machine"),
        Column("model"),
        Column("path"),
        Column("options"),
        Column("simulations", formats.count),
        Column("new / old", _three_digits),
        Column("95 %", formats.ends_in(_three_digits)),
        Column("detail"),
    )
    cells = [
        (
            row.machine,
            row.model,
            row.path,
            describe_options(row.options),
            row.nbatch,
            row.ratio.estimate if row.ratio else None,
            row.ratio,
            row.detail,
        )
        for row in rows
    ]
    return DataTable("Differences", columns, cells)


def _three_digits(ratio: float) -> str:
    return f"{ratio:.3f}"
