"""The charts of `compare`: speed-ups of paths, and speeds by the number of simulations."""

import itertools
from collections.abc import Iterator, Sequence

from mjbench import formats
from mjbench.commands.compare.results import ModelResults
from mjbench.paired.race_record import Loop
from mjbench.results import charts
from mjbench.results.content import Column, DataTable, Figure

# Colours of paths by whether a policy can choose each control.
_LOOPS = {Loop.OPEN.value: charts.ORANGE, Loop.CLOSED.value: charts.BLUE}
_AXIS = "times as fast as the plain loop"


def speedup_figures(model_results: ModelResults) -> Iterator[Figure]:
    """Yield speed-ups as bars, with their intervals as lines; nothing without any."""
    timed = [(r.speedup.estimate, r) for r in model_results.results if r.speedup is not None]
    if not timed:
        return
    timed.sort(key=lambda row: -row[0])
    model = model_results.model.model
    data = DataTable.of(
        "Speed-ups",
        timed,
        (Column("path"), lambda row: str(row[1].variant)),
        (Column("speed-up", formats.factor), lambda row: row[0]),
        (Column("low", formats.factor), lambda row: i.low if (i := row[1].interval) else None),
        (Column("high", formats.factor), lambda row: i.high if (i := row[1].interval) else None),
        (Column("loop"), lambda row: row[1].loop.value),
    )
    y = charts.names(data)
    bars = {
        "x": charts.quantity("speed-up", _AXIS, zero=True),
        "y": y,
        "color": charts.colour("loop", _LOOPS, "loop"),
    }
    layers = [charts.rule_at(1.0), charts.layer("bar", bars, height=10)]
    intervals = ""
    if any(row[2] is not None for row in data.rows):
        intervals = " Lines are 95 % intervals."
        ends = {"x": charts.quantity("low", _AXIS, zero=True), "x2": {"field": "high"}, "y": y}
        lines = charts.layer("rule", ends, strokeWidth=2, color="currentColor")
        layers.append({**lines, "transform": [{"filter": "isValid(datum.low)"}]})
    speedup, fastest = timed[0]
    yield charts.figure(
        f"{model}: speed-up over the plain loop",
        f"Bars of {len(timed)} paths; the longest is {fastest.variant}, {speedup:.2f}×.{intervals}",
        data,
        layers,
    )


def advice_figure(models: Sequence[ModelResults]) -> Figure:
    """Return the speed-ups of what is advised, with their intervals, the largest first."""
    advised = [
        (f"{row.result.model}, {row.loop.value} loop", row.speedup, row.loop)
        for model_results in models
        for row in model_results.advice
        if row.speedup is not None
    ]
    advised.sort(key=lambda row: -row[1].estimate)
    data = DataTable.of(
        "Speed-ups of what is advised",
        advised,
        (Column("advice"), lambda row: row[0]),
        (Column("speed-up", formats.factor), lambda row: row[1].estimate),
        (Column("low", formats.factor), lambda row: row[1].low),
        (Column("high", formats.factor), lambda row: row[1].high),
        (Column("loop"), lambda row: row[2].value),
    )
    shared = {"y": charts.names(data), "color": charts.colour("loop", _LOOPS, "loop")}
    return charts.figure(
        "What is advised, and how much faster it is",
        f"{len(advised)} speed-ups with their 95 % intervals.",
        data,
        [charts.rule_at(1.0), *charts.estimates("speed-up", _AXIS, shared)],
    )


def crossover_figure(name: str, models: Sequence[ModelResults]) -> Figure:
    data = DataTable.of(
        "Speeds by the number of simulations",
        [
            result
            for model_results in models
            if model_results.model.model == name
            for result in model_results.results
            if result.steps_per_s and result.nbatch
        ],
        (Column("simulations", formats.count), lambda result: result.nbatch),
        (Column("steps per second", formats.count), lambda result: result.steps_per_s),
        (Column("path"), lambda result: str(result.variant)),
    )
    palette = (charts.BLUE, charts.ORANGE, charts.GREEN, charts.SKY, charts.PINK, charts.GREY)
    paths = dict.fromkeys(str(row[2]) for row in data.rows)
    colours = dict(zip(paths, itertools.cycle(palette), strict=False))
    lines = {
        "x": charts.quantity("simulations", "simulations", log=True),
        "y": charts.quantity("steps per second", "steps per second", log=True),
        "color": charts.colour("path", colours),
    }
    return charts.figure(
        f"{name}: speed by the number of simulations",
        f"Lines of {len(paths)} paths over {len({row[0] for row in data.rows})} sizes.",
        data,
        [charts.layer("line", lines, point=True)],
        height=260,
    )
