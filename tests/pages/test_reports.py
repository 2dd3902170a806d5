"""Reports of run files: complete, escaped, and in need of nothing beside them."""

import html.parser
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import example_races
import pytest
from click.testing import CliRunner
from commands import ROOT
from example_records import model_record

from mjbench.cli import cli
from mjbench.host import machine
from mjbench.pages import html as as_html
from mjbench.pages import markdown as as_markdown
from mjbench.pages import reports
from mjbench.pages.reports import NamedRun
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import runs
from mjbench.store.run_file import RunFile
from mjbench.store.runs import Record, RunHeader

COMMITTED = sorted((ROOT / "results/runs").glob("reference-*.jsonl"))
HOSTILE = "<script>alert('&\"')</script>|`x`[a](javascript:b)"


class Page(html.parser.HTMLParser):
    """What a page holds: tags with their attributes, and text."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)


def run_file(folder: Path, *records: Record, command: str = "compare") -> Path:
    header = RunHeader(
        runs.SCHEMA, command, machine.describe(), {}, command_line=(command, "a model.xml")
    )
    file = RunFile.create(folder, header)
    for record in records:
        file.append(record)
    file.close()
    return file.path


def compared(name: str, **fields: Any) -> list[Record]:
    """Return the records of a model on which one path is as `fields` say."""
    model, base, rollout, *others = example_races.compared(example_races.raced(model=name))
    return [model, base, replace(rollout, **fields), *others]


def named(file: Path) -> NamedRun:
    return NamedRun(file, runs.load(file, RECORD_TYPES))


@pytest.fixture(autouse=True)
def needs_the_report_extra() -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")


@pytest.mark.parametrize("file", COMMITTED, ids=lambda f: f.stem)
def test_a_committed_run_becomes_one_page_that_needs_nothing_else(file: Path) -> None:
    if "history" in file.name:
        pytest.skip("a history is tested with all its files")
    text = as_html.render(reports.build([named(file)]))
    page = Page(text)
    assert len(text) < 6e6
    assert page.count("section") >= 2
    for tag, attributes in page.tags:
        assert tag not in ("link", "img", "iframe") or attributes.get("rel") == "icon"
        assert not re.match("(https?:)?//", attributes.get("href") or attributes.get("src") or "")
    figures = re.findall(r"<figure>.*?</figure>", text, flags=re.S)
    assert all(re.search(r'class="mark-\w+ role-mark', figure) for figure in figures)
    markdown = "\n".join(as_markdown.render(reports.build([named(file)])))
    assert markdown.startswith("## mjbench ")
    assert markdown.count("<details>") == markdown.count("</details>") >= 2


def test_names_are_text_and_no_markup(tmp_path: Path) -> None:
    file = run_file(tmp_path, *compared(HOSTILE))
    report = reports.build([named(file)])
    text = as_html.render(report)
    page = Page(text)
    assert page.count("script") == 1
    assert HOSTILE in page.text
    markdown = "\n".join(as_markdown.render(report))
    assert "<script>" not in markdown
    outside_html = [line for line in markdown.splitlines() if not line.startswith("<details>")]
    assert not any(re.search(r"(?<!\\)\]\(javascript", line) for line in outside_html)


def test_what_went_wrong_comes_first(tmp_path: Path) -> None:
    wrong = {
        "status": Status.DISAGREES,
        "agrees": False,
        "agreement": "qpos[0] of simulation 0 differs after step 3",
    }
    file = run_file(
        tmp_path,
        *compared("fine"),
        *compared("spoilt", **wrong),
        model_record(model="dead", status=Status.TIMEOUT, detail="killed", facts=None, work=None),
    )
    report = reports.build([named(file)])
    assert "does other work than the plain loop" in report.conclusions[0].text
    assert "dead: timeout: killed" in report.conclusions[1].text
    page = Page(as_html.render(report))
    assert "spoilt" in page.text
    assert "dead" in page.text
    assert "mjbench compare 'a model.xml'" in page.text


def test_a_run_without_records_says_so(tmp_path: Path) -> None:
    report = reports.build([named(run_file(tmp_path))])
    assert report.conclusions[0].text == "Nothing was measured."
    assert "Nothing was measured." in Page(as_html.render(report)).text


def test_a_report_of_many_models_has_all_tables_and_some_charts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_FIGURES", 2)
    records = [record for name in "abc" for record in compared(name)]
    report = reports.build([named(run_file(tmp_path, *records))])
    assert [len(section.figures) for section in report.sections] == [1, 1, 0, 0]
    assert len(report.sections[2].tables) == 1
    assert "Not drawn" in report.sections[2].notes[-1]


def test_several_runs_are_one_report(tmp_path: Path) -> None:
    files = [run_file(tmp_path, *compared(name)) for name in ("first", "second")]
    report = reports.build([named(file) for file in files])
    assert len(report.sections) == 2
    assert len(report.machines.rows) == 2


def test_the_command_writes_a_file_or_markdown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = run_file(tmp_path / "results/runs", *compared("cartpole"))
    result = CliRunner().invoke(cli, ["report", "-o", "page.html"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "page.html").read_text().startswith("<!doctype html>")
    result = CliRunner().invoke(cli, ["report", str(file), "--markdown"])
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("## mjbench compare")
    result = CliRunner().invoke(cli, ["report", str(file), "-o", str(file)])
    assert result.exit_code == 2
    assert "a file that this command reads" in result.output
    result = CliRunner().invoke(cli, ["report", "missing.jsonl"])
    assert result.exit_code == 2


def test_the_only_section_keeps_what_the_head_of_a_report_has_no_room_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_CONCLUSIONS", 1)
    report = reports.build([named(run_file(tmp_path, *compared("m")))])
    assert report.conclusions[-1].text.endswith("further conclusions are in their sections.")
    assert len(report.sections[0].conclusions) > 1
