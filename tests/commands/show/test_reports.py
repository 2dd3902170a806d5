"""Reports of run files: complete, escaped, and in need of nothing beside them."""

import csv
import html.parser
import re
import urllib.parse
from dataclasses import replace
from pathlib import Path
from typing import Any

import example_races
import pytest
from click.testing import CliRunner
from commands import ROOT
from example_records import measurement, model_record
from set_files import MACHINE, labelled, run_file
from verdict_records import FAILED, FASTER, OPEN, SAME, SLOWER, of_model

from mjbench import formats
from mjbench.cli import cli
from mjbench.commands.show import reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.interval import Interval
from mjbench.results import html as as_html
from mjbench.results import markdown as as_markdown
from mjbench.results import runs
from mjbench.results.content import Column, DataTable, Report, Section, Tone
from mjbench.results.runs import Record
from mjbench.status import Status

COMMITTED = sorted((ROOT / "results/runs").glob("reference-*.jsonl"))


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


def test_what_went_wrong_comes_first(tmp_path: Path) -> None:
    wrong = {
        "status": Status.DISAGREES,
        "agrees": False,
        "agreement": "qpos[0] of simulation 0 differs after step 3",
    }
    file = run_file(
        tmp_path,
        MACHINE,
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
    assert "mjbench compare 'a model'" in page.text


def test_a_run_without_records_says_so(tmp_path: Path) -> None:
    report = reports.build([named(run_file(tmp_path, MACHINE))])
    assert report.conclusions[0].text == "Nothing was measured."
    assert "Nothing was measured." in Page(as_html.render(report)).text


def test_a_report_of_many_models_has_all_tables_and_some_charts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_FIGURES", 2)
    records = [record for name in "abc" for record in compared(name)]
    report = reports.build([named(run_file(tmp_path, MACHINE, *records))])
    sections = [*report.summaries, *report.sections]
    assert [len(section.figures) for section in sections] == [1, 1, 0, 0]
    assert len(sections[2].tables) == 1
    assert "Not drawn" in sections[2].notes[-1]


def test_several_runs_are_one_report(tmp_path: Path) -> None:
    files = [run_file(tmp_path, MACHINE, *compared(name)) for name in ("first", "second")]
    report = reports.build([named(file) for file in files])
    assert len(report.sections) == 2
    assert len(report.machines.rows) == 2


def test_the_command_writes_a_file_or_markdown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = run_file(tmp_path / "results/runs", MACHINE, *compared("cartpole"))
    result = CliRunner().invoke(cli, ["show", "--html", "page.html"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "page.html").read_text().startswith("<!doctype html>")
    result = CliRunner().invoke(cli, ["show", str(file), "--markdown", "-"])
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("## mjbench compare")
    result = CliRunner().invoke(cli, ["show", str(file), "--html", str(file)])
    assert result.exit_code == 2
    assert "a file that this command reads" in result.output
    result = CliRunner().invoke(cli, ["show", "--html", "page.html", "missing.jsonl"])
    assert result.exit_code == 2


def test_what_the_head_of_a_report_has_no_room_for_is_folded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_CONCLUSIONS", 1)
    report = reports.build([named(run_file(tmp_path, MACHINE, *compared("m")))])
    assert (len(report.conclusions), len(report.further)) == (1, 1)
    assert "<summary>1 further conclusion</summary>" in as_html.render(report)
    assert report.further[0].text in "\n".join(as_markdown.render(report))


def test_of_several_models_the_head_has_what_is_advised_and_what_went_wrong(tmp_path: Path) -> None:
    wrong = {"status": Status.DISAGREES, "agrees": False}
    records = [record for name in "abc" for record in compared(name)]
    report = reports.build([named(run_file(tmp_path, MACHINE, *records, *compared("d", **wrong)))])
    assert "does other work" in report.conclusions[0].text
    assert report.conclusions[-1].text.startswith("Advice for 4 models: ")
    assert [section.heading.split(":")[0] for section in report.summaries] == ["Advice"]
    shown = re.sub(r"<details>.*?</details>", "", "\n".join(as_markdown.render(report)), flags=re.S)
    assert "| a | closed |" in shown


def test_the_head_says_what_was_measured_when_and_where(tmp_path: Path) -> None:
    file = run_file(tmp_path, MACHINE, *compared("m"))
    report = reports.build([named(file)])
    assert report.title == "mjbench compare 'a model'"
    assert f"Python {MACHINE.python}" in report.subtitle
    assert report.subtitle in Page(as_html.render(report)).text


@pytest.mark.parametrize("name", ["runs/reference-mujoco-4.0.0", "runs/reference-story-versions"])
def test_markdown_shows_little_and_folds_the_rest(name: str) -> None:
    text = "\n".join(as_markdown.render(report(ROOT / f"results/{name}.jsonl")))
    shown = re.sub(r"</summary>.*?</details>", "", text, flags=re.S)
    assert len(shown) <= 3000


# several machines


def verdict_runs(folder: Path, **records: Record) -> list[Path]:
    """Return run files of machines with a verdict each."""
    return [
        run_file(folder, labelled(name), one, command="versions") for name, one in records.items()
    ]


def report(*files: Path) -> Report:
    return reports.build(reports.read(files))


def texts(content: Report) -> list[str]:
    return [conclusion.text for conclusion in (*content.conclusions, *content.further)]


def all_sections(content: Report) -> list[Section]:
    return [*content.summaries, *content.sections]


def test_machines_are_reported_side_by_side_first_and_then_run_by_run(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, a=SLOWER, b=SAME)
    content = report(*files)
    assert [section.heading for section in all_sections(content)] == [
        "Across machines",
        "a: Verdicts",
        "b: Verdicts",
    ]
    first, *_ = all_sections(content)
    (table,) = first.tables
    assert [column.title for column in table.columns] == ["question", "a", "b"]
    assert [row[0] for row in content.machines.rows] == ["a", "b"]
    assert first.command.startswith("mjbench show ")
    # what runs show alone is in their sections
    assert len(content.conclusions) == 2
    assert "slower on 1 of 2 machines, same on b" in texts(content)[1]


@pytest.mark.parametrize(
    ("verdicts", "tone"),
    [
        ((SLOWER, FASTER), Tone.BAD),
        ((FASTER, OPEN), Tone.GOOD),
        ((SAME, SAME), Tone.NEUTRAL),
        ((SAME, FAILED), Tone.NEUTRAL),
    ],
)
def test_a_conclusion_has_the_tone_of_the_worst_machine(
    tmp_path: Path, verdicts: tuple[Record, Record], tone: Tone
) -> None:
    a, b = verdicts
    assert report(*verdict_runs(tmp_path, a=a, b=b)).conclusions[1].tone == tone


def test_runs_of_one_machine_are_reported_as_before(tmp_path: Path) -> None:
    files = [*verdict_runs(tmp_path, a=SLOWER), *verdict_runs(tmp_path, a=of_model(SAME, "n"))]
    content = report(*files)
    headings = [section.heading for section in all_sections(content)]
    assert [heading.partition(" (")[0] for heading in headings] == ["Verdicts", "Verdicts"]
    assert texts(content)[0].startswith("m, 1.0.0 → 2.0.0: slower by 3 %")


def test_sections_of_several_runs_that_would_be_called_the_same_are_told_apart(
    tmp_path: Path,
) -> None:
    (named,) = reports.read([run_file(tmp_path, labelled("a"), SAME)])
    first, second = (replace(named, file=Path(f"{name}.jsonl")) for name in "xy")

    def headings(*named_runs: NamedRun) -> list[str]:
        return [section.heading for section in reports.build(named_runs).sections]

    assert headings(first) == ["Verdicts"]
    assert headings(first, second) == ["Verdicts (x)", "Verdicts (y)"]
    assert headings(first, first) == ["Verdicts (x) (1)", "Verdicts (x) (2)"]


def test_a_file_that_is_given_twice_is_reported_once(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, a=SLOWER, b=SAME)
    content = report(*files, *files)
    assert len(all_sections(content)) == 3


def test_paths_that_disagree_stand_at_the_head_whichever_machine(tmp_path: Path) -> None:
    wrong = measurement(
        path="rollout", status=Status.DISAGREES, agrees=False, agreement="qpos differs"
    )
    plain = measurement(samples_s=[0.01, 0.011, 0.012])
    files = [
        run_file(tmp_path, labelled("a"), model_record(), plain, wrong),
        run_file(tmp_path, labelled("b"), model_record(), plain),
    ]
    content = report(*files)
    assert [section.heading for section in all_sections(content)] == [
        "a: m: 10 simulations × 100 steps",
        "b: m: 10 simulations × 100 steps",
    ]
    bad = [c.text for c in content.conclusions if c.tone == Tone.BAD]
    assert bad == [
        "a: m, 10 simulations: rollout does other work than the plain loop: qpos differs"
    ]


def test_a_report_of_many_runs_leaves_sections_out_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "_MOST_SECTIONS", 4)
    files = [
        run_file(tmp_path, labelled(name), of_model(SAME, model), command="versions")
        for name in "ab"
        for model in "mno"
    ]
    failed = run_file(tmp_path, labelled("b"), of_model(FAILED, "p"), command="versions")
    content = report(*files, failed)
    headings = [section.heading for section in all_sections(content)]
    assert [heading.partition(" (")[0] for heading in headings] == [
        "Across machines",
        *["a: Verdicts"] * 3,
        "b: Verdicts",
    ]
    assert len(set(headings)) == len(headings)
    assert content.sections[-1].conclusions[0].text.endswith("signal 11")
    assert texts(content)[0].startswith("Left out: 3 of 7 sections of single runs.")
    # all comparisons are in the first table
    assert len(all_sections(content)[0].tables[0].rows) == 4


def test_many_comparisons_are_one_sentence_and_all_rows(tmp_path: Path) -> None:
    records = [of_model(SAME, f"m{n}") for n in range(40)]
    files = [run_file(tmp_path, labelled(name), *records, command="versions") for name in "ab"]
    content = report(*files)
    assert texts(content)[1].endswith(", m9, 1.0.0 → 2.0.0, 4 × 50 steps and 30 more")
    assert len(all_sections(content)[0].tables[0].rows) == 40


def test_of_many_machines_each_cell_is_a_row(tmp_path: Path) -> None:
    files = verdict_runs(tmp_path, **{f"m{n}": SAME for n in range(9)})
    table = report(*files).summaries[0].tables[0]
    assert [column.title for column in table.columns] == ["question", "machine", "answer"]
    assert len(table.rows) == 9


def test_the_command_of_a_section_names_some_files(tmp_path: Path) -> None:
    runs = [
        NamedRun(Path(f"{n}.jsonl"), named.run)
        for n, named in enumerate(
            reports.read(verdict_runs(tmp_path, a=SAME, b=SAME, c=SAME, d=SAME))
        )
    ]
    assert reports.build(runs).summaries[0].command == (
        "mjbench show 0.jsonl 1.jsonl 2.jsonl … --html FILE"
    )


def test_a_table_is_saved_with_the_numbers_that_were_measured_and_not_as_they_are_shown() -> None:
    rows = [("=1+1", -1234.5678, Interval(2.0, 1.5, 2.5), -0.0625), ("a, b", None, None, None)]
    columns = (
        Column("name"),
        Column("ns", formats.digits(3)),
        Column("95 %", formats.ends),
        Column("less", formats.percent),
    )
    table = DataTable("Times: of 100 %", columns, rows)
    page = Page(as_html.render(Report("", (), [Section("a model", tables=[table])])))
    (link,) = (tag for name, tag in page.tags if name == "a" and "download" in tag)
    assert link["download"] == "Times-of-100-.csv"
    kind, _, text = (link["href"] or "").partition(",")
    assert kind == "data:text/csv;charset=utf-8"
    assert list(csv.reader(urllib.parse.unquote(text).splitlines())) == [
        ["name", "ns", "95 % (low)", "95 % (high)", "less (share)"],
        ["'=1+1", "-1234.5678", "1.5", "2.5", "-0.0625"],
        ["a, b", *4 * [""]],
    ]
