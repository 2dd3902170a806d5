"""The charts of `compare`: speed-ups of paths, and speeds by the number of simulations."""

from collections.abc import Iterator, Sequence

from mjbench.comparison.plan import Variant
from mjbench.paired.race_record import Loop
from mjbench.paths import BASE
from mjbench.report import charts, formats
from mjbench.report.content import Column, DataTable, Figure
from mjbench.report.results import ModelResults, PathResult

# Colours of paths by whether a policy can choose each control.
_LOOPS = {Loop.OPEN.value: charts.ORANGE, Loop.CLOSED.value: charts.BLUE}


def _ends(result: PathResult) -> tuple[float | None, float | None, float | None]:
    """Return a path's speed-up, and the ends of its interval."""
    speedup = result.speedup
    if speedup is None:
        return None, None, None
    if result.variant == Variant(BASE, {}):  # 1 by definition
        return speedup.estimate, None, None
    return speedup.estimate, speedup.low, speedup.high


def speedup_figures(model_results: ModelResults) -> Iterator[Figure]:
    """Yield speed-ups as bars, with their intervals as lines; nothing without any."""
    timed = [r for r in model_results.results if r.speedup is not None]
    if not timed:
        return
    model = model_results.model.model
    columns = (
        Column("path"),
        *(Column(title, formats.factor) for title in ("speed-up", "low", "high")),
        Column("loop"),
    )
    rows = [
        (str(r.variant), *_ends(r), (Loop.CLOSED if r.closed_loop else Loop.OPEN).value)
        for r in timed
    ]
    data = DataTable("Speed-ups", columns, rows)
    fastest = max(rows, key=lambda row: float(row[1] or 0.0))
    x = charts.quantity("speed-up", "times as fast as the plain loop", zero=True)
    y = charts.names(data)
    layers: list[charts.Spec] = [
        charts.rule_at(1.0),
        {
            "mark": {"type": "bar", "height": 10},
            "encoding": {"x": x, "y": y, "color": charts.colour("loop", _LOOPS, "loop")},
        },
    ]
    intervals = ""
    if any(row[2] is not None for row in rows):
        intervals = " Lines are 95 % intervals."
        layers.append(
            {
                "mark": {"type": "rule", "strokeWidth": 2, "color": "currentColor"},
                "transform": [{"filter": "isValid(datum.low)"}],
                "encoding": {
                    "x": charts.quantity("low", "times as fast as the plain loop", zero=True),
                    "x2": {"field": "high"},
                    "y": y,
                },
            }
        )
    yield Figure(
        title=f"{model}: speed-up over the plain loop",
        alternative=f"Bars of {len(rows)} paths; the longest is {fastest[0]}, {fastest[1]:.2f}×."
        f"{intervals}",
        specification=charts.chart(data, layers),
        data=data,
    )


def crossover_figure(name: str, models: Sequence[ModelResults]) -> Figure:
    """Return the speeds of paths on a model by the number of simulations."""
    columns = (
        Column("simulations", formats.count),
        Column("steps per second", formats.count),
        Column("path"),
    )
    rows = [
        (r.nbatch, r.steps_per_s, str(r.variant))
        for model_results in models
        if model_results.model.model == name
        for r in model_results.results
        if r.steps_per_s and r.nbatch
    ]
    data = DataTable("Speeds by the number of simulations", columns, rows)
    palette = (charts.BLUE, charts.ORANGE, charts.GREEN, charts.SKY, charts.PINK, charts.GREY)
    paths = list(dict.fromkeys(row[2] for row in rows))
    colours = {path: palette[i % len(palette)] for i, path in enumerate(paths)}
    layer: charts.Spec = {
        "mark": {"type": "line", "point": True},
        "encoding": {
            "x": charts.quantity("simulations", "simulations", log=True),
            "y": charts.quantity("steps per second", "steps per second", log=True),
            "color": charts.colour("path", colours),
        },
    }
    return Figure(
        title=f"{name}: speed by the number of simulations",
        alternative=f"Lines of {len(paths)} paths over {len({row[0] for row in rows})} sizes.",
        specification=charts.chart(data, [layer], height=260),
        data=data,
    )
