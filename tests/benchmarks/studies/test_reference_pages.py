"""The reference pages have what the code has."""

import click
import pytest

from benchmarks.studies import reference_pages
from benchmarks.studies.page_part import of_lines
from mjbench.cli import cli
from mjbench.commands.show.kinds import RECORD_TYPES


@pytest.mark.parametrize(
    ("part", "lines"),
    [
        (reference_pages.COMMANDS, reference_pages.command_lines),
        (reference_pages.LINT_RULES, reference_pages.rule_lines),
        (reference_pages.RECORDS, reference_pages.record_lines),
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_a_page_has_what_the_code_has(part, lines) -> None:
    assert part.text() == of_lines(lines()), "python -m benchmarks.studies.reference_pages"


def test_every_command_that_is_listed_has_its_options() -> None:
    _, *sections = of_lines(reference_pages.command_lines()).split("### mjbench ")
    texts = dict(section.split("\n", 1) for section in sections)
    assert set(texts) == set(cli.commands)
    for name, command in cli.commands.items():
        if not isinstance(command, click.Group):
            options = (each for each in command.params if isinstance(each, click.Option))
            assert not [o.name for o in options if not o.hidden and o.opts[0] not in texts[name]]


def test_an_option_that_several_commands_share_is_described_once() -> None:
    text = of_lines(reference_pages.command_lines())
    assert text.count("Wait until no other mjbench measures on this machine.") == 1


def test_examples_are_of_committed_runs() -> None:
    lines = list(reference_pages.record_lines())
    assert ' "schema": 1,' in lines
    assert ' "metric": "time",' in lines


def test_every_record_of_a_run_file_has_an_example() -> None:
    lines = list(reference_pages.record_lines())
    assert {line for line in lines if line.startswith('{"type"')} == {
        f'{{"type": "{name}",' for name in ["run", *RECORD_TYPES]
    }
