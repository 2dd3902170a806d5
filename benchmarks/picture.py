"""Draw the picture of a report that the README shows.

    python -m benchmarks.picture [RUN] [-o FILE]

writes the report of a run file and photographs the part of one model in headless Chromium, which
needs chromium and chromedriver, and selenium.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mjbench.errors import InputError, MachineError, MjbenchError

ROOT = Path(__file__).parents[1]
RUN = ROOT / "results/runs/reference-mujoco-4.0.0.jsonl"
PICTURE = ROOT / "docs/report.png"
# Flags under which Chromium starts in a container, and asks the network for nothing.
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    "--hide-scrollbars",
)
WIDTH, HEIGHT = 1100, 1000


def write_report(run_file: Path, model: str, page: Path) -> None:
    """Write the report of one model of a run file."""
    import dataclasses

    from mjbench.pages import html, reports
    from mjbench.pages.reports import NamedRun
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import runs

    run = runs.load(run_file, RECORD_TYPES)
    records = tuple(record for record in run.records if getattr(record, "model", "") == model)
    if not records:
        raise InputError(f"{run_file} has no {model}")
    report = reports.build([NamedRun(run_file, dataclasses.replace(run, records=records))])
    page.write_text(html.render(report))


def photograph(page: Path, picture: Path) -> None:
    """Save what a browser shows of a page."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        raise MachineError("a picture needs chromium and chromedriver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--window-size={WIDTH},{HEIGHT}"):
        options.add_argument(flag)
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        browser.get(page.as_uri())
        browser.save_screenshot(str(picture))
    finally:
        browser.quit()


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", nargs="?", type=Path, default=RUN, metavar="RUN")
    parser.add_argument("-o", "--output", type=Path, default=PICTURE, metavar="FILE")
    parser.add_argument("--model", default="humanoid")
    options = parser.parse_args(arguments)
    try:
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "report.html"
            write_report(options.run, options.model, page)
            photograph(page, options.output)
    except MjbenchError as error:
        sys.exit(f"picture: {error}")


if __name__ == "__main__":
    main()
