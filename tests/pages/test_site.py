"""The static site: what was found comes first, every page is linked, and nothing is lost."""

import html.parser
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from commands import ROOT
from example_races import BATCH_STEP, ROLLOUT, compared, raced
from headless_browser import emulate, resize, violations
from set_files import labelled, run_file, set_of
from verdict_records import SLOWER

from mjbench.cli import cli
from mjbench.errors import MachineError
from mjbench.host.neighbours import Disturbance
from mjbench.pages import reports, site
from mjbench.pages.reports import NamedRun
from mjbench.pages.site import Project
from mjbench.report import history_files
from mjbench.report.kinds import RECORD_TYPES
from mjbench.report.speed_history import SpeedHistory
from mjbench.store import runs

RUN = ROOT / "results/runs/reference-story-run.jsonl"  # a small one


@pytest.fixture(autouse=True)
def needs_the_report_extra() -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")


@pytest.fixture(scope="module")
def history() -> SpeedHistory:
    """Return the committed history, of one pass."""
    files = [ROOT / f"results/history/reference-{name}.jsonl" for name in ("ratios", "counts")]
    return history_files.read(files, None)


def history_of(file: Path, *releases: str) -> SpeedHistory:
    """Write the times of some releases to a file; return their history."""
    lines = (ROOT / "results/history/reference-ratios.jsonl").read_text().splitlines(keepends=True)
    names = [f'"release": "{release}"' for release in releases]
    chosen = [line for line in lines[1:] if any(name in line for name in names)]
    file.write_text("".join([lines[0], *chosen]))
    return history_files.read([file], None)


def project_in(folder: Path) -> Project:
    (folder / "docs/guides").mkdir(parents=True)
    (folder / "docs/guides/README.md").write_text("# Guides\n\n[Words](../words.md#one)\n")
    (folder / "docs/words.md").write_text("# Words\n\n## One\n\n[a module](../mjbench/x.py)\n")
    (folder / "LICENSE").write_text("\n    Some Licence\n  Version 2\n")
    (folder / "README.md").write_text("# Project\n\n[Guides](docs/guides/README.md)\n")
    return Project(folder, [NamedRun(RUN, runs.load(RUN, RECORD_TYPES))])


class _Links(html.parser.HTMLParser):
    """What a page refers to: what a browser loads for it, and where its links lead."""

    def __init__(self, text: str):
        super().__init__()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag in ("script", "img", "iframe") and values.get("src"):
            self.loaded.append(str(values["src"]))
        if tag == "link" and values.get("rel") == "stylesheet":
            self.loaded.append(str(values["href"]))
        if tag == "a" and values.get("href"):
            self.links.append(str(values["href"]))


def assert_complete(folder: Path, *pages: str) -> None:
    """Check that pages load nothing from elsewhere, and that their links lead to something."""
    for name in pages:
        page = folder / name
        page_links = _Links(page.read_text())
        assert page_links.loaded
        for target in (*page_links.loaded, *page_links.links):
            if re.match("[a-z]+:", target):
                assert target not in page_links.loaded
                continue
            file = page.parent / re.split("[?#]", target)[0]
            assert file.exists(), f"{name}: {target}"


def test_the_first_page_says_what_was_found(tmp_path: Path, history: SpeedHistory) -> None:
    entrants = [(ROLLOUT, 3.0), (BATCH_STEP, 2.0)]
    files = []
    for name, cores, sizes in (("a", 2.0, (32, 64)), ("b", 1.0, (128,))):
        of_sizes = [compared(raced(entrants, nbatch_asked=n, cores=cores), nbatch=n) for n in sizes]
        records = [record for records in of_sizes for record in records]
        files.append(run_file(tmp_path / "runs", labelled(name), *records))
    named_runs = reports.read(files)
    site.write_source(Project(tmp_path, named_runs, history), tmp_path)
    index = (tmp_path / "index.md").read_text()
    assert index.index("a step became slower for") < index.index("## Ways of stepping, ")
    assert "The newest release, 4.0.0: " in index
    assert "| m | 32 | open | ✓ rollout" in index
    assert "Disturbed" not in index and "| m | 128 |" not in index
    assert "| disturbed |" in (tmp_path / "reports.md").read_text()
    assert "| m | 64 | closed | ✓ batch_step threads=2 data=shared | 2.0" in index
    releases = history.releases()[1:]
    assert sorted(path.stem for path in (tmp_path / "releases").glob("*.md")) == sorted(releases)
    page = (tmp_path / "releases/3.3.1.md").read_text()
    assert "\n# MuJoCo 3.3.1\n\nA step became slower for " in page
    assert "| 3.3.0 → 3.3.1 | cartpole |" in page
    assert "| humanoid | 3.3.0 |" in page
    for report in (tmp_path / "copied/reports").iterdir():
        assert report.read_text().startswith("<!doctype html>")


def test_guides_are_in_the_order_in_which_their_first_page_links_them(tmp_path: Path) -> None:
    project = project_in(tmp_path)
    guides = tmp_path / "docs/guides"
    for name in "abc":
        (guides / f"{name}.md").write_text(f"# {name}\n")
    (guides / "README.md").write_text("# Guides\n\n[C](c.md#one) before [B](b.md)\n")
    site.write_source(project, tmp_path / "source")
    index = (tmp_path / "source/index.md").read_text()
    listed = re.findall(r"^docs/guides/(\w+)$", index, flags=re.M)
    assert listed == ["README", "c", "b", "a"]
    assert "\n[Some Licence](LICENSE)\n" in index


def test_a_set_has_one_report_of_all_its_machines(tmp_path: Path) -> None:
    files = [
        run_file(tmp_path / "runs", labelled(name), SLOWER, command="versions") for name in "ab"
    ]
    named_runs = reports.read([set_of(tmp_path / "all.jsonl", files)])
    site.write_source(Project(tmp_path, named_runs), tmp_path / "source")
    assert [file.name for file in (tmp_path / "source/copied/reports").iterdir()] == ["all.html"]
    assert "(2 runs)" in (tmp_path / "source/reports.md").read_text()
    assert "slower on both machines" in (tmp_path / "source/index.md").read_text()


def test_a_history_of_one_release_has_nothing_to_compare(tmp_path: Path) -> None:
    single = history_of(tmp_path / "run.jsonl", "4.0.0")
    assert single.releases() == ["4.0.0"]
    site.write_source(Project(tmp_path, [], single), tmp_path / "source")
    index = (tmp_path / "source/index.md").read_text()
    assert "so there is nothing to compare." in index
    assert "[All changes](docs/history.md)" in index
    assert "releases" not in index.replace("release to release", "")
    assert not (tmp_path / "source/releases.md").exists()
    assert (tmp_path / "source/docs/history.md").is_file()


def test_the_lab_is_on_the_site_where_it_was_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    projects: list[Project] = []
    monkeypatch.setattr(site, "build", lambda project, *rest: projects.append(project) or [])
    folder = tmp_path / "project"
    (folder / "docs").mkdir(parents=True)
    command = ["site", "--project", str(folder), "-o", str(tmp_path / "site")]
    assert CliRunner().invoke(cli, command).exit_code == 0
    page = folder / "build/lab/mujoco-lab.html"
    page.parent.mkdir(parents=True)
    page.write_text("the lab")
    assert CliRunner().invoke(cli, command).exit_code == 0
    for project, source in zip(projects, (tmp_path / "without", tmp_path / "with"), strict=True):
        site.write_source(project, source)
    assert "The lab" not in (tmp_path / "without/index.md").read_text()
    assert '<a href="lab/index.html">The lab</a>' in (tmp_path / "with/index.md").read_text()
    assert (tmp_path / "with/copied/lab/index.html").read_text() == "the lab"


def test_an_error_in_a_page_is_not_one_of_writing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(runs: object) -> None:
        raise ValueError("a defect")

    monkeypatch.setattr(site.reports, "build", fail)
    with pytest.raises(ValueError, match="a defect"):
        site.write_source(project_in(tmp_path / "project"), tmp_path / "source")


def test_a_page_that_cannot_be_written_or_copied_is_named(tmp_path: Path) -> None:
    project = project_in(tmp_path / "project")
    (tmp_path / "source").touch()
    with pytest.raises(MachineError, match=r"cannot write .*conf\.py: "):
        site.write_source(project, tmp_path / "source")
    (project.folder / "docs/gone.md").symlink_to("nowhere.md")
    with pytest.raises(MachineError, match=r"cannot copy .*project: .*No such file"):
        site.write_source(project, tmp_path / "other")


def test_a_link_to_what_is_not_on_the_site_is_text(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    site.write_source(project_in(tmp_path / "project"), source)
    assert (source / "docs/words.md").read_text().endswith("a module\n")
    assert "[Words](../words.md#one)" in (source / "docs/guides/README.md").read_text()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site of the documents of this project, of one run and of three releases."""
    for package in (*site.PACKAGES, "jinja2", "vl_convert"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("project")
    (folder / "scratch").mkdir()
    history = history_of(folder / "history.jsonl", "3.3.0", "3.3.1", "4.0.0")
    project = Project(ROOT, [NamedRun(RUN, runs.load(RUN, RECORD_TYPES))], history)
    assert site.build(project, folder / "scratch", folder / "site") == []
    return folder / "site"


def test_the_documents_of_this_project_become_a_site_that_needs_no_network(built: Path) -> None:
    pages = {
        str(page.relative_to(built))
        for page in built.rglob("*.html")
        if page.parent != built / "reports"
    }
    assert {"reports.html", "docs/history.html", "docs/lint.html", "releases/4.0.0.html"} <= pages
    assert_complete(built, *pages)
    assert "Guides" in (built / "index.html").read_text()


@pytest.mark.parametrize("width", [375, 768, 1280])
def test_no_page_of_a_site_is_wider_than_its_screen(browser: Any, built: Path, width: int) -> None:
    resize(browser, width)
    for name in ("index", "reports", "docs/guides/README"):
        browser.get((built / f"{name}.html").as_uri())
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width


def test_axe_finds_no_fault_in_a_site(browser: Any, built: Path) -> None:
    for scheme in ("light", "dark"):
        emulate(browser, prefers_color_scheme=scheme)
        resize(browser, 375)
        for name in ("index", "docs/guides/README"):
            browser.get((built / f"{name}.html").as_uri())
            assert violations(browser) == []


def test_a_package_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(site, "PACKAGES", ("no_such_package",))
    with pytest.raises(MachineError, match=r"python -m pip install .*"):
        site.build(project_in(tmp_path / "project"), tmp_path, tmp_path / "site")


def test_sphinx_that_fails_ends_in_a_line(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    (tmp_path / "conf.py").write_text("1 / 0\n")
    with pytest.raises(MachineError, match="Sphinx failed: "):
        site._render(tmp_path, tmp_path / "site")


def test_a_folder_that_is_no_site_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[Path] = []
    monkeypatch.setattr(site, "build", lambda project, scratch, output: built.append(output) or [])
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").touch()
    command = ["site", "--project", str(project_in(tmp_path / "project").folder), "-o"]
    result = CliRunner().invoke(cli, [*command, str(precious)])
    assert result.exit_code == 2
    assert "is no site of mjbench" in result.output
    (precious / site.MARKER).touch()
    assert CliRunner().invoke(cli, [*command, str(precious)]).exit_code == 0
    assert CliRunner().invoke(cli, [*command, str(tmp_path / "new")]).exit_code == 0
    assert built == [precious, tmp_path / "new"]
    empty = tmp_path / "empty"
    empty.mkdir()
    result = CliRunner().invoke(cli, ["site", "--project", str(empty), "-o", str(tmp_path / "x")])
    assert result.exit_code == 2
    assert "neither results nor docs" in result.output


def test_a_run_file_that_cannot_be_read_is_left_out_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    projects: list[Project] = []
    monkeypatch.setattr(site, "build", lambda project, *rest: projects.append(project) or [])
    folder = tmp_path / "results/runs"
    folder.mkdir(parents=True)
    (folder / "broken.jsonl").write_text("nonsense\n")
    (folder / "run.jsonl").write_text(RUN.read_text())
    command = ["site", "--project", str(tmp_path), "-o", str(tmp_path / "site")]
    result = CliRunner().invoke(cli, command)
    assert result.exit_code == 0, result.output
    assert "left out: " in result.output
    assert [named.file.name for named in projects[0].runs] == ["run.jsonl"]


def test_a_run_beside_another_measurement_is_not_on_the_first_page(tmp_path: Path) -> None:
    records = [SLOWER, Disturbance(["compare"])]
    file = run_file(tmp_path / "runs", labelled("a"), *records, command="versions")
    site.write_source(Project(tmp_path, reports.read([file])), tmp_path / "source")
    assert "| disturbed |" in (tmp_path / "source/reports.md").read_text()
    assert "comparison of releases" not in (tmp_path / "source/index.md").read_text()


def test_the_page_of_reports_names_commands_and_marks_what_not_to_trust(tmp_path: Path) -> None:
    good, bad = (
        run_file(tmp_path / name, labelled("a"), *compared(raced(cores=cores)), began=began)
        for name, cores, began in (("good", 2.0, "2026-11-20"), ("bad", 0.5, "2026-11-21"))
    )
    named_runs = [
        replace(each, file=Path(f"{name}.jsonl"))
        for name, file in (("good", good), ("bad", bad))
        for each in reports.read([file])
    ]
    site.write_source(Project(tmp_path, named_runs), tmp_path / "source")
    page = (tmp_path / "source/reports.md").read_text()
    lines = [line for line in page.splitlines() if "`mjbench compare 'a model'`" in line]
    assert [line.count("disturbed") for line in lines] == [1, 0]  # the newest first
    index = (tmp_path / "source/index.md").read_text()
    assert "reports/good.html" in index
    assert "reports/bad.html" not in index
