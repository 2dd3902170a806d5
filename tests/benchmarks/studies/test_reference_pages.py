"""The reference pages have what the code has."""

import pytest

from benchmarks.studies import reference_pages
from benchmarks.studies.page_part import of_lines
from mjbench.cli import cli
from mjbench.report.kinds import DOCUMENTS


@pytest.mark.parametrize(
    ("part", "lines"),
    [
        (reference_pages.COMMANDS, reference_pages.command_lines),
        (reference_pages.LINT_RULES, reference_pages.rule_lines),
        (reference_pages.SETTINGS, reference_pages.setting_lines),
        (reference_pages.KEYS, reference_pages.key_lines),
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_a_page_has_what_the_code_has(part, lines) -> None:
    assert part.text() == of_lines(lines()), "python -m benchmarks.studies.reference_pages"


def test_every_command_that_is_listed_has_its_options() -> None:
    text = of_lines(reference_pages.command_lines())
    listed = {line.removeprefix("### mjbench ") for line in text.splitlines() if "###" in line}
    assert listed == set(cli.commands)
    assert text.count("Options:") >= len(listed)


def test_every_document_and_every_type_that_is_named_has_its_keys() -> None:
    lines = list(reference_pages.key_lines())
    titles = {line.removeprefix("### ") for line in lines if line.startswith("### ")}
    anchors = {title.lower().replace(" ", "-") for title in titles}
    linked = {link.partition(")")[0] for line in lines for link in line.split("](#")[1:]}
    assert linked <= anchors
    documents = [line for line in lines if line.startswith("| `mjbench ")]
    assert len(documents) == len(DOCUMENTS) + 1  # and that of a run set
