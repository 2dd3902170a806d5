"""The pages name what exists: modules, files, links."""

import re
from pathlib import Path

import pytest
from commands import ROOT

from mjbench.loop import overhead
from mjbench.paired import outcomes, race_record
from mjbench.testing import fixture
from mjbench.tuning import measurements

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md")])
PACKAGES = sorted(p.parent.name for p in (ROOT / "mjbench").glob("*/__init__.py"))


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_link_between_pages_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        linked = (page.parent / file).resolve() if file else page
        assert linked.exists(), target
        assert not anchor or anchor in anchors(linked), target


def test_the_architecture_page_has_a_paragraph_of_every_package() -> None:
    text = (ROOT / "docs/architecture.md").read_text()
    assert sorted(re.findall(r"\*\*`(\w+)/`\*\*", text)) == PACKAGES


def test_every_module_that_the_architecture_page_names_exists() -> None:
    text = (ROOT / "docs/architecture.md").read_text()
    packages = "|".join(PACKAGES)
    for path in re.findall(rf"`((?:{packages})/[\w/]+\.\w+)`", text):
        assert (ROOT / "mjbench" / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_file_of_the_project_that_a_page_names_exists(page: Path) -> None:
    folders = "mjbench|benchmarks|tests|models|docs|results"
    for path in re.findall(rf"(?<![\w/.…-])((?:{folders})/[\w./<>*…-]+\.\w+)", page.read_text()):
        is_pattern = bool(set("<>*…") & set(path)) or path.startswith("models/NAME")
        assert is_pattern or (ROOT / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_test_that_a_page_names_exists(page: Path) -> None:
    for file, test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page.read_text()):
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text(), flags=re.M), test


@pytest.mark.parametrize("page", [*PAGES, ROOT / "Makefile"], ids=name)
def test_every_command_of_the_benchmarks_that_a_page_names_exists(page: Path) -> None:
    for module in re.findall(r"python\s-m\s(benchmarks\.[\w.]*\w)", page.read_text()):
        file = ROOT / f"{module.replace('.', '/')}.py"
        assert file.is_file() and "__main__" in file.read_text(), module


def test_the_page_of_method_states_the_confidence_of_each_command() -> None:
    text = (ROOT / "docs/method/README.md").read_text(encoding="utf-8")
    stated = {
        words: float(percent) / 100
        for words, percent in re.findall(r"^\| (`?[^|]*?) \| (\d+) % \|", text, flags=re.M)
    }
    assert stated == {
        "`compare`": race_record.CONFIDENCE,
        "`versions`, `ab`, `doctor --verdicts`, `doctor --placement`": outcomes.CONFIDENCE,
        "`tune`": measurements.CONFIDENCE,
        "`profile --habits`": overhead.CONFIDENCE,
        "the pytest fixture": fixture.CONFIDENCE,
    }
