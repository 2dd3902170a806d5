"""Reports of environments: where a step goes, the same physics without it, vectorised forms."""

from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import describe_options
from mjbench.environment.records import EnvironmentRecord
from mjbench.instrument.stats import Estimate
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import environment, vega
from mjbench.status import Status


def sections(records: Sequence[EnvironmentRecord], command: str) -> Iterator[Section]:
    """Yield a section for each environment that was measured, or was to be."""
    for record in records:
        if record.facts is None or record.step is None:
            text = f"{record.environment}: {record.status}: {record.detail}"
            yield Section(record.environment, command, [Conclusion(text, Tone.BAD)])
        else:
            yield _section(record, command)


def _section(record: EnvironmentRecord, command: str) -> Section:
    conclusions = [Conclusion(text) for text in environment.conclusions(record)]
    if record.check is not None and record.check.status == Status.DISAGREES:
        text = f"{record.environment}: {environment.physics_lines(record)[0]}"
        conclusions.insert(0, Conclusion(text, Tone.BAD))
    tables = [_functions(record)]
    if any(path.speedup for path in record.physics_paths):
        tables.append(_paths(record))
    if any(vector.speedup for vector in record.vector_forms):
        tables.append(_vectors(record))
    return Section(
        heading=f"{record.environment}: where a step's time goes",
        command=command,
        conclusions=conclusions,
        figures=[_figure(record)],
        tables=tables,
        notes=[
            environment.reset_line(record),
            *environment.timing_lines(record),
            *environment.physics_lines(record),
            *environment.notes(record),
        ],
    )


def _figure(record: EnvironmentRecord) -> Figure:
    columns = (Column("layer"), Column("% of env.step", 3), Column("µs", 3))
    rows = [
        (layer.layer.value, 100 * layer.share.median, layer.ns / 1e3)
        for layer in record.layer_shares
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
        title=f"{record.environment}: layers of a step",
        alternative=charts.bars("layers", rows),
        specification=charts.chart(data, [layer]),
        data=data,
    )


def _functions(record: EnvironmentRecord) -> DataTable:
    columns = (
        Column("layer"),
        Column("function"),
        Column("calls per step", 3),
        Column("% of env.step", 2),
    )
    rows = [
        (layer.layer.value, function.name, function.calls, 100 * max(0.0, function.share))
        for layer in record.layer_shares
        for function in layer.functions
    ]
    return DataTable("Functions of a step", columns, rows)


def _paths(record: EnvironmentRecord) -> DataTable:
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
        for path in record.physics_paths
        if path.speedup is not None
    ]
    return DataTable("The same physics without the environment", columns, rows)


def _vectors(record: EnvironmentRecord) -> DataTable:
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
        for vector in record.vector_forms
        if vector.speedup is not None
    ]
    return DataTable("Several environments at once", columns, rows)


def _cells(estimate: Estimate) -> tuple[float, float | None, float | None]:
    return estimate.median, estimate.low, estimate.high
