"""What `mjbench diff` prints."""

from collections.abc import Sequence

from rich.table import Table

from mjbench.comparison.plan import describe_options
from mjbench.report import tables
from mjbench.report.run_differences import RunDifference


def difference_cautions(rows: Sequence[RunDifference]) -> list[str]:
    """Return what to know before the ratios of `mjbench diff`, a line each."""
    lines = (
        f"{', '.join(filter(None, (row.machine, row.model)))}: {caution}"
        for row in rows
        for caution in row.cautions
    )
    return list(dict.fromkeys(lines))


def differences_table(rows: Sequence[RunDifference]) -> Table:
    """Return the table of `mjbench diff`; of sets, with a column for the machine."""
    machines = ["machine"] if any(row.machine for row in rows) else []
    headings = [*machines, "model", "path", "options", "simulations", "new / old", "95 %", ""]
    table = tables.plain_table(headings, right=(3 + len(machines), 4 + len(machines)))
    for row in rows:
        interval = ""
        if row.ratio and row.ratio.low is not None:
            interval = f"{row.ratio.low:.3f}–{row.ratio.high:.3f}"
        table.add_row(
            *([row.machine] if machines else []),
            row.model,
            row.path,
            describe_options(row.options),
            "" if row.nbatch is None else f"{row.nbatch:,}",
            f"{row.ratio.estimate:.3f}" if row.ratio else "",
            interval,
            row.detail,
        )
    return table
