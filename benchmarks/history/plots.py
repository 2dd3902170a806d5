"""Plots of models over the releases, as SVG: time, instructions, work and drift, aligned.

Each plot is a Vega-Lite specification (see `charts`).
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.history import release_ratios
from benchmarks.history.change_points import MIN_DEVIATIONS
from benchmarks.history.speed_history import SpeedHistory
from benchmarks.history.speed_series import MeasuredRelease, SpeedSeries
from mjbench import formats
from mjbench.errors import writing
from mjbench.results import charts
from mjbench.results.charts import BLUE, GREEN, GREY, ORANGE, Spec
from mjbench.results.content import Column, DataTable, Figure

_WIDTH, _HEIGHT, _TIME_HEIGHT = 720, 80, 170
# No labels of an axis overlap, also in a wide font.
_TICK_HEIGHT = 24
_TICKS = {"labelOverlap": "greedy", "labelSeparation": 4}
# An error bar reaches as many standard errors to either side.
_BAR_DEVIATIONS = 2.0
# Smaller drifts are rounding, or none; they are drawn here.
_LEAST_DRIFT = 1e-17
# What is plotted of the work of a step; the sizes of the model do not change with releases.
_COUNTERS = ("contacts", "constraints", "solver_iterations")
_WORK_TICKS = 0, 2, *(10**n for n in range(1, 7))

Row = dict[str, Any]


def draw(history: SpeedHistory, folder: Path) -> None:
    """Draw a plot of each model as an SVG file in a folder, which is created.

    Raises:
      MachineError: vl-convert-python is not installed, or the folder cannot be written.
    """
    svgs = [charts.svg(specification(history, series)) for series in history.models]
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for series, svg in zip(history.models, svgs, strict=True):
        file = folder / file_name(series.name)
        with writing(file):
            file.write_text(svg, encoding="utf-8")


def file_name(model: str) -> str:
    """Return the name of a model's plot; that of a file may hold any characters."""
    return re.sub(r"[^\w.-]+", "-", model) + ".svg"


def figure(history: SpeedHistory, series: SpeedSeries) -> Figure:
    data = DataTable.of(
        series.name,
        series.measured,
        (Column("release"), lambda each: each.release),
        (Column("ratio", formats.digits(4)), lambda each: each.ratio.ratio),
        (Column("standard error", formats.digits(2)), lambda each: each.ratio.deviation),
        (
            Column("contacts", formats.digits(4)),
            lambda each: each.step_work.contacts if each.step_work else None,
        ),
        (Column("drift of one step", formats.digits(2)), lambda each: each.record.drift),
    )
    first, last = series.measured[0], series.measured[-1]
    return Figure(
        title=series.name,
        alternative=f"A step took {first.ratio.ratio:.2f} times as long in {first.release} as in"
        f" the reference, and {last.ratio.ratio:.2f} times as long in {last.release}. Diamonds are"
        " change points.",
        specification={**specification(history, series), **charts.page_colours()},
        data=data,
    )


def specification(history: SpeedHistory, series: SpeedSeries) -> Spec:
    releases, measured = history.releases(), series.measured
    reference = series.measured[-1].record.reference
    counts = history.instructions(series.name)
    instructions = [
        {"release": release, "value": counts[release] / 1000}
        for release in releases
        if release in counts
    ]
    work = [
        {"release": each.release, "counter": name.replace("_", " "), "value": getattr(done, name)}
        for each in measured
        if (done := each.step_work) is not None
        for name in _COUNTERS
    ]
    drifts = [
        {"release": each.release, "value": max(drift, _LEAST_DRIFT)}
        for each in measured
        if (drift := each.record.drift) is not None and math.isfinite(drift)
    ]
    count_line = charts.layer("line", {"y": _value(zero=False)}, color=BLUE, point={"color": BLUE})
    panels = [
        _panel(f"time ({reference} = 1)", _times(series, measured), _time_layers(), _TIME_HEIGHT),
        _panel("instructions (k)", instructions, [count_line]),
        _panel("work per step", work, [_counters(work)]),
        _panel("drift of one step", drifts, [_drift_points()]),
    ]
    panels = [panel for panel in panels if panel["data"]["values"]]
    for panel in panels:
        is_last = panel is panels[-1]
        axis = {"labelAngle": -90, "title": None, "labels": is_last, "ticks": is_last}
        for layer in panel["layer"]:
            layer["encoding"]["x"] = {
                "field": "release",
                "type": "ordinal",
                "scale": {"domain": releases},
                "axis": axis,
            }
    return {
        "$schema": charts.SCHEMA,
        "title": {"text": series.name, "anchor": "start"},
        "background": "white",
        "spacing": 10,
        # the legend's texts fit in a wider font than the one that lays them out, too
        "padding": {"left": 5, "top": 5, "right": 30, "bottom": 5},
        "vconcat": panels,
        "resolve": {"scale": {"color": "independent"}},
        "config": {"axis": {"grid": True, "gridOpacity": 0.5, "titleFontWeight": "normal"}},
    }


def _panel(title: str, rows: list[Row], layers: list[Spec], height: int = _HEIGHT) -> Spec:
    for layer in layers:
        y = layer["encoding"]["y"]
        y["title"] = None
        y["axis"] = {"tickCount": height // _TICK_HEIGHT, **_TICKS, **y.get("axis", {})}
    return {
        "title": {"text": title, "anchor": "start", "fontSize": 11, "fontWeight": "normal"},
        "width": _WIDTH,
        "height": height,
        "data": {"values": rows},
        "layer": layers,
    }


def _times(series: SpeedSeries, measured: Sequence[MeasuredRelease]) -> list[Row]:
    changed = {series.measured[point.index].release for point in series.changes.change_points}
    return [
        {
            "release": each.release,
            "ratio": each.ratio.ratio,
            "low": math.exp(each.ratio.log_ratio - _BAR_DEVIATIONS * each.ratio.deviation),
            "high": math.exp(each.ratio.log_ratio + _BAR_DEVIATIONS * each.ratio.deviation),
            "shipped": _shipped(each),
            "change point": each.ratio.ratio if each.release in changed else None,
        }
        for each in measured
    ]


def _shipped(measured: MeasuredRelease) -> float:
    """Return the ratio as shipped where it certainly differs, and the averaged one otherwise."""
    shipped = release_ratios.as_shipped(measured.record.launches)
    if shipped is None:
        return measured.ratio.ratio
    deviation = math.hypot(shipped.deviation, measured.ratio.deviation)
    differs = abs(shipped.log_ratio - measured.ratio.log_ratio) > MIN_DEVIATIONS * deviation
    return shipped.ratio if differs else measured.ratio.ratio


def _time_layers() -> list[Spec]:
    scale = {"type": "log", "zero": False, "nice": False, "padding": 10}

    def y(field: str) -> Spec:
        return {"field": field, "type": "quantitative", "scale": scale}

    shipped = {"y": y("shipped"), "y2": {"field": "ratio"}}
    return [
        charts.layer("area", shipped, color=ORANGE, opacity=0.25),
        charts.layer("rule", {"y": y("low"), "y2": {"field": "high"}}, color=BLUE),
        charts.layer("line", {"y": y("ratio")}, color=BLUE, point={"color": BLUE}),
        charts.layer("point", {"y": y("change point")}, shape="diamond", size=140, color=ORANGE),
    ]


def _value(**scale: Any) -> Spec:
    return {"field": "value", "type": "quantitative", "scale": scale}


def _counters(rows: Sequence[Row]) -> Spec:
    most = max((row["value"] for row in rows), default=0.0)
    color = {
        "field": "counter",
        "type": "nominal",
        "title": None,
        "scale": {"range": [BLUE, ORANGE, GREEN]},
    }
    y = _value(type="symlog") | {"axis": {"values": [n for n in _WORK_TICKS if n <= most]}}
    return charts.layer("line", {"y": y, "color": color}, point=True)


def _drift_points() -> Spec:
    y = _value(type="log", domainMin=_LEAST_DRIFT) | {"axis": {"format": ".0e", "tickCount": 4}}
    return charts.layer("point", {"y": y}, filled=True, color=GREY)
