"""What `mjbench plan` comes to."""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import Variant, describe_options
from mjbench.comparison.planning_run import PlanningRow
from mjbench.report import formats
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.report.starts import capture_lines
from mjbench.status import Status
from mjbench.units import plain


def sections(rows: Sequence[PlanningRow]) -> Iterator[Section]:
    for _, group in itertools.groupby(rows, lambda row: (row.model, row.samples, row.horizon)):
        yield section(list(group))
    yield from sizes_sections(rows)


def section(rows: Sequence[PlanningRow]) -> Section:
    first = rows[0]
    of_size = [row for row in rows if row.status != Status.UNAVAILABLE]
    conclusions = [
        Conclusion(f"{first.model}: {_variant(row)}: {row.status}: {row.detail}", Tone.BAD)
        for row in of_size
        if row.status != Status.OK
    ]
    if fastest := fastest_of(of_size):
        conclusions.append(Conclusion(_fastest_text(fastest)))
    facts = [
        f"{first.task}, {_outcome(first)} {first.algorithm} with {first.samples} samples ×"
        f" {first.horizon} steps, {first.nplan} plans"
    ]
    if first.starts is not None:
        facts += [f"Plans start from states of {first.starts.file}", *capture_lines(first.starts)]
    return Section(
        heading=f"{first.model}: plans of {first.samples} samples × {first.horizon} steps",
        conclusions=conclusions,
        facts=facts,
        tables=[_table(of_size)],
        notes=[
            f"{_variant(row)}: {row.status}: {row.detail}"
            for row in rows
            if row.status == Status.UNAVAILABLE
        ],
    )


def _variant(row: PlanningRow) -> Variant:
    return Variant(row.path, row.options)


def _outcome(row: PlanningRow) -> str:
    """Return whether a task was achieved, as words before the name of the planner."""
    match row.achieved:
        case None if row.starts is not None:
            return "each plan from another state, by"
        case None:
            return "ended by the budget, by"
        case True:
            return "achieved by"
        case False:
            return "not achieved by"


def fastest_of(rows: Sequence[PlanningRow]) -> PlanningRow | None:
    """Return the row of the path that is fastest beside the plain loop; None where none has one."""
    timed = [row for row in rows if row.plans_per_s is not None]
    return max(timed, key=lambda row: row.speedup or 0.0, default=None)


def _fastest_text(fastest: PlanningRow) -> str:
    plans_per_s, control_hz = fastest.plans_per_s, fastest.control_hz
    assert plans_per_s is not None, "it was timed"
    text = (
        f"{fastest.model}: fastest here is {_variant(fastest)}, {plans_per_s:,.0f} plans per"
        f" second, {formats.factor(fastest.speedup or 1.0)}× the plain loop in this process"
    )
    if control_hz is None:
        return text
    rate = plain(control_hz, 3)
    if plans_per_s >= control_hz:
        return f"{text}; it keeps up with {rate} controls per second"
    share = plain(plans_per_s / control_hz, 2)
    return f"{text}; it makes {share} of the {rate} plans per second that real time needs"


def _table(rows: Sequence[PlanningRow]) -> DataTable:
    return DataTable.of(
        "Plans",
        rows,
        (Column("path"), lambda row: row.path),
        (Column("options"), lambda row: describe_options(row.options)),
        (
            Column("ms/plan", formats.digits(3)),
            lambda row: None if row.plan_s is None else 1e3 * row.plan_s,
        ),
        (Column("plans/s", formats.count), lambda row: row.plans_per_s),
        (Column("speed-up", formats.factor), lambda row: row.speedup),
        (Column("same plans"), _agreement),
    )


def _agreement(row: PlanningRow) -> str:
    if row.plan_s is not None:
        return "yes"
    return "NO" if row.status == Status.DISAGREES else row.status.value


def sizes_sections(rows: Sequence[PlanningRow]) -> Iterator[Section]:
    """Yield the fastest path at each size of a model's plans, where there are several sizes."""
    for model in dict.fromkeys(row.model for row in rows):
        by_size = defaultdict[tuple[int, int], list[PlanningRow]](list)
        for row in rows:
            if row.model == model:
                by_size[row.samples, row.horizon].append(row)
        fastest = [best for of_size in by_size.values() if (best := fastest_of(of_size))]
        if len(fastest) < 2:
            continue
        table = DataTable.of(
            "Sizes",
            fastest,
            (Column("samples", formats.count), lambda row: row.samples),
            (Column("steps", formats.count, leaves=2), lambda row: row.horizon),
            (Column("plans/s", formats.count), lambda row: row.plans_per_s),
            (Column("real time needs", formats.digits(3), leaves=1), lambda row: row.control_hz),
            (
                Column("achieved"),
                lambda row: None if row.achieved is None else formats.yes_no(row.achieved),
            ),
            (Column("fastest here"), lambda row: str(_variant(row))),
        )
        yield Section(f"{model}, by the size of the plan", tables=[table])
