"""The part of a report that `overhead`, `profile`, `latency` and `plan` give."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from mjbench.comparison.plan import Variant
from mjbench.comparison.planning_run import PlanningRow
from mjbench.loop.latency import LatencyRow, Pace, histogram_quantiles
from mjbench.loop.overhead import OverheadRow
from mjbench.loop.profile import ProfileRow, StepProfile
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import planning, tables, vega
from mjbench.report.starts import starts_lines
from mjbench.simulation import package_timer
from mjbench.status import Status

# Habits that are drawn: those that add most.
_MOST_HABITS = 12
# Latency is drawn at the shares of steps that are one in so many.
_ONE_IN = np.logspace(0, 4, 41)
_PACES = {Pace.FREE.value: vega.BLUE, Pace.PACED.value: vega.ORANGE}


def overhead_sections(rows: Sequence[OverheadRow], command: str) -> Iterator[Section]:
    """Yield a section for each model whose loop was measured, or was to be."""
    for row in rows:
        if row.is_measured:
            yield _overhead_section(row, command)
        else:
            yield _failure(row.model, row.status, row.detail, command)


def profile_sections(rows: Sequence[ProfileRow], command: str) -> Iterator[Section]:
    """Yield a section for each model that was profiled, or was to be."""
    for row in rows:
        profile = row.profile()
        if profile is None:
            yield _failure(row.model, row.status, row.detail, command)
        else:
            yield _profile_section(profile, command)


def _failure(model: str, status: Status, detail: str, command: str) -> Section:
    """Return the section of a model that could not be measured."""
    return Section(model, command, [Conclusion(f"{model}: {status}: {detail}", Tone.BAD)])


def _overhead_section(table: OverheadRow, command: str) -> Section:
    """Return what a bare loop and the habits beside it cost for one model."""
    assert table.bare_ns is not None and table.engine_ns is not None and table.costs is not None
    python_ns = table.bare_ns - table.engine_ns
    conclusions = [
        Conclusion(
            f"{table.model}: a step of the bare loop takes {table.bare_ns:,.0f} ns, of which the"
            f" engine has {table.engine_ns:,.0f} and Python {python_ns:,.0f}"
        )
    ]
    if table.costs and table.costs[0].low > 0:
        cost = table.costs[0]
        remedy = f"; `{cost.cheaper}` does the same for less" if cost.cheaper else ""
        conclusions.append(
            Conclusion(
                f"{table.model}: the most expensive habit is {cost.source}: {cost.ns:,.0f} ns a"
                f" step, {100 * cost.share:.0f} % of it{remedy}",
                Tone.UNSURE,
            )
        )
    columns = (
        Column("in the loop"),
        Column("adds ns/step", 4),
        Column("low", 4),
        Column("high", 4),
        Column("% of a step", 3),
        Column("cheaper"),
        Column("saves ns", 4),
    )
    rows = [
        (c.source, c.ns, c.low, c.high, 100 * c.share, c.cheaper, c.saved_ns) for c in table.costs
    ]
    return Section(
        heading=f"{table.model}: what a Python loop wastes",
        command=command,
        conclusions=conclusions,
        notes=starts_lines(table.starts),
        figures=[_waterfall(table)],
        tables=[DataTable("Habits", columns, rows)],
    )


def _waterfall(table: OverheadRow) -> Figure:
    """Return a step, part by part: the engine, the loop, and then each habit on top of it."""
    assert table.bare_ns is not None and table.engine_ns is not None and table.costs is not None
    columns = (Column("part"), Column("from", 4), Column("to", 4), Column("kind"))
    loop = table.bare_ns
    rows: list[tuple[str, float, float, str]] = [
        ("engine", 0.0, table.engine_ns, "step"),
        ("Python loop", table.engine_ns, loop, "step"),
    ]
    rows += [
        (f"+ {cost.source}", loop, loop + max(0.0, cost.ns), "habit")
        for cost in table.costs[:_MOST_HABITS]
    ]
    data = DataTable("Nanoseconds of a step", columns, rows)
    layer: vega.Spec = {
        "mark": {"type": "bar", "height": 12},
        "encoding": {
            "x": charts.quantity("from", "ns of a step", zero=True),
            "x2": {"field": "to"},
            "y": charts.names("part"),
            "color": charts.colour("kind", {"step": vega.BLUE, "habit": vega.ORANGE}),
        },
    }
    return Figure(
        title=f"{table.model}: a step, and what each habit adds to it",
        alternative=f"The engine takes {table.engine_ns:,.0f} ns; the loop ends at {loop:,.0f} ns;"
        " habits begin there.",
        specification=charts.chart(data, [layer]),
        data=data,
    )


def _profile_section(profile: StepProfile, command: str) -> Section:
    """Return where the time of a model's step goes."""
    steps = profile.steps
    share = steps.engine_ns / steps.loop_ns
    columns = (Column("stage"), Column("% of the engine", 3), Column("ns", 4))
    rows = [
        (stage, 100 * part, part * steps.engine_ns)
        for stage, part in sorted(steps.stages.items(), key=lambda item: -item[1])
        if part > 0
    ]
    data = DataTable("Stages of a step", columns, rows)
    layer: vega.Spec = {
        "mark": {"type": "bar", "height": 12, "color": vega.BLUE},
        "encoding": {
            "x": charts.quantity("ns", "ns of a step", zero=True),
            "y": charts.names("stage"),
        },
    }
    conclusions = [
        Conclusion(
            f"{profile.model}: a step of a Python loop takes {steps.loop_ns:,.0f} ns,"
            f" {100 * share:.0f} % of it in the engine"
        )
    ]
    if steps.clock_ns and steps.clock_ns >= package_timer.MIN_GAIN * steps.loop_ns:
        conclusions.append(
            Conclusion(
                f"{profile.model}: {package_timer.NAME} takes"
                f" {100 * steps.clock_ns / steps.loop_ns:.0f} % of it;"
                f" {package_timer.OFF_CODE} turns it off",
                Tone.UNSURE,
            )
        )
    figure = Figure(
        title=f"{profile.model}: stages of a step",
        alternative=charts.bars("stages", rows),
        specification=charts.chart(data, [layer]),
        data=data,
    )
    return Section(
        heading=f"{profile.model}: where a step's time goes",
        command=command,
        conclusions=conclusions,
        notes=[*starts_lines(steps.starts, False), *tables.warning_lines(steps.warnings)],
        figures=[figure],
    )


def latency_sections(rows: Sequence[LatencyRow], command: str) -> Iterator[Section]:
    """Yield a section for each model whose single steps were timed."""
    for model, group in itertools.groupby(rows, lambda row: row.model):
        of_model = list(group)
        if of_model[0].work is None:
            yield _failure(model, of_model[0].status, of_model[0].detail, command)
            continue
        yield Section(
            heading=f"{model}: latency of single steps",
            command=command,
            conclusions=[_missed(row) for row in of_model],
            notes=starts_lines(of_model[0].starts),
            figures=[_latency_figure(model, of_model)],
            tables=[_latency_table(of_model)],
        )


def _missed(row: LatencyRow) -> Conclusion:
    assert row.deadline_s is not None, "it was measured"
    missed = row.missed or 0
    steps = f"{missed:,} of {row.nstep:,} steps missed {1e3 * row.deadline_s:g} ms"
    return Conclusion(f"{row.model}, {row.pace}: {steps}", Tone.BAD if missed else Tone.GOOD)


def _latency_table(rows: Sequence[LatencyRow]) -> DataTable:
    quantiles = [f"p{100 * q.quantile:g}, µs" for q in rows[0].quantiles]
    columns = (
        Column("pace"),
        Column("steps", 4),
        *(Column(name, 4) for name in quantiles),
        Column("max, µs", 4),
        Column("missed", 4),
    )
    cells = [
        (
            str(row.pace),
            row.nstep,
            *(q.ns / 1e3 for q in row.quantiles),
            (row.max_ns or 0.0) / 1e3,
            row.missed,
        )
        for row in rows
    ]
    return DataTable("Latency", columns, cells)


def _latency_figure(model: str, rows: Sequence[LatencyRow]) -> Figure:
    columns = (Column("one step in", 4), Column("latency, µs", 4), Column("pace"))
    cells = [
        (float(one_in), ns / 1e3, str(row.pace))
        for row in rows
        for one_in, ns in zip(
            _ONE_IN, histogram_quantiles(row.histogram, (1 - 1 / _ONE_IN).tolist()), strict=True
        )
        if one_in <= (row.nstep or 0)
    ]
    data = DataTable("Latency by share of steps", columns, cells)
    layer: vega.Spec = {
        "mark": {"type": "line", "interpolate": "step-after"},
        "encoding": {
            "x": charts.quantity("one step in", "one step in so many is slower", log=True),
            "y": charts.quantity("latency, µs", "latency, µs", log=True),
            "color": charts.colour("pace", _PACES),
        },
    }
    longest = max((row.max_ns or 0.0) / 1e3 for row in rows)
    return Figure(
        title=f"{model}: latency of single steps",
        alternative=f"Lines that rise from the usual step to the slowest, {longest:,.0f} µs.",
        specification=charts.chart(data, [layer], height=240),
        data=data,
    )


def planning_sections(rows: Sequence[PlanningRow], command: str) -> Iterator[Section]:
    """Yield a section for each model and size of plans."""
    for (model, samples, horizon), group in itertools.groupby(
        rows, lambda row: (row.model, row.samples, row.horizon)
    ):
        of_size = [row for row in group if row.status != Status.UNAVAILABLE]
        timed = [row for row in of_size if row.plans_per_s is not None]
        conclusions = [
            Conclusion(
                f"{model}: {Variant(row.path, row.options)}: {row.status}: {row.detail}", Tone.BAD
            )
            for row in of_size
            if row.status != Status.OK
        ]
        if timed:
            fastest = planning.fastest_of(timed)
            variant = Variant(fastest.path, fastest.options)
            text = (
                f"{model}: fastest here is {variant}, {fastest.plans_per_s:,.0f} plans per second"
            )
            conclusions.append(Conclusion(text))
        yield Section(
            heading=f"{model}: plans of {samples} samples × {horizon} steps",
            command=command,
            conclusions=conclusions,
            tables=[_planning_table(of_size)],
        )


def _planning_table(rows: Sequence[PlanningRow]) -> DataTable:
    columns = (
        Column("path"),
        Column("ms/plan", 3),
        Column("plans/s", 4),
        Column("speed-up", 3),
        Column("status"),
    )
    cells = [
        (
            str(Variant(row.path, row.options)),
            None if row.plan_s is None else 1e3 * row.plan_s,
            row.plans_per_s,
            row.speedup,
            row.status.value,
        )
        for row in rows
    ]
    return DataTable("Plans", columns, cells)
