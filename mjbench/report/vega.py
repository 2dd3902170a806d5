"""Vega-Lite: its version, colours, and how a specification becomes a picture.

The colours are told apart with any colour vision (after Okabe and Ito, 2008), on a light page as on
a dark one.
"""

from collections.abc import Mapping
from typing import Any

from mjbench.errors import MachineError
from mjbench.instrument import extras

# The version of Vega-Lite whose language the specifications are in.
VERSION = "5.20"
SCHEMA = f"https://vega.github.io/schema/vega-lite/v{VERSION.split('.')[0]}.json"
BLUE, ORANGE, GREEN = "#2a86c4", "#d55e00", "#009e73"
SKY, PINK, GREY = "#56b4e9", "#cc79a7", "#8a8a8a"

Spec = dict[str, Any]


# Characters of a text in a chart.
_MOST_TEXT = 300


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
            " (report --markdown, history without --plots)"
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
