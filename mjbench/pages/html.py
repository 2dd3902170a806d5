"""A report as one HTML file, which needs nothing else: charts are SVG in the page."""

from dataclasses import dataclass

import mjbench
from mjbench.errors import InputError
from mjbench.pages import charts
from mjbench.pages.content import Conclusion, Figure, Report, Tone

# What stands before a conclusion, beside its colour.
_MARKS = {Tone.GOOD: "✓", Tone.BAD: "✗", Tone.UNSURE: "?", Tone.NEUTRAL: "•"}


@dataclass(frozen=True)
class _DrawnFigure:
    """A figure, and its chart as SVG, which is safe to stand in a page."""

    figure: Figure
    svg: str


@dataclass(frozen=True)
class _DrawnSection:
    """A section whose figures are drawn; see `content.Section`."""

    heading: str
    command: str
    conclusions: list[Conclusion]
    figures: list[_DrawnFigure]
    tables: list[object]
    notes: list[str]


def render(report: Report) -> str:
    """Return a report as HTML.

    All texts are escaped: names of models and files may hold anything.

    Raises:
      InputError: Jinja2 or vl-convert-python is not installed.
    """
    try:
        import jinja2
        from markupsafe import Markup
    except ImportError as error:
        raise InputError(
            "a report in HTML needs Jinja2: pip install 'mjbench[report]', or give --markdown"
        ) from error
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("mjbench.pages"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    sections = [
        _DrawnSection(
            section.heading,
            section.command,
            list(section.conclusions),
            # Vega escapes the texts of a chart
            [_DrawnFigure(f, Markup(charts.svg(f.specification))) for f in section.figures],
            list(section.tables),
            list(section.notes),
        )
        for section in report.sections
    ]
    template = environment.get_template("report.html.j2")
    return template.render(
        report=report, sections=sections, marks=_MARKS, version=mjbench.__version__
    )
