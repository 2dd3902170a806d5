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
    return DataTable.of(
        "Differences",
        rows,
        (Column("machine"), lambda row: row.machine),
        (Column("model"), lambda row: row.model),
        (Column("path"), lambda row: row.path),
        (Column("options"), lambda row: describe_options(row.options)),
        (Column("simulations", formats.count), lambda row: row.nbatch),
        (Column("new / old", _three_digits), lambda row: row.ratio.estimate if row.ratio else None),
        (Column("95 %", formats.ends_in(_three_digits)), lambda row: row.ratio),
        (Column("detail"), lambda row: row.detail),
    )


def _three_digits(ratio: float) -> str:
    return f"{ratio:.3f}"
