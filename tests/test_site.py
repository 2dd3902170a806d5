"""The site of documents and reports: complete, and nothing of it is from outside the project."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest
from commands import ROOT

# MyST uses what the next Sphinx lacks.
pytestmark = pytest.mark.filterwarnings("ignore:'(myst_parser|furo|sphinx)")

SECRET = "not for the site"
# Ways in which a document would include, download or show a file, which each names.
INCLUDING = [
    "```{include} %s\n```",
    "```{literalinclude} %s\n```",
    "```{csv-table}\n:file: %s\n```",
    "```{raw} html\n:file: %s\n```",
    "```{eval-rst}\n.. include:: %s\n```",
    "```{eval-rst}\n.. literalinclude:: %s\n```",
    "```{eval-rst}\n.. raw:: html\n   :file: %s\n```",
]
COPYING = [
    "{download}`x <%s>`",
    "![x](%s)",
    "[x](%s)",
    "```{image} %s\n```",
    "```{figure} %s\n```",
    "```{eval-rst}\n.. image:: %s\n```",
    "```{eval-rst}\n:download:`x <%s>`\n```",
    "```{eval-rst}\n.. |x| image:: %s\n\n|x|\n```",
]


@pytest.fixture(scope="module")
def site() -> ModuleType:
    for package in ("sphinx", "myst_parser", "furo", "jinja2", "vl_convert"):
        pytest.importorskip(package)
    spec = importlib.util.spec_from_file_location("docs_site", ROOT / "docs/site.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project with two documents, beside a file that is not part of it."""
    (tmp_path / "secret.txt").write_text(SECRET)
    (tmp_path / "secret.png").write_text(SECRET)
    folder = tmp_path / "project"
    (folder / "docs/guides").mkdir(parents=True)
    (folder / "README.md").write_text("# Project\n\n[Guides](docs/guides/README.md)\n")
    (folder / "docs/guides/README.md").write_text("# Guides\n\n![plot](../plot.svg)\n")
    (folder / "docs/plot.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    return folder


def contents(folder: Path) -> str:
    files = [file for file in folder.rglob("*") if file.is_file()]
    return "".join(file.read_text(errors="replace") for file in files)


def names(project: Path, file: str) -> list[str]:
    """Return the ways to name a file beside the project in one of its documents."""
    return [f"../../{file}", f"../../../../../../../../..{project.parent / file}"]


def test_a_site_has_the_documents_their_images_and_reports(site: ModuleType, project: Path) -> None:
    run = ROOT / "results/runs/reference-story-run.jsonl"
    (project / "results/runs").mkdir(parents=True)
    (project / "results/runs/a run.jsonl").write_bytes(run.read_bytes())
    (project / "results/runs/broken.jsonl").write_text("nonsense\n")
    output = project.parent / "site"
    (line,) = site.build(project, output)
    assert line.startswith("left out: results/runs/broken.jsonl: ")
    assert 'href="docs/guides/README.html"' in (output / "index.html").read_text()
    assert (output / "_images/plot.svg").is_file()
    assert 'href="reports/a%20run.html"' in (output / "reports.html").read_text()
    assert (output / "reports/a run.html").read_text().startswith("<!doctype html>")
    assert site.build(project, output)  # a site is replaced


def test_texts_of_run_files_are_no_markup(site: ModuleType, project: Path) -> None:
    run = ROOT / "results/runs/reference-story-run.jsonl"
    (project / "results/runs").mkdir(parents=True)
    header, *records = run.read_text().splitlines()
    changed = json.loads(header)
    changed["command_line"] = ["run", "</table>\n\n```{include} /etc/hostname\n```\n<script>"]
    changed["machine"]["cpu"] = "<script>{download}`x </etc/hostname>`"
    text = "\n".join([json.dumps(changed), *records, ""])
    (project / "results/runs/run.jsonl").write_text(text)
    assert site.build(project, project.parent / "site") == []
    page = (project.parent / "site/reports.html").read_text()
    assert "&lt;script&gt;" in page and "<script>{" not in page
    assert not (project.parent / "site/_downloads").exists()


def test_a_document_includes_nothing(site: ModuleType, project: Path) -> None:
    (project / "docs/own.txt").write_text(SECRET)
    lines = [
        way % name
        for way in INCLUDING
        for name in ("own.txt", *names(project, "secret.txt"), str(project.parent / "secret.txt"))
    ]
    (project / "docs/hostile.md").write_text("# Hostile\n\n" + "\n\n".join(lines))
    warnings = site.build(project, project.parent / "site")
    assert len([line for line in warnings if "docs/hostile.md" in line]) >= len(lines)
    (project / "docs/own.txt").unlink()
    (project.parent / "site/docs/own.txt").unlink(missing_ok=True)
    assert SECRET not in contents(project.parent / "site")


@pytest.mark.parametrize("way", COPYING)
def test_a_document_shows_and_offers_no_file_outside_the_project(
    site: ModuleType, project: Path, way: str
) -> None:
    for name in names(project, "secret.png"):
        (project / "docs/hostile.md").write_text(f"# Hostile\n\n{way % name}\n")
        try:
            site.build(project, project.parent / "site")
        except site.SphinxError as error:
            assert "docs/hostile: " in str(error) and "is outside the project" in str(error)
        else:
            assert SECRET not in contents(project.parent / "site")


def test_links_out_of_the_project_are_not_followed(site: ModuleType, project: Path) -> None:
    (project / "docs/folder").symlink_to(project.parent)
    (project / "docs/secret.md").symlink_to(project.parent / "secret.txt")
    (project / "docs/linked.png").symlink_to(project.parent / "secret.png")
    (project / "docs/page.md").write_text("# Page\n\n![x](linked.png)\n")
    site.build(project, project.parent / "site")
    assert SECRET not in contents(project.parent / "site")
    assert not (project.parent / "site/docs/secret.html").exists()


def test_a_folder_that_is_not_a_site_is_not_replaced(site: ModuleType, project: Path) -> None:
    with pytest.raises(site.SphinxError, match="is not a site: choose another folder"):
        site.build(project, project)
    assert (project / "README.md").is_file()
