"""Reports of environments: where a step goes, the same physics without it, vectorised forms."""

from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import describe_options
from mjbench.environment.records import EnvironmentRecord
from mjbench.instrument.stats import Estimate
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import environment, vega
from mjbench.report.environment_results import EnvironmentRow, derive
from mjbench.status import Status


def sections(records: Sequence[EnvironmentRecord], command: str) -> Iterator[Section]:
    """Yield a section for each environment that was measured, or was to be."""
    for record in records:
        row = derive(record)
        if row.facts is None or row.step_ns is None:
            text = f"{row.environment}: {row.status}: {row.detail}"
            yield Section(row.environment, command, [Conclusion(text, Tone.BAD)])
        else:
            yield _section(row, command)


def _section(row: EnvironmentRow, command: str) -> Section:
    conclusions = [Conclusion(text) for text in environment.conclusions(row)]
    if row.check is not None and row.check.status == Status.DISAGREES:
        text = f"{row.environment}: {environment.physics_lines(row)[0]}"
        conclusions.insert(0, Conclusion(text, Tone.BAD))
    tables = [_functions(row)]
    if any(path.speedup for path in row.paths):
        tables.append(_paths(row))
    if any(vector.speedup for vector in row.vectors):
        tables.append(_vectors(row))
    return Section(
        heading=f"{row.environment}: where a step's time goes",
        command=command,
        conclusions=conclusions,
        figures=[_figure(row)],
        tables=tables,
        notes=[
            environment.reset_line(row),
            *environment.timing_lines(row),
            *environment.physics_lines(row),
            *environment.notes(row),
        ],
    )


def _figure(row: EnvironmentRow) -> Figure:
    columns = (Column("layer"), Column("% of env.step", 3), Column("µs", 3))
    rows = [
        (layer.layer.value, 100 * layer.share.median, layer.ns / 1e3)
        for layer in row.layers
        if layer.share.median > 0
    ]
    data = DataTable("Layers of a step", columns, rows)
    layer: vega.Spec = {
        "mark": {"type": "bar", "height": 12, "color": vega.BLUE},
        "encoding": {
            "x": charts.quantity("µs", "µs of env.step", zero=True),
            "y": charts.names("layer"),
        },
    }
    return Figure(
        title=f"{row.environment}: layers of a step",
        alternative=charts.bars("layers", rows),
        specification=charts.chart(data, [layer]),
        data=data,
    )


def _functions(row: EnvironmentRow) -> DataTable:
    columns = (
        Column("layer"),
        Column("function"),
        Column("calls per step", 3),
        Column("% of env.step", 2),
    )
    rows = [
        (layer.layer.value, function.name, function.calls, 100 * max(0.0, function.share))
        for layer in row.layers
        for function in layer.functions
    ]
    return DataTable("Functions of a step", columns, rows)


def _paths(row: EnvironmentRow) -> DataTable:
    columns = (
        Column("path"),
        Column("options"),
        Column("env steps/s", 4),
        Column("engine steps/s", 4),
        Column("× env.step", 3),
        Column("low", 3),
        Column("high", 3),
        Column("loop"),
    )
    rows = [
        (
            path.path,
            describe_options(path.options),
            path.env_steps_per_s,
            path.steps_per_s,
            *_cells(path.speedup),
            "closed" if path.closed_loop else "open",
        )
        for path in row.paths
        if path.speedup is not None
    ]
    return DataTable("The same physics without the environment", columns, rows)


def _vectors(row: EnvironmentRow) -> DataTable:
    columns = (
        Column("form"),
        Column("environments", 3),
        Column("env steps/s", 4),
        Column("× one", 3),
        Column("low", 3),
        Column("high", 3),
        Column("added to a step, µs", 3),
    )
    rows = [
        (
            vector.form.value,
            vector.nenv,
            vector.env_steps_per_s,
            *_cells(vector.speedup),
            None if vector.overhead_ns is None else vector.overhead_ns / 1e3,
        )
        for vector in row.vectors
        if vector.speedup is not None
    ]
    return DataTable("Several environments at once", columns, rows)


def _cells(estimate: Estimate) -> tuple[float, float | None, float | None]:
    return estimate.median, estimate.low, estimate.high
