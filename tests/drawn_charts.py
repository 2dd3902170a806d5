"""The charts of sections, drawn."""

import pytest

from mjbench.results import charts
from mjbench.results.content import Section


def drawn(section: Section) -> list[str]:
    """Return the charts of a section, as SVG."""
    pytest.importorskip("vl_convert")
    return [charts.svg(figure.specification) for figure in section.figures]
