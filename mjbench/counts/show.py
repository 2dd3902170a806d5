"""What counts of instructions come to, and what explains a difference of releases."""

from collections.abc import Iterator, Sequence

from mjbench import formats
from mjbench.counts import explain
from mjbench.counts.function_differences import NetDifference, largest_differences, moved_groups
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import (
    ExplainRecord,
    FunctionDifference,
    InstructionsRecord,
)
from mjbench.formats import count_of
from mjbench.interval import Interval
from mjbench.paired.records import VerdictRow
from mjbench.results import charts
from mjbench.results.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.results.starts import starts_lines
from mjbench.simulation.engine_warnings import warning_lines
from mjbench.status import Status

# Functions of a count that are listed, and functions of a change that are drawn.
_MOST_LISTED, _MOST_DRAWN = 10, 12
# Ratios of time and of instructions that differ by more have a cause that instructions do not show.
_DISAGREEMENT = 0.03

# As many functions are named of those that account for a change.
MAIN_FUNCTIONS = 3


def sections(counts: Sequence[InstructionsRecord], top: int = _MOST_LISTED) -> Iterator[Section]:
    """Yield the instructions of all models and releases, then the first functions of each count."""
    if not counts:
        return
    table = DataTable.of(
        "Instructions",
        counts,
        (Column("model"), lambda count: count.model),
        (Column("release"), lambda count: count.release),
        (Column("instructions/step", formats.count), lambda count: count.instructions_per_step),
        (
            Column("outside the engine/step", formats.count, leaves=1),
            lambda count: count.outside_per_step,
        ),
        (Column("why not"), lambda count: count.detail),
    )
    failed = [
        Conclusion(f"{c.model}, MuJoCo {c.release}: not counted ({c.status})", Tone.BAD)
        for c in counts
        if c.instructions_per_step is None
    ]
    yield Section("Instructions", failed, tables=[table])
    for count in counts:
        if count.status == Status.OK and count.instructions_per_step:
            yield _functions_section(count, count.instructions_per_step, top)


def _functions_section(count: InstructionsRecord, total: float, top: int) -> Section:
    stages = sorted((count.stages or {}).items(), key=lambda item: -item[1])
    table = DataTable.of(
        "Functions",
        count.functions[:top],
        (Column("function"), lambda function: function.name),
        (Column("self/step", formats.count), lambda function: function.self),
        (Column("share", formats.percent), lambda function: function.self / total),
        (Column("inclusive", formats.count, leaves=1), lambda function: function.inclusive),
    )
    return Section(
        f"{count.model}, MuJoCo {count.release}",
        facts=[
            *starts_lines(count.starts, with_warnings=False),
            *warning_lines(count.warnings),
            ", ".join(f"{name} {100 * cost / total:.1f} %" for name, cost in stages if cost),
        ],
        tables=[table],
    )


def explanation_section(
    baseline: ModelCount, candidate: ModelCount, row: ExplainRecord, top: int
) -> Section:
    heading = f"{candidate.model}, MuJoCo {baseline.release} → {candidate.release}"
    counts = (baseline, candidate)
    failed = [count for count in counts if count.status != Status.OK]
    if failed:
        text = f"{heading}: MuJoCo {failed[0].release}: {failed[0].detail}"
        return Section(heading, [Conclusion(text, Tone.BAD)])
    first, *rest = summary(baseline, candidate, row)
    further = row.functions[top:]
    difference = sum(function.difference for function in further)
    share = 100 * difference / (row.instructions_per_step.new or 1.0)
    note = f"{len(further)} further functions: {difference:+,.0f} ({share:+.2f} %)"
    return Section(
        heading,
        [Conclusion(f"{heading}: {first}")],
        facts=[
            *rest,
            *(
                f"MuJoCo {count.release}: {warning}"
                for count in counts
                for warning in warning_lines(count.warnings)
            ),
        ],
        tables=[_stages_table(row), _functions_table(row, top)],
        notes=[note] if further else [],
    )


def summary(baseline: ModelCount, candidate: ModelCount, row: ExplainRecord) -> list[str]:
    """Return what changed, a line each: first by how much, then in what."""
    old, new = baseline.instructions_per_step, candidate.instructions_per_step
    assert old and new, "both were counted"
    ratio = new / old
    changes = explain.work_changes(baseline, candidate, row.time)
    counts = f"instructions per step {old:,.0f} → {new:,.0f} ({formats.change(ratio)})"
    time = row.time
    lines = [
        f"{_describe_time(time, time.ratio)}; {counts}" if time and time.ratio else counts,
        "changed work: " + ", ".join(changes) if changes else "same work",
    ]
    return lines + _move_lines(row) + (_time_lines(time, ratio) if time else [])


def _move_lines(row: ExplainRecord) -> list[str]:
    lines = []
    for group in moved_groups(row.functions):
        parts = " and ".join(f"{each.name} ({each.difference:+,.0f})" for each in group)
        total = sum(each.difference for each in group)
        lines.append(f"cost moved between {parts}, together {total:+,.0f}")
    return lines


def _describe_time(time: VerdictRow, ratio: Interval) -> str:
    interval = formats.ends(ratio, formats.change) or "interval unknown"
    change = formats.change(ratio.estimate)
    return f"{time.verdict}, time {change} ({interval.removesuffix(' %')})"


def _time_lines(time: VerdictRow, instruction_ratio: float) -> list[str]:
    lines = [] if time.status == Status.OK else [f"time not compared: {time.detail}"]
    if time.ratio is None or time.ratio.low is None or time.ratio.high is None:
        return lines
    difference = abs(time.ratio.estimate - instruction_ratio)
    low, high = time.ratio.low - _DISAGREEMENT, time.ratio.high + _DISAGREEMENT
    if difference > _DISAGREEMENT and not low <= instruction_ratio <= high:
        lines.append(
            f"time and instructions disagree by {100 * difference:.1f} points: instruction counts"
            " do not show cache misses, mispredicted branches, wider or slower instructions (SIMD,"
            " division), memory allocation in the kernel, and system calls"
        )
    return lines


def _stages_table(row: ExplainRecord) -> DataTable:
    costs = [(stage, pair.old or 0.0, pair.new or 0.0) for stage, pair in row.stages.items()]
    costs.sort(key=lambda cost: -abs(cost[2] - cost[1]))
    return DataTable.of(
        "Stages",
        [cost for cost in costs if cost[1] or cost[2]],
        (Column("stage"), lambda cost: cost[0]),
        (Column("old/step", formats.count), lambda cost: cost[1]),
        (Column("new/step", formats.count), lambda cost: cost[2]),
        (Column("difference", _signed), lambda cost: cost[2] - cost[1]),
    )


def _functions_table(row: ExplainRecord, top: int) -> DataTable:
    return DataTable.of(
        "Functions",
        row.functions[:top],
        (Column("function"), lambda function: function.name),
        (Column("old/step", formats.count), lambda function: function.old),
        (Column("new/step", formats.count), lambda function: function.new),
        (Column("difference", _signed), lambda function: function.difference),
        (Column("remarks"), _remarks),
    )


def _signed(instructions: float) -> str:
    return f"{instructions:+,.0f}"


def change_sections(rows: Sequence[ExplainRecord]) -> Iterator[Section]:
    """Yield what changed between releases in models and operations; none without rows.

    What both releases lack, such as Batch, is left out.
    """
    compared = [row for row in rows if row.status != Status.UNAVAILABLE]
    if not rows:
        return
    differ = [
        row for row in compared if abs((row.instruction_ratio or 1.0) - 1) > explain.REPEATABILITY
    ]
    unloaded = [row for row in compared if row.status == Status.INPUT]
    failed = [row for row in compared if row.instruction_ratio is None and row not in unloaded]
    conclusions = [Conclusion(f"Instructions differ in {len(differ)} of {len(compared)} pairs")]
    if unloaded:
        text = f"{count_of(len(unloaded), 'pair')} not counted: a release cannot load the model"
        conclusions.append(Conclusion(text))
    conclusions += [
        Conclusion(f"{_heading(row)}: not counted ({row.status})", Tone.BAD) for row in failed
    ]
    largest_first = sorted(differ, key=lambda row: -abs((row.instruction_ratio or 1.0) - 1))
    changes = [(row, largest_differences(row.functions, _MOST_DRAWN)) for row in largest_first]
    yield Section(
        "Instructions, release by release",
        conclusions,
        figures=[_figure(row, largest) for row, largest in changes if largest],
        tables=[_changes_table(differ)],
    )


def _heading(row: ExplainRecord) -> str:
    return f"{row.series}, instructions, {row.old} → {row.new}"


def _changes_table(rows: Sequence[ExplainRecord]) -> DataTable:
    return DataTable.of(
        "Changes",
        rows,
        (Column("model or operation"), lambda row: row.series),
        (Column("old"), lambda row: row.old),
        (Column("new"), lambda row: row.new),
        (Column("instructions", formats.change_to_tenth), lambda row: row.instruction_ratio),
        (Column("functions that account for most", wraps=True), _main_functions),
    )


def _main_functions(row: ExplainRecord) -> str:
    largest = largest_differences(row.functions, MAIN_FUNCTIONS)
    return ", ".join(f"{' and '.join(each.names)} {_signed(each.difference)}" for each in largest)


def _figure(row: ExplainRecord, changes: Sequence[NetDifference]) -> Figure:
    total = row.instructions_per_step.old or 1.0
    whole = "the operation" if row.operation else "a step"
    data = DataTable.of(
        "Functions that changed most",
        changes,
        (Column("function"), lambda change: " and ".join(change.names)),
        (Column("instructions", formats.count), lambda change: change.difference),
        (Column("%", formats.digits(3)), lambda change: 100 * change.difference / total),
    )
    largest = changes[0]
    bars = {
        "x": charts.quantity("%", f"% of the instructions of {whole}", zero=True),
        "y": charts.names(data),
        "color": {
            "condition": {"test": "datum['%'] > 0", "value": charts.ORANGE},
            "value": charts.BLUE,
        },
    }
    return charts.figure(
        f"{_heading(row)}: functions that account for most of the change",
        f"Bars of {len(changes)} functions; the largest change is that of"
        f" {' and '.join(largest.names)}, {100 * largest.difference / total:+.1f} % of {whole}.",
        data,
        [charts.rule_at(0.0), charts.layer("bar", bars, height=12)],
    )


def _remarks(function: FunctionDifference) -> str:
    if not function.moved_with:
        return ""
    direction = "from" if function.difference > 0 else "to"
    return f"moved {direction} {', '.join(function.moved_with)}"
