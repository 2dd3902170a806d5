"""What `mjbench doctor --placement` comes to: a sentence for each model, and residues."""

from collections.abc import Sequence

from mjbench.measuring.ratio import Ratio
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.releases.placement import RESIDUES
from mjbench.report import formats
from mjbench.report.content import Column, Conclusion, DataTable, Section
from mjbench.report.formats import short_percent


def section(rows: Sequence[SpreadRecord]) -> Section:
    measured = [row for row in rows if row.residues]
    table = DataTable.of(
        "Spreads",
        measured,
        (Column("model"), lambda row: row.model),
        (Column("release", leaves=3), lambda row: row.release),
        (Column("spread", short_percent), lambda row: row.spread.estimate if row.spread else None),
        (Column("interval", formats.ends_in(short_percent)), lambda row: row.spread),
        *(
            (
                Column(f"moved by {residue}", _change),
                lambda row, residue=residue: _ratio(row, residue),
            )
            for residue in RESIDUES
        ),
        (Column("launches", formats.count, leaves=2), lambda row: row.launches),
        (Column("seconds", formats.tenths, leaves=1), lambda row: row.seconds),
    )
    note = (
        "spread: slowest over fastest; moved by: bytes modulo 64, change of a step's time against"
        " the release as shipped (99 % interval)"
    )
    return Section(
        "How far does speed depend on where code lies?",
        [Conclusion(describe_spread(row)) for row in rows],
        tables=[table],
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
            f"{name}: the placements differ by {short_percent(spread.estimate)}, by chance or not:"
            f" too few launches for an interval{detail}"
        )
    if not spread.low:
        return (
            f"{name}: no dependence on where the code lies was seen; it is at most"
            f" {short_percent(spread.high)}{detail}"
        )
    interval = formats.ends(spread, short_percent, " to ")
    return (
        f"{name}: where the code lies changes the time of a step by"
        f" {short_percent(spread.estimate)} (interval {interval}), so a benchmark of one build says"
        f" no more than that{detail}"
    )


def _ratio(row: SpreadRecord, residue: int) -> Ratio | None:
    return next((each.ratio for each in row.residues if each.residue == residue), None)


def _change(ratio: Ratio) -> str:
    return formats.with_interval(ratio, formats.change_to_tenth)
