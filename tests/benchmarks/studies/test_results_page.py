"""The page of results has what the committed runs show."""

import re

from benchmarks.studies import results_page
from benchmarks.studies.page_part import of_lines

WRITE = "python -m benchmarks.studies.results_page"


def test_the_page_and_the_chart_have_what_the_committed_run_advises() -> None:
    run = results_page.committed_run()
    lines = list(results_page.model_lines(run))
    assert results_page.MODELS.text() == of_lines(lines), WRITE
    chart = results_page.chart(run)
    assert results_page.CHART.read_text(encoding="utf-8") == chart, WRITE
    names = run.header.arguments["models"]
    assert all(f">{name}</text>" in chart for name in names)
    assert chart.count("<circle") == 2 * len(names) + 2  # and the legend


def test_a_mark_of_the_chart_lies_where_its_speed_up_is() -> None:
    chart = results_page.chart(results_page.committed_run())
    ticks = dict(re.findall(r'<text x="(\d+)" [^>]*>(\d)×', chart))
    zero, one = (int(x) for x, tick in ticks.items() if tick in "01")
    drawn = float(re.findall(r'<circle cx="([\d.]+)" cy="\d+" r="4"', chart)[2])
    (cartpole,) = [
        line
        for line in results_page.model_lines(results_page.committed_run())
        if line.startswith("| cartpole |")
    ]
    speedup = re.search(r": ([\d.]+) \(", cartpole)
    assert abs((drawn - zero) / (one - zero) - float(speedup[1])) < 0.01


def test_the_page_has_the_releases_in_which_three_models_changed() -> None:
    lines = of_lines(results_page.release_lines(results_page.committed_history()))
    assert results_page.RELEASES.text() == lines, WRITE
    assert "| 3.3.1 |" in lines
    assert lines.count("*work*") >= 3
