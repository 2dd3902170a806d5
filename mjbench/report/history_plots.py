"""Plots of a model over the releases, one above the other, as a Vega-Lite specification.

The panels share their axis of releases: the time of a step, its instructions, its work, and how far
its physics is from that of the reference.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from mjbench.releases import step_ratios
from mjbench.releases.speed_history import ModelHistory
from mjbench.report.speed_history import SpeedHistory

# The version of Vega-Lite whose language this is.
_SCHEMA = "https://vega.github.io/schema/vega-lite/v5.json"
_WIDTH, _HEIGHT, _TALL = 720, 80, 160
# Colours that people with any colour vision tell apart (Okabe and Ito).
_BLUE, _ORANGE, _GREEN, _GREY = "#0072b2", "#d55e00", "#009e73", "#999999"
_COUNTERS = ("contacts", "constraints", "solver iterations")
# The band around a ratio is as many standard errors wide, to either side.
_BAND = 2.0
# Drifts below this are drawn at it: rounding, or none.
_LEAST_DRIFT = 1e-17

Row = dict[str, str | float | None]
Spec = dict[str, Any]


def specification(history: SpeedHistory, model: ModelHistory) -> Spec:
    """Return the plots of a model.

    Args:
      history: that the model is of.
      model: at least one release of it was measured.
    """
    releases = [release for release in history.releases() if history.lists(release)]
    axis = {"sort": releases, "scale": {"domain": releases}}
    reference = model.measured[-1].record.reference
    panels = [
        _panel(axis, f"time, {reference} = 1", [*_times(history, model)], _time_layers(), _TALL),
        _panel(axis, "instructions", [*_instructions(history, model)], _line(_BLUE)),
        _panel(axis, "work per step", [*_work(history, model)], _counter_lines()),
        _panel(axis, "drift", [*_drift(history, model)], _drift_points()),
    ]
    panels[-1]["layer"][0]["encoding"]["x"]["axis"] = {"title": None, "labelAngle": -90}
    return {
        "$schema": _SCHEMA,
        "title": {"text": model.model, "anchor": "start"},
        "background": "white",
        "spacing": 8,
        "vconcat": panels,
        "resolve": {"scale": {"color": "independent"}},
    }


def _panel(
    axis: Mapping[str, Any], title: str, rows: list[Row], layers: list[Spec], height: int = _HEIGHT
) -> Spec:
    for layer in layers:
        x = {"field": "release", "type": "ordinal", "axis": {"labels": False, "title": None}}
        layer["encoding"] = {"x": {**x, **axis}, **layer["encoding"]}
        layer["encoding"]["y"]["title"] = title
    return {"width": _WIDTH, "height": height, "data": {"values": rows}, "layer": layers}


def _times(history: SpeedHistory, model: ModelHistory) -> Iterator[Row]:
    marked = {point.index for point in model.changes.change_points}
    for i, each in enumerate(model.measured):
        if not history.lists(each.release):
            continue
        shipped = step_ratios.as_shipped(each.record.launches)
        margin = _BAND * each.ratio.deviation
        yield {
            "release": each.release,
            "value": each.ratio.ratio,
            "low": math.exp(each.ratio.log_ratio - margin),
            "high": math.exp(each.ratio.log_ratio + margin),
            "shipped": shipped.ratio if shipped else None,
            "change": each.ratio.ratio if i in marked else None,
        }


def _time_layers() -> list[Spec]:
    scale = {"type": "log", "zero": False, "nice": False}
    y = {"field": "value", "type": "quantitative", "scale": scale}
    return [
        {  # placement: from the ratio as shipped to the averaged one
            "mark": {"type": "area", "color": _ORANGE, "opacity": 0.25},
            "encoding": {"y": {**y, "field": "shipped"}, "y2": {"field": "value"}},
        },
        {
            "mark": {"type": "errorbar", "color": _BLUE},
            "encoding": {"y": {**y, "field": "low"}, "y2": {"field": "high"}},
        },
        {"mark": {"type": "line", "color": _BLUE, "point": True}, "encoding": {"y": y}},
        {
            "mark": {"type": "point", "shape": "diamond", "size": 120, "color": _ORANGE},
            "encoding": {"y": {**y, "field": "change"}},
        },
    ]


def _instructions(history: SpeedHistory, model: ModelHistory) -> Iterator[Row]:
    counts = history.instructions(model.model)
    for release, count in counts.items():
        if history.lists(release):
            yield {"release": release, "value": count / 1000}


def _work(history: SpeedHistory, model: ModelHistory) -> Iterator[Row]:
    for each in model.measured:
        work = each.record.work
        if work is None or not history.lists(each.release):
            continue
        for name, count in work.as_dict().items():
            yield {"release": each.release, "counter": name.replace("_", " "), "value": count}


def _drift(history: SpeedHistory, model: ModelHistory) -> Iterator[Row]:
    for each in model.measured:
        drift = each.record.drift
        if drift is not None and history.lists(each.release):
            yield {"release": each.release, "value": max(drift, _LEAST_DRIFT)}


def _line(color: str) -> list[Spec]:
    y = {"field": "value", "type": "quantitative", "scale": {"zero": False}}
    return [{"mark": {"type": "line", "color": color, "point": True}, "encoding": {"y": y}}]


def _counter_lines() -> list[Spec]:
    color = {
        "field": "counter",
        "type": "nominal",
        "title": None,
        "scale": {"domain": list(_COUNTERS), "range": [_BLUE, _ORANGE, _GREEN]},
        "legend": {"orient": "right"},
    }
    y = {"field": "value", "type": "quantitative", "scale": {"type": "symlog"}}
    return [{"mark": {"type": "line", "point": True}, "encoding": {"y": y, "color": color}}]


def _drift_points() -> list[Spec]:
    y = {
        "field": "value",
        "type": "quantitative",
        "scale": {"type": "log", "domainMin": _LEAST_DRIFT},
        "axis": {"format": ".0e", "tickCount": 4},
    }
    return [{"mark": {"type": "point", "filled": True, "color": _GREY}, "encoding": {"y": y}}]
