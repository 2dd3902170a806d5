"""What counts of instructions come to, and what explains a difference of releases."""

from collections.abc import Iterator, Sequence

from mjbench import formats
from mjbench.counts.explain import largest_differences, moved_groups
from mjbench.counts.records import ExplainRecord, FunctionDifference, InstructionsRecord
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


def explanations(rows: Sequence[ExplainRecord], top: int = _MOST_LISTED) -> Iterator[Section]:
    """Yield what changed from one release to another, with the first functions of each."""
    for row in rows:
        heading = f"{row.series}, MuJoCo {row.old} → {row.new}"
        if row.status == Status.OK:
            yield _explanation(heading, row, top)
        else:
            yield Section(heading, [Conclusion(f"{heading}: {row.detail}", Tone.BAD)])


def _explanation(heading: str, row: ExplainRecord, top: int) -> Section:
    first, *rest = summary(row)
    further = row.functions[top:]
    difference = sum(function.difference for function in further)
    share = 100 * difference / (row.instructions_per_step.new or 1.0)
    note = f"{len(further)} further functions: {difference:+,.0f} ({share:+.2f} %)"
    warnings = [(row.old, row.warnings.old), (row.new, row.warnings.new)] if row.warnings else []
    return Section(
        heading,
        [Conclusion(f"{heading}: {first}")],
        facts=[
            *rest,
            *(f"MuJoCo {name}: {line}" for name, each in warnings for line in warning_lines(each)),
        ],
        figures=_figures(heading, row),
        tables=[_stages_table(row), _functions_table(row, top)],
        notes=[note] if further else [],
    )


def summary(row: ExplainRecord) -> list[str]:
    """Return what changed, a line each: first by how much, then in what."""
    old, new = row.instructions_per_step.old, row.instructions_per_step.new
    assert old and new, "both were counted"
    counts = f"instructions per step {old:,.0f} → {new:,.0f} ({formats.change(new / old)})"
    time = row.time
    lines = [
        f"{_describe_time(time, time.ratio)}; {counts}" if time and time.ratio else counts,
        "changed work: " + ", ".join(row.changes) if row.changes else "same work",
    ]
    return lines + _move_lines(row) + (_time_lines(time, new / old) if time else [])


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


def _figures(heading: str, row: ExplainRecord) -> list[Figure]:
    """Return the chart of the functions that changed most; none where none did."""
    changes = largest_differences(row.functions, _MOST_DRAWN)
    if not changes:
        return []
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
    figure = charts.figure(
        f"{heading}: functions that account for most of the change",
        f"Bars of {len(changes)} functions; the largest change is that of"
        f" {' and '.join(largest.names)}, {100 * largest.difference / total:+.1f} % of {whole}.",
        data,
        [charts.rule_at(0.0), charts.layer("bar", bars, height=12)],
    )
    return [figure]


def _remarks(function: FunctionDifference) -> str:
    if not function.moved_with:
        return ""
    direction = "from" if function.difference > 0 else "to"
    return f"moved {direction} {', '.join(function.moved_with)}"
