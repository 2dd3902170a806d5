"""Tables of instruction counts, and of what explains the difference between two releases."""

from collections.abc import Mapping, Sequence

from rich.console import Console

from mjbench.counts import explain
from mjbench.counts.function_differences import MAIN_FUNCTIONS, largest_differences
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import ExplainRecord, FunctionDifference, InstructionsRecord
from mjbench.report import tables
from mjbench.report.starts import starts_lines
from mjbench.status import Status


def print_counts(out: Console, counts: Sequence[InstructionsRecord], top: int) -> None:
    """Print instructions per step of every model and release, then stages and functions of each."""
    headings = ["model", "release", "instructions/step", "outside the engine/step", ""]
    table = tables.plain_table(headings, right=(2, 3))
    for count in counts:
        table.add_row(
            count.model,
            count.release,
            _number(count.instructions_per_step),
            _number(count.outside_per_step),
            count.detail,
        )
    out.print(table)
    for count in counts:
        if count.status == Status.OK and count.instructions_per_step:
            _print_functions(out, count, count.instructions_per_step, top)


def _print_functions(out: Console, count: InstructionsRecord, total: float, top: int) -> None:
    out.print(f"\n{count.model}, MuJoCo {count.release}")
    for line in [
        *starts_lines(count.starts, with_warnings=False),
        *tables.warning_lines(count.warnings),
    ]:
        out.print(line, soft_wrap=True)
    out.print(_stage_shares(count.stages or {}, total), soft_wrap=True)
    table = tables.plain_table(["function", "self/step", "share", "inclusive"], right=(1, 2, 3))
    for function in count.functions[:top]:
        table.add_row(
            function.name,
            _number(function.self),
            f"{100 * function.self / total:.1f} %",
            _number(function.inclusive),
        )
    out.print(table)


def print_explanation(
    out: Console, baseline: ModelCount, candidate: ModelCount, row: ExplainRecord, top: int
) -> None:
    """Print what changed from one release to another on one model."""
    releases = f"MuJoCo {baseline.release} → {candidate.release}"
    out.print(tables.headed(f"\n{candidate.model}", f", {releases}"))
    for count in (baseline, candidate):
        if count.status != Status.OK:
            out.print(f"MuJoCo {count.release}: {count.detail}", soft_wrap=True)
            return
    lines = [*explain.summary(baseline, candidate, row)]
    for count in (baseline, candidate):
        lines += [f"MuJoCo {count.release}: {w}" for w in tables.warning_lines(count.warnings)]
    for line in lines:
        out.print(line, soft_wrap=True)
    _print_stage_changes(out, row)
    _print_function_changes(out, row, top)


def print_changes(out: Console, rows: Sequence[ExplainRecord]) -> None:
    """Print a row for each model or operation, and pair of releases, that differ or failed."""
    headings = ["", "old", "new", "instructions", "functions that account for most"]
    table = tables.plain_table(headings, right=(3,))
    for row in rows:
        old, new = row.instructions_per_step.old, row.instructions_per_step.new
        if row.status == Status.UNAVAILABLE:  # such as Batch, of releases that do not have it
            continue
        if not old or not new:
            table.add_row(row.series, row.old, row.new, "", f"not counted: {row.status}")
        elif abs(new / old - 1) > explain.REPEATABILITY:
            differences = largest_differences(row.functions, MAIN_FUNCTIONS)
            texts = [f"{' and '.join(d.names)} {d.difference:+,.0f}" for d in differences]
            change = f"{100 * (new / old - 1):+.1f} %"
            table.add_row(row.series, row.old, row.new, change, ", ".join(texts))
    out.print(table)


def _print_stage_changes(out: Console, row: ExplainRecord) -> None:
    table = tables.plain_table(["stage", "old/step", "new/step", "difference"], right=(1, 2, 3))
    costs = {stage: (pair.old or 0.0, pair.new or 0.0) for stage, pair in row.stages.items()}
    for stage in sorted(costs, key=lambda name: -abs(costs[name][1] - costs[name][0])):
        before, after = costs[stage]
        if before or after:
            table.add_row(stage, _number(before), _number(after), f"{after - before:+,.0f}")
    out.print(table)


def _print_function_changes(out: Console, row: ExplainRecord, top: int) -> None:
    if not row.functions:
        return
    headings = ["function", "old/step", "new/step", "difference", "code", ""]
    table = tables.plain_table(headings, right=(1, 2, 3))
    for function in row.functions[:top]:
        table.add_row(
            function.name,
            _number(function.old),
            _number(function.new),
            f"{function.difference:+,.0f}",
            function.code or "",
            _remarks(function),
        )
    out.print(table)
    further = row.functions[top:]
    if further:
        rest = sum(function.difference for function in further)
        share = 100 * rest / (row.instructions_per_step.new or 1.0)
        out.print(f"{len(further)} further functions: {rest:+,.0f} ({share:+.2f} %)")


def _remarks(function: FunctionDifference) -> str:
    """Return which name a function had, and with which functions it exchanged cost."""
    remarks = [f"was {function.old_name}"] if function.old_name else []
    if function.moved_with:
        direction = "from" if function.difference > 0 else "to"
        remarks.append(f"moved {direction} {', '.join(function.moved_with)}")
    return "; ".join(remarks)


def _stage_shares(stages: Mapping[str, float], total: float) -> str:
    ordered = sorted(stages.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {100 * cost / total:.1f} %" for name, cost in ordered if cost)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"
