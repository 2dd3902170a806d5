"""What `mjbench history measure` prints: a row for each release and model or operation."""

import itertools
from collections.abc import Sequence

from rich.console import Console

from mjbench.releases import release_ratios, speed_history
from mjbench.releases.release_ratios import LogEstimate, RatioRecord, StepRatioRecord
from mjbench.report import tables
from mjbench.report.markdown import change_with_error
from mjbench.simulation import agreement


def print_table(out: Console, records: Sequence[RatioRecord]) -> None:
    """Print the ratio of each release and model, with its standard error."""
    headings = [
        "model or operation",
        "release",
        "time",
        "as shipped",
        "launches",
        "seconds",
        "work",
    ]
    table = tables.plain_table(headings, right=(2, 3, 4, 5))
    in_order = speed_history.in_order_of_release(records)
    for _, each in itertools.groupby(in_order, lambda record: (record.release, record.build)):
        of_release = list(each)
        if _failed_alike(of_release):
            first = of_release[0]
            table.add_row("all", first.release, "", "", "0", "", first.detail)
            continue
        for record in of_release:
            table.add_row(
                record.series,
                record.release,
                _change(release_ratios.averaged(record.launches)),
                _change(release_ratios.as_shipped(record.launches)),
                str(len(record.launches)),
                f"{record.seconds:.1f}",
                record.detail or _work(record),
            )
    out.print(table)
    for problem in sorted({record.problem for record in records if record.problem}):
        out.print(f"placement not averaged out: {problem}", soft_wrap=True)
    references = sorted({record.reference for record in records})
    out.print(
        f"time: of a step or an operation, against MuJoCo {', '.join(references)} (± standard"
        " error), with placement averaged out where the code can be moved; work: against the same"
        " release",
        soft_wrap=True,
    )


def _failed_alike(records: Sequence[RatioRecord]) -> bool:
    """Return whether nothing of a release could be timed, and always for one reason."""
    details = {record.detail for record in records}
    is_timed = any(record.launches for record in records)
    return len(records) > 1 and not is_timed and len(details) == 1 and "" not in details


def _change(ratio: LogEstimate | None) -> str:
    """Return a ratio as a change with its standard error; empty where it is not known."""
    if ratio is None:
        return ""
    return change_with_error(ratio.ratio, ratio.deviation)


def _work(record: RatioRecord) -> str:
    """Return how the work differs from that of the reference."""
    if not isinstance(record, StepRatioRecord):
        is_same = record.drift is not None and record.drift <= agreement.ROUNDING
        return "the same result" if is_same else "another result"
    if record.work is None or record.reference_work is None:
        return ""
    diverged = record.reference_diverged, record.diverged
    changes = agreement.work_changes(record.reference_work, record.work, record.drift, diverged)
    return "; ".join(changes) or "the same"
