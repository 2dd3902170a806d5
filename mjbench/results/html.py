"""A report as one HTML file, which needs nothing else: charts are SVG in the page."""

import re
import urllib.parse

import mjbench
from mjbench import formats
from mjbench.results import charts
from mjbench.results.content import Column, DataTable, Figure, Report, Tone

# What stands before a conclusion, beside its colour.
MARKS = {Tone.CAUTION: "!", Tone.GOOD: "✓", Tone.BAD: "✗", Tone.UNSURE: "?", Tone.NEUTRAL: "•"}
# What a sentence has of a command line.
_CODE = re.compile("`([^`]+)`")
# Characters of a text that is not wrapped in a table.
_SHORT = 24


def render(report: Report) -> str:
    """Return a report as HTML, which needs the extra `report`.

    All texts are escaped: names of models and files may hold anything.
    """
    import jinja2
    from markupsafe import Markup, escape

    def svg(figure: Figure) -> str:
        return Markup(charts.svg(figure.specification))  # Vega escapes the texts of a chart

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("mjbench.results"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {
        "svg": svg,
        "csv": _csv_address,
        "file_name": lambda table: re.sub(r"[^\w-]+", "-", table.title) + ".csv",
        "classes": _classes,
        "prose": lambda text: Markup(_CODE.sub(r"<code>\1</code>", str(escape(text)))),
    }
    template = environment.get_template("report.html.j2")
    return template.render(report=report, marks=MARKS, version=mjbench.__version__)


def _classes(table: DataTable) -> list[str]:
    """Return the class of the cells of each column: numbers and short texts do not wrap."""
    texts = table.texts

    def of(i: int, column: Column) -> str:
        if column.is_right_aligned:
            return "number"
        return "short" if all(len(row[i]) <= _SHORT for row in texts) else "text"

    return [of(i, column) for i, column in enumerate(table.columns)]


def _csv_address(table: DataTable) -> str:
    text = formats.csv_text(table.raw_rows)
    return f"data:text/csv;charset=utf-8,{urllib.parse.quote(text, safe=',')}"
