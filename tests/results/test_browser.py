"""Reports in a browser: no error, no request, tables that sort, dark, on a phone, accessible."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from commands import ROOT
from headless_browser import emulate, requested, resize, violations

from mjbench.commands.show import reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.results import html, runs

# A run with charts, and one without any.
RUNS = "runs/reference-mujoco-4.0.0", "runs/reference-story-versions"
OPEN_ALL = "for (const each of document.querySelectorAll('details')) each.open = true;"


@pytest.fixture(scope="module", params=RUNS)
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the report of a committed run, without most of its models: axe takes its time."""
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")
    file = ROOT / f"results/{request.param}.jsonl"
    run = runs.load(file, RECORD_TYPES)
    records = tuple(r for r in run.records if getattr(r, "model", "") in ("cartpole", "cloth"))
    report = reports.build([NamedRun(file, dataclasses.replace(run, records=records))])
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(html.render(report))
    return path


@pytest.fixture
def opened(browser: Any, page: Path) -> Any:
    """Open the report at the size of a desktop, in light colours."""
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    emulate(browser)
    browser.get_log("browser")
    browser.get_log("performance")
    browser.get(page.as_uri())
    return browser


def test_it_opens_without_errors_and_asks_the_network_for_nothing(opened: Any) -> None:
    assert opened.get_log("browser") == []
    urls = requested(opened)
    assert urls
    assert all(url.startswith(("file:", "data:")) for url in urls)


def test_every_chart_has_marks(opened: Any) -> None:
    empty = opened.execute_script(
        "return [...document.querySelectorAll('figure')].filter("
        'f => !f.querySelector(\'svg [class^="mark-"] path, svg [class^="mark-"] line\'))'
        ".map(f => f.querySelector('figcaption').textContent)"
    )
    assert empty == []


def test_tables_sort_and_filter(opened: Any) -> None:
    opened.execute_script(OPEN_ALL)
    headings = opened.find_elements("css selector", "th[data-number] button")
    heading = next(each for each in headings if each.is_displayed())
    table = heading.find_element("xpath", "ancestor::table")
    index = opened.execute_script("return arguments[0].closest('th').cellIndex", heading)
    read = (
        "return [...arguments[0].tBodies[0].rows].map(r => r.cells[arguments[1]].dataset.value)"
        ".filter(v => v !== undefined).map(Number)"
    )
    heading.click()
    rising = opened.execute_script(read, table, index)
    assert rising == sorted(rising)
    assert heading.find_element("xpath", "..").get_attribute("aria-sort") == "ascending"
    heading.click()
    assert opened.execute_script(read, table, index) == sorted(rising, reverse=True)
    filters = opened.find_elements("css selector", "details input")
    filters = [each for each in filters if each.is_displayed()]
    if filters:
        filters[0].send_keys("no row has this")
        rows = opened.execute_script(
            "return [...arguments[0].closest('details').querySelectorAll('tbody tr')]"
            ".filter(r => !r.hidden).length",
            filters[0],
        )
        assert rows == 0
        assert "No row has this." in opened.find_element("tag name", "main").text


def test_a_dark_page_is_dark(opened: Any) -> None:
    read = "return getComputedStyle(document.body).backgroundColor"
    light = opened.execute_script(read)
    emulate(opened, prefers_color_scheme="dark")
    assert opened.execute_script(read) != light


OVERLAPS = """
const found = [];
for (const svg of document.querySelectorAll('figure svg')) {
  const texts = [...svg.querySelectorAll('text')].filter(t => t.textContent && t.getBBox().width);
  const boxes = texts.map(t => t.getBoundingClientRect());
  for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++) {
    const [a, b] = [boxes[i], boxes[j]];
    const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (width > 1 && height > 4) found.push([texts[i].textContent, texts[j].textContent]);
  }
}
return found;
"""


@pytest.mark.parametrize("width", [375, 768, 1280])
def test_no_screen_is_too_narrow_and_no_labels_of_charts_overlap(opened: Any, width: int) -> None:
    resize(opened, width)
    assert opened.execute_script(OPEN_ALL + OVERLAPS) == []
    assert opened.execute_script("return document.documentElement.scrollWidth") <= width


def test_the_first_screen_has_the_conclusions_and_what_was_measured(opened: Any) -> None:
    resize(opened, 1280, 800)
    seen = opened.execute_script(
        "return [...document.querySelectorAll('h1, header p, main > .conclusions li')]"
        ".map(each => each.getBoundingClientRect().bottom)"
    )
    assert len(seen) >= 3
    assert max(seen) <= 800


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault(opened: Any, scheme: str) -> None:
    emulate(opened, prefers_color_scheme=scheme)
    resize(opened, 375)
    opened.execute_script(OPEN_ALL)
    assert violations(opened) == []
