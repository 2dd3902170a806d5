"""What `mjbench plan` prints."""

from collections.abc import Sequence

from rich.console import Console

from mjbench.comparison.plan import Variant, describe_options
from mjbench.comparison.planning_run import PlanningRow
from mjbench.report import tables
from mjbench.report.starts import capture_lines
from mjbench.status import Status


def print_rows(out: Console, rows: Sequence[PlanningRow]) -> None:
    """Print the plans of a model, a row for each path, and which path is fastest."""
    first = rows[0]
    out.print(
        tables.headed(
            f"\n{first.model}",
            f": {first.task}, {_outcome(first.achieved)} {first.algorithm} with {first.samples}"
            f" samples × {first.horizon} steps, {first.nplan} plans",
        ),
        soft_wrap=True,
    )
    if first.starts is not None:
        out.print(f"Plans start from states of {first.starts.file}", soft_wrap=True)
        for line in capture_lines(first.starts):
            out.print(line, soft_wrap=True)
    table = tables.plain_table(
        ["path", "options", "ms/plan", "plans/s", "speed-up", "same plans"], right=range(2, 5)
    )
    for row in rows:
        if row.status == Status.UNAVAILABLE:
            continue
        is_timed = row.plan_s is not None
        table.add_row(
            row.path,
            describe_options(row.options),
            tables.plain(1e3 * row.plan_s, 3) if row.plan_s else "",
            f"{row.plans_per_s:,.0f}" if row.plans_per_s else "",
            tables.factor(row.speedup) if row.speedup else "",
            "yes" if is_timed else "NO" if row.status == Status.DISAGREES else str(row.status),
        )
    out.print(table)
    for row in rows:
        if row.detail:
            variant = Variant(row.path, row.options)
            out.print(f"{variant}: {row.status}: {row.detail}", soft_wrap=True)
    _print_fastest(out, rows)


def _outcome(achieved: bool | None) -> str:
    """Return whether a task was achieved, as words before the name of the planner."""
    match achieved:
        case None:
            return "each plan from another state, by"
        case True:
            return "achieved by"
        case False:
            return "not achieved by"


def print_sizes(out: Console, rows: Sequence[PlanningRow]) -> None:
    """Print the fastest path at each size of a model's plans, where there are several sizes."""
    for model in dict.fromkeys(row.model for row in rows):
        of_model = [row for row in rows if row.model == model and row.plans_per_s is not None]
        sizes = dict.fromkeys((row.samples, row.horizon) for row in of_model)
        if len(sizes) < 2:
            continue
        table = tables.plain_table(
            ["samples", "steps", "plans/s", "real time needs", "achieved", "fastest here"],
            right=range(4),
        )
        for size in sizes:
            fastest = fastest_of([row for row in of_model if (row.samples, row.horizon) == size])
            table.add_row(
                f"{fastest.samples:,}",
                f"{fastest.horizon:,}",
                f"{fastest.plans_per_s or 0.0:,.0f}",
                tables.plain(fastest.control_hz or 0.0, 3),
                "" if fastest.achieved is None else tables.yes_no(fastest.achieved),
                str(Variant(fastest.path, fastest.options)),
            )
        out.print()
        out.print(tables.headed(model, ", by the size of the plan"))
        out.print(table)


def fastest_of(timed: Sequence[PlanningRow]) -> PlanningRow:
    """Return the row of the path that is fastest beside the plain loop."""
    return max(timed, key=lambda row: row.speedup or 0.0)


def _print_fastest(out: Console, rows: Sequence[PlanningRow]) -> None:
    fastest = fastest_of([row for row in rows if row.plans_per_s is not None])
    assert fastest.plans_per_s is not None and fastest.control_hz is not None, "it was timed"
    if fastest.plans_per_s >= fastest.control_hz:
        pace = f"keeps up with {tables.plain(fastest.control_hz, 3)} controls per second"
    else:
        share = fastest.plans_per_s / fastest.control_hz
        pace = (
            f"makes {tables.plain(share, 2)} of the {tables.plain(fastest.control_hz, 3)} plans per"
            " second that real time needs"
        )
    variant = Variant(fastest.path, fastest.options)
    gain = f"{tables.factor(fastest.speedup or 1.0)}× the plain loop in this process"
    out.print(tables.headed(f"Fastest here: {variant}", f", {gain}; it {pace}"), soft_wrap=True)
