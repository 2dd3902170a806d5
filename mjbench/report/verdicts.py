"""The table of paired comparisons, and each verdict in a line."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mjbench.instrument.runs import Record
from mjbench.report import tables
from mjbench.simulation import agreement


def print_table(out: Console, rows: Sequence[Record]) -> None:
    """Print a row for each comparison, below it what each says in words."""
    headings = ["model", "old → new", "new / old", "interval", "verdict", "work", "drift"]
    table = tables.plain_table(
        [*headings, "launches", "pairs", "seconds"], right=(2, 3, 6, 7, 8, 9)
    )
    for row in rows:
        table.add_row(*map(escape, _cells(row)))
    out.print(table)
    for row in rows:
        out.print(escape(sentence(row)), soft_wrap=True)


def sentence(row: Record) -> str:
    """Return a comparison as a sentence, such as `humanoid: slower by 1.4 % (1.1 to 1.7)`."""
    name = f"{row['model']}, {sides_text(row)}"
    if row["verdict"] is None:
        return f"{name}: {row['detail'] or 'not measured'}"
    ratio = row["ratio"]
    ends = [ratio["low"], ratio["high"]]
    span = "unknown" if None in ends else f"{percent(ends[0])} to {percent(ends[1])} %"
    if row["verdict"] == "same":
        text = f"same within {max(abs(100 * (end - 1)) for end in ends):.2g} %"
    elif row["verdict"] == "inconclusive":
        text = f"inconclusive, {percent(ratio['estimate'])} % (interval {span})"
    else:
        text = f"{row['verdict']} by {abs(100 * (ratio['estimate'] - 1)):.2g} % (interval {span})"
    text += ", " + ("changed work: " + work_text(row) if row["changed_work"] else "same work")
    return f"{name}: {text}" + (f"; {row['detail']}" if row["detail"] else "")


def sides_text(row: Record) -> str:
    """Return what differs between the two sides, such as `3.3.0 → 4.0.0`."""
    old, new = row["sides"]
    differing = [_flat(old), _flat(new)]
    keys = [
        k for k in {**differing[0], **differing[1]} if differing[0].get(k) != differing[1].get(k)
    ]
    if keys in (["release"], []):
        return f"{old['release']} → {new['release']}"
    return " → ".join(
        " ".join(f"{key}={side[key]}" for key in keys if key in side) or "default"
        for side in differing
    )


def work_text(row: Record) -> str:
    """Return how the work changed, in words; empty when it did not."""
    work = row["work"]
    if not work:
        return ""
    diverged = row["diverged"]["old"], row["diverged"]["new"]
    return ", ".join(agreement.work_changes(work["old"], work["new"], row["drift"], diverged))


def selfcheck_table(rows: Sequence[Record]) -> Table:
    """Return the table of `mjbench selfcheck`."""
    headings = ["model", "injected", "trials", "called slower", "wrong", "missed", "inconclusive"]
    headings += ["truth in interval", "mean error", "seconds", "launches", "sd of launches"]
    table = tables.plain_table(headings, right=range(1, len(headings)))
    for row in rows:
        names = ("detected", "wrong", "missed", "inconclusive", "covered")
        shares = [row[name] for name in names]
        table.add_row(
            row["model"],
            f"{100 * row['slowdown']:g} %",
            str(row["trials"]),
            *(f"{100 * share:.1f} %" for share in shares),
            f"{100 * row['error']:+.3f} %",
            f"{row['seconds']:.1f}",
            f"{row['launches']:.1f}",
            "" if row["launch_sd"] is None else f"{100 * row['launch_sd']:.2f} %",
        )
    return table


def percent(ratio: float) -> str:
    """Return a ratio as a signed change in percent, without the sign of percent."""
    return f"{100 * (ratio - 1):+.2f}"


def _flat(side: Mapping[str, Any]) -> dict[str, Any]:
    plain = {key: side[key] for key in ("release", "model", "path")}
    return {**plain, **side["options"], **side["model_options"]}


def _cells(row: Record) -> list[str]:
    ratio = row["ratio"]
    ends = "" if not ratio or ratio["low"] is None else f"{ratio['low']:.4f}–{ratio['high']:.4f}"
    return [
        row["model"],
        sides_text(row),
        f"{ratio['estimate']:.4f}" if ratio else "",
        ends,
        row["verdict"] or row["status"],
        "" if row["work"] is None else "changed" if row["changed_work"] else "same",
        "" if row["drift"] is None else f"{row['drift']:.1g}",
        str(row["launches"]),
        str(row["pairs"]),
        f"{row['seconds']:.1f}",
    ]
