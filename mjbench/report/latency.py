"""What `mjbench latency` prints."""

from collections.abc import Sequence

from rich.console import Console

from mjbench.instrument.units import duration
from mjbench.loop.latency import LatencyRow, SlowFeature
from mjbench.report import tables
from mjbench.report.starts import starts_lines

# Slow steps have a feature in common if they have so many times as much of it as all steps, and at
# least this much in every tenth of them.
_FACTOR, _LEAST = 1.2, 0.1


def print_rows(out: Console, rows: Sequence[LatencyRow]) -> None:
    """Print the latencies of a model, a row for each pace."""
    work = rows[0].work
    assert work is not None, "a model that was measured has its work"
    out.print(
        tables.headed(
            f"\n{rows[0].model}",
            f": {work.contacts:.1f} contacts and {work.solver_iterations:.1f} solver iterations"
            " a step",
        ),
        soft_wrap=True,
    )
    for line in starts_lines(rows[0].starts):
        out.print(line, soft_wrap=True)
    table = tables.plain_table(
        ["", "steps", "p50", "p99", "p99.9", "max", "deadline", "missed"], right=range(1, 8)
    )
    for row in rows:
        assert row.max_ns is not None and row.deadline_s is not None, "it was measured"
        pace = str(row.pace)
        if row.rate_hz:
            pace += f" at {tables.plain(row.rate_hz, 3)} Hz"
        table.add_row(
            pace,
            f"{row.nstep:,}",
            *(duration(quantile.ns) for quantile in row.quantiles),
            duration(row.max_ns),
            duration(1e9 * row.deadline_s),
            f"{row.missed:,}",
        )
    out.print(table)
    for row in rows:
        out.print(f"Slow steps, {row.pace}: {_common(row.slow)}", soft_wrap=True)


def _common(features: Sequence[SlowFeature]) -> str:
    """Return what the slowest 1 % of steps have in common."""
    parts = [
        f"{tables.plain(feature.slow, 2)} {feature.name} a step instead of"
        f" {tables.plain(feature.all, 2)}"
        for feature in features
        if feature.slow >= _LEAST and feature.slow > _FACTOR * feature.all
    ]
    return ", ".join(parts) or "nothing in common that was recorded"
