"""The picture of a report: it is of the model that was asked for, and a browser draws it."""

import shutil
from pathlib import Path

import pytest

from benchmarks import picture
from mjbench.errors import InputError


@pytest.fixture(autouse=True)
def needs_the_report_extra() -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")


def test_the_report_is_of_one_model(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    picture.write_report(picture.RUN, "humanoid", page)
    text = page.read_text()
    assert "humanoid" in text
    assert "cartpole" not in text
    with pytest.raises(InputError, match="has no unknown"):
        picture.write_report(picture.RUN, "unknown", page)


def test_a_browser_draws_it(tmp_path: Path) -> None:
    pytest.importorskip("selenium")
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("needs chromium and chromedriver")
    page, drawn = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text("<!doctype html><title>a page</title><p>text")
    picture.photograph(page, drawn)
    assert drawn.read_bytes().startswith(b"\x89PNG")
