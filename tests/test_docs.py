"""The pages name what exists: modules, files, links, commands."""

import ast
import contextlib
import re
import shlex
import tomllib
from collections.abc import Sequence
from pathlib import Path

import click
import pytest
import yaml
from commands import ROOT, mjbench

from benchmarks.studies.results_page import ENOUGH_LAUNCHES
from mjbench.cli import cli
from mjbench.commands.checkup.result import CheckedPart
from mjbench.commands.compare.results import derive_all
from mjbench.commands.profile import habit_timing
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.tune import result as records
from mjbench.commands.tune.result import TuneRecord
from mjbench.paired import outcomes, race_record
from mjbench.paired.records import VerdictRecord
from mjbench.results import runs
from mjbench.status import ExitCode
from mjbench.testing import fixture

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("[!.]*/README.md")])
PACKAGES = sorted(p.parent.name for p in (ROOT / "mjbench").glob("*/__init__.py"))


# The most words of a page, or of all pages of a folder together.
LIMITS = {
    "README.md": 750,
    "CONTRIBUTING.md": 860,
    "models/README.md": 440,
    "results/README.md": 525,
    "docs/architecture.md": 830,
    "docs/asv.md": 360,
    "docs/commands.md": 3500,
    "docs/faq.md": 4230,
    "docs/faults.md": 260,
    "docs/formats.md": 1000,
    "docs/glossary.md": 280,
    "docs/guides/*.md": 6500,
    "docs/history.md": 1500,
    "docs/lab.md": 220,
    "docs/lint.md": 950,
    "docs/method/*.md": 7000,
    "docs/python.md": 620,
    "docs/results.md": 1600,
}


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


WRITTEN_PART = r"(?s)<!-- [\w-]+: written by .*?<!-- end -->"


def prose_of(page: Path) -> str:
    """Return what people wrote on a page, without code."""
    text = re.sub(WRITTEN_PART, "", page.read_text())
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    return "\n\n".join(re.sub(r"`[^`]+`", "", part) for part in prose.split("\n\n"))


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
    text = re.sub(r"^```text$.*?^```$", "", page.read_text(), flags=re.M | re.S)  # printed by help
    for path in re.findall(rf"(?<![\w/.…-])((?:{folders})/[\w./<>*…-]+\.\w+)", text):
        is_pattern = bool(set("<>*…") & set(path)) or path.startswith("models/NAME")
        assert is_pattern or (ROOT / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_test_that_a_page_names_exists(page: Path) -> None:
    for file, test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page.read_text()):
        assert re.search(rf"^def {test}\(", (ROOT / file).read_text(), flags=re.M), test


@pytest.mark.parametrize("page", [*PAGES, ROOT / "Makefile"], ids=name)
def test_every_command_of_the_benchmarks_that_a_page_names_exists(page: Path) -> None:
    for module in re.findall(r"python\s-m\s(benchmarks\.[\w.]*\w)", page.read_text()):
        path = ROOT / module.replace(".", "/")
        file = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
        assert file.is_file() and "__main__" in file.read_text(), module


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_the_makefile_alone_says_how_long_its_targets_take(page: Path) -> None:
    said = r"`make [\w-]+`[^.\n]*\b(?:minutes?|hours?)\b"
    assert not re.search(said, page.read_text())


def commands_of(page: Path) -> list[list[str]]:
    """Return the words of each command of mjbench that a page shows, in a block or inline."""
    text = page.read_text()
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", text, flags=re.M | re.S)
    lines = [line for language, block in blocks if not language for line in block.splitlines()]
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    spans = [span for part in prose.split("\n\n") for span in re.findall(r"`([^`]+)`", part)]
    lines += [" ".join(span.split()) for span in spans if span.startswith("mjbench ")]
    return [
        words
        for line in lines
        for part in re.split(r"&&|>>", line)
        if (words := shlex.split(part.replace("'", ""), comments=True)) and "mjbench" in words[0:2]
    ]


def parse(words: Sequence[str]) -> None:
    """Parse a command line as `mjbench` does, without running it; its end may be left out."""
    with contextlib.suppress(click.MissingParameter, click.BadOptionUsage, click.exceptions.Exit):
        context: click.Context = cli.make_context("mjbench", list(words))
        while isinstance(context.command, click.Group):
            rest = [*context._protected_args, *context.args]
            if not rest:
                return
            command_name, command, rest = context.command.resolve_command(context, rest)
            assert command is not None
            context = command.make_context(command_name, list(rest), parent=context)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_command_that_a_page_shows_parses(page: Path) -> None:
    if page.name == "commands.md":
        pytest.skip("written from the code")
    for words in commands_of(page):
        parse(words[words.index("mjbench") + 1 :])


def test_a_command_with_another_option_does_not_parse() -> None:
    parse(["compare", "robot.xml", "--scaling"])
    with pytest.raises(click.NoSuchOption):
        parse(["compare", "robot.xml", "--scalling"])


@pytest.mark.parametrize(("pages", "limit"), LIMITS.items())
def test_pages_are_short(pages: str, limit: int) -> None:
    """Of pages that commands write, too."""
    assert sum(len(page.read_text().split()) for page in ROOT.glob(pages)) <= limit


def test_every_page_of_the_documentation_has_a_limit() -> None:
    limited = {page for pages in LIMITS for page in ROOT.glob(pages)}
    assert set(ROOT.glob("docs/**/*.md")) <= limited


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_of_code_can_be_read(page: Path) -> None:
    readers = {"python": ast.parse, "toml": tomllib.loads, "yaml": yaml.safe_load}
    for language, block in re.findall(
        r"^```(\w+)\n(.*?)^```$", page.read_text(), flags=re.M | re.S
    ):
        assert language in {"text", *readers}, language
        if language in readers:
            readers[language](block)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_a_page_shows_of_a_committed_run_is_what_show_prints(page: Path) -> None:
    """Lines may be left out; a page may name the width of the terminal."""
    shown = r"<!-- of (results/runs/\S+?)(?:, (\d+) columns)? -->\n+```\n(.*?)^```$"
    for file, columns, block in re.findall(shown, page.read_text(), flags=re.M | re.S):
        printed = mjbench("show", file, env={"COLUMNS": columns or "200"}).stdout
        lines = {" ".join(line.split()) for line in printed.splitlines()}
        for line in block.splitlines():
            words = " ".join(line.split())
            assert words in {"", "…", *lines}, line


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_paragraph_that_names_a_disturbed_run_says_so(page: Path) -> None:
    for paragraph in re.split(r"\n\n|\n(?=\| )", page.read_text()):
        for file in re.findall(r"results/runs/[\w.-]+\.jsonl", paragraph):
            if "Disturbed" in mjbench("show", file).stdout:
                assert "disturbed" in paragraph, file


def targets_of_few_launches(run: runs.Run) -> set[str]:
    """Return the models of a run that have a figure from fewer launches than are enough."""
    launches = [(row.model, row.launches) for row in run.of_type(VerdictRecord)]
    for group in derive_all(run.records):
        launches += [(row.model, row.launches) for row in group.results if row.is_timed]
    checkups = [each for each in run.of_type(CheckedPart) if each.verdict is not None]
    launches += [(each.target, each.verdict.launches) for each in checkups]
    for search in run.of_type(TuneRecord):
        timed = (attempt for attempt in search.attempts if attempt.ratio is not None)
        launches += [(search.model, len(attempt.launches)) for attempt in timed]
    return {name for name, count in launches if count < ENOUGH_LAUNCHES}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_figure_from_few_launches_is_said_to_be(page: Path) -> None:
    """In the paragraph that names the run, or in the one after the lines that it printed."""
    paragraphs = re.split(r"\n\n|\n(?=\| )", page.read_text())
    for paragraph, following in zip(paragraphs, [*paragraphs[1:], ""], strict=True):
        for file in re.findall(r"results/runs/[\w.-]+\.jsonl", paragraph):
            few = targets_of_few_launches(runs.load(ROOT / file, RECORD_TYPES))
            text = f"{paragraph}\n{following}" if "```" in paragraph else paragraph
            if named := [target for target in few if target in paragraph]:
                assert re.search(r"\blaunch(es)?\b", text), f"{file}: {named}"


def test_the_page_of_commands_has_every_exit_code() -> None:
    text = (ROOT / "docs/commands.md").read_text()
    assert [int(code) for code in re.findall(r"^\| (\d+) \|", text, flags=re.M)] == [*ExitCode]


def test_each_answer_of_the_questions_is_short_and_names_a_command() -> None:
    answers = (ROOT / "docs/faq.md").read_text().split("\n### ")[1:]
    for answer in answers:
        question, _, text = answer.partition("\n")
        assert len(text.partition("\n## ")[0].split()) <= 80, question
        assert "mjbench" in text, question


def test_the_page_of_method_states_the_confidence_of_each_command() -> None:
    text = (ROOT / "docs/method/README.md").read_text(encoding="utf-8")
    stated = {
        words: float(percent) / 100
        for words, percent in re.findall(r"^\| (`?[^|]*?) \| (\d+) % \|", text, flags=re.M)
    }
    assert stated == {
        "`compare`": race_record.CONFIDENCE,
        "`versions`, `ab`": outcomes.CONFIDENCE,
        "`tune`": records.CONFIDENCE,
        "`profile --habits`": habit_timing.CONFIDENCE,
        "the pytest fixture": fixture.CONFIDENCE,
    }
