"""Charts as Vega-Lite specifications: their text has the colour of the page around them.

The colours are told apart with any colour vision (after Okabe and Ito, 2008), on a light page as on
a dark one.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from mjbench import extras
from mjbench.errors import MachineError
from mjbench.results.content import Cell, DataTable, Figure

# The version of Vega-Lite whose language the specifications are in.
VERSION = "5.20"
SCHEMA = f"https://vega.github.io/schema/vega-lite/v{VERSION.split('.')[0]}.json"
BLUE, ORANGE, GREEN = "#2a86c4", "#d55e00", "#009e73"
SKY, PINK, GREY = "#56b4e9", "#cc79a7", "#8a8a8a"

Spec = dict[str, Any]

WIDTH = 640
# Of a chart whose rows are names: pixels a row.
_ROW_HEIGHT = 22
# Characters of a text in a chart.
_MOST_TEXT = 300
# Pixels of a label, at most, and of a letter of a wide font.
_LABEL_WIDTH, _LETTER_WIDTH = 300, 7


def values(table: DataTable) -> list[dict[str, Cell]]:
    """Return the rows of a table as Vega-Lite's data, by the titles of its columns."""
    names = [column.title for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def layer(mark: str, encoding: Mapping[str, Spec], **properties: Any) -> Spec:
    return {"mark": {"type": mark, **properties}, "encoding": dict(encoding)}


def figure(
    title: str, alternative: str, data: DataTable, layers: Sequence[Spec], height: int | None = None
) -> Figure:
    """Return a chart of layers that share the data of a table.

    Args:
      height: in pixels; None for one row of text a row of the table.
    """
    specification = {
        "$schema": SCHEMA,
        "data": {"values": values(data)},
        "width": WIDTH,
        "height": {"step": _ROW_HEIGHT} if height is None else height,
        "layer": list(layers),
        **page_colours(),
    }
    return Figure(title, alternative, specification, data)


def share_bars(title: str, data: DataTable, noun: str, drawn: str, axis: str) -> Figure:
    """Return a chart of bars.

    Args:
      data: the name and the share of each, as columns with a form, and more; the longest first.
      noun: what has a bar, in the plural.
      drawn: title of the column that is the length of the bars.
      axis: title of their axis.
    """
    share = data.columns[1]
    x = quantity(drawn, axis, zero=True)
    if drawn == share.title:
        x["axis"]["format"] = ".0%"
    alternative = f"No {noun}."
    if data.rows:
        longest = f"{data.rows[0][0]}, {share.shown(data.rows[0][1])}"
        alternative = f"Bars of {len(data.rows)} {noun}; the longest is {longest}."
    bars = layer("bar", {"x": x, "y": names(data)}, height=12, color=BLUE)
    return figure(title, alternative, data, [bars])


def quantity(field: str, title: str, *, log: bool = False, **scale: Any) -> Spec:
    """Return the encoding of the number in the column that `field` names."""
    kind = {"type": "log"} if log else {}
    return {
        "field": _escaped(field),
        "type": "quantitative",
        "title": title,
        "scale": {**kind, "zero": False, "nice": True, **scale},
        "axis": {"labelOverlap": "greedy"} if log else {"labelOverlap": "greedy", "tickCount": 7},
    }


def names(data: DataTable) -> Spec:
    """Return the encoding of the names in the first column, in the order of the rows.

    There is room for them in a wide font, too.
    """
    room = _LETTER_WIDTH * max((len(str(row[0])) for row in data.rows), default=0)
    return {
        "field": _escaped(data.columns[0].title),
        "type": "nominal",
        "sort": None,
        "title": None,
        "axis": {"labelLimit": _LABEL_WIDTH, "minExtent": min(room, _LABEL_WIDTH)},
    }


def colour(field: str, colours: Mapping[str, str], title: str | None = None) -> Spec:
    return {
        "field": _escaped(field),
        "type": "nominal",
        "title": title,
        "scale": {"domain": list(colours), "range": list(colours.values())},
        "legend": {"orient": "top"},
    }


def page_colours() -> Spec:
    """Return the properties of a chart that give its text the colour of the page around it."""
    return {"background": None, "config": _CONFIG}


def rule_at(value: float) -> Spec:
    return {
        "mark": {"type": "rule", "color": GREY, "strokeDash": [4, 4], "aria": False},
        "data": {"values": [{"value": value}]},
        "encoding": {"x": {"field": "value", "type": "quantitative"}},
    }


def estimates(
    field: str, title: str, shared: Mapping[str, Spec], has_interval: str = "isValid(datum.low)"
) -> list[Spec]:
    """Return points at the column `field`, and lines from the column `low` to `high`.

    Args:
      shared: encodings of both.
      has_interval: test of the rows that have a line.
    """
    ends = {"x": quantity("low", title), "x2": {"field": "high"}, **shared}
    lines = layer("rule", ends, strokeWidth=3)
    points = layer("point", {"x": quantity(field, title), **shared}, filled=True, size=70)
    return [{**lines, "transform": [{"filter": has_interval}]}, points]


def svg(specification: Mapping[str, Any]) -> str:
    """Return a chart as SVG.

    Raises:
      MachineError: vl-convert-python is not installed.
    """
    try:
        import vl_convert
    except ImportError as error:
        raise MachineError(
            f"charts need vl-convert-python: {extras.install_command('report')}; or leave them out"
            " (show --markdown)"
        ) from error
    return str(vl_convert.vegalite_to_svg(_shortened(specification), vl_version=VERSION))


def _shortened(part: Any) -> Any:
    """Return a specification whose texts are short; laying out one of a megabyte takes minutes."""
    if isinstance(part, Mapping):
        return {key: _shortened(value) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_shortened(value) for value in part]
    if isinstance(part, str) and len(part) > _MOST_TEXT:
        return f"{part[:_MOST_TEXT]}…"
    return part


def _escaped(field: str) -> str:
    """Return a column's title as Vega-Lite's name of a field: dots and brackets mean nesting."""
    for character in "\\.[]'\"":
        field = field.replace(character, f"\\{character}")
    return field


_TEXT = "currentColor"
_CONFIG: Spec = {
    # with which vl-convert lays a chart out; a wider one would be cut off
    "font": "Liberation Sans, Arimo, Arial, Helvetica, sans-serif",
    "view": {"stroke": None},
    "axis": {
        "labelColor": _TEXT,
        "titleColor": _TEXT,
        "domainColor": GREY,
        "tickColor": GREY,
        "gridColor": GREY,
        "gridOpacity": 0.25,
        "labelFontSize": 12,
        "titleFontSize": 12,
        "titleFontWeight": "normal",
    },
    "legend": {"labelColor": _TEXT, "titleColor": _TEXT, "labelFontSize": 12, "columnPadding": 20},
    "title": {"color": _TEXT, "anchor": "start"},
}
