"""What `mjbench placement` comes to: a sentence for each model, and the table of residues."""

from collections.abc import Sequence

from mjbench.measuring.ratio import Ratio
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.releases.placement import RESIDUES
from mjbench.report import formats
from mjbench.report.content import Cell, Column, Conclusion, DataTable, Section
from mjbench.units import percent


def section(rows: Sequence[SpreadRecord]) -> Section:
    """Return a sentence for each model, and the table of all residues."""
    columns = (
        Column("model"),
        Column("release"),
        Column("spread"),
        Column("interval"),
        *(Column(f"moved by {residue}") for residue in RESIDUES),
        Column("launches", formats.count),
        Column("seconds", formats.tenths),
    )
    measured = [row for row in rows if row.residues]
    note = (
        "spread: slowest over fastest; moved by: bytes modulo 64, change of a step's time against"
        " the release as shipped (99 % interval)"
    )
    return Section(
        "How far does speed depend on where code lies?",
        [Conclusion(describe_spread(row)) for row in rows],
        tables=[DataTable("Spreads", columns, [_cells(row) for row in measured])],
        notes=[note] if measured else [],
    )


def describe_spread(row: SpreadRecord) -> str:
    """Return in a sentence how far the time of a step depends on where the code lies."""
    name = f"{row.model}, MuJoCo {row.release}"
    spread = row.spread
    if spread is None:
        return f"{name}: {row.detail or 'too few launches'}"
    detail = f" ({row.detail})" if row.detail else ""
    if spread.low is None or spread.high is None:
        return (
            f"{name}: the placements differ by {percent(spread.estimate)} %, by chance or not: too"
            f" few launches for an interval{detail}"
        )
    if not spread.low:
        return (
            f"{name}: no dependence on where the code lies was seen; it is at most"
            f" {percent(spread.high)} %{detail}"
        )
    return (
        f"{name}: where the code lies changes the time of a step by {percent(spread.estimate)} %"
        f" (interval {percent(spread.low)} to {percent(spread.high)} %), so a benchmark of one"
        f" build says no more than that{detail}"
    )


def _cells(row: SpreadRecord) -> list[Cell]:
    spread, ratios = row.spread, {residue.residue: residue.ratio for residue in row.residues}
    has_interval = spread is not None and spread.low is not None and spread.high is not None
    return [
        row.model,
        row.release,
        f"{percent(spread.estimate)} %" if spread else "",
        f"{percent(spread.low or 0.0)}–{percent(spread.high or 0.0)} %"
        if spread and has_interval
        else "",
        *(_change(ratios.get(residue)) for residue in RESIDUES),
        row.launches,
        row.seconds,
    ]


def _change(ratio: Ratio | None) -> str:
    """Return a ratio as a change in percent, such as `+1.2 (+0.8 to +1.6)`."""
    if ratio is None:
        return ""
    estimate, *ends = (
        f"{100 * (value - 1):+.1f}"
        for value in (ratio.estimate, ratio.low, ratio.high)
        if value is not None
    )
    return f"{estimate} ({' to '.join(ends)})" if ends else estimate
