"""Write what pages have of the code: commands, rules of lint, lines of files.

    python -m benchmarks.studies.reference_pages

writes parts of docs/commands.md, docs/lint.md and docs/formats.md. Do it again when a command's
options, a rule or a record changed; a test compares.
"""

import copy
import inspect
import json
import re
import textwrap
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.studies.page_part import PagePart
from mjbench.results import markdown

if TYPE_CHECKING:
    import click

WRITER = "benchmarks.studies.reference_pages"
COMMANDS = PagePart("commands.md", "commands", WRITER)
LINT_RULES = PagePart("lint.md", "rules", WRITER)
RECORDS = PagePart("formats.md", "records", WRITER)
# Characters of a line of help, or of an example.
WIDTH = 96
# Characters of a value in an example of a record.
VALUE_WIDTH = 30
# Commands that have an option before the page describes it once.
SHARED_BY = 2
# How the paragraphs of help begin that the page has, besides each first one.
PAGE_PARAGRAPHS = ("Exit code", "Each is a model")
RUNS = Path(__file__).resolve().parents[2] / "results" / "runs"


def main() -> None:
    """Write all parts."""
    COMMANDS.write(command_lines())
    LINT_RULES.write(rule_lines())
    RECORDS.write(record_lines())


def command_lines() -> Iterator[str]:
    """Yield each command's own options, as `mjbench --help` orders them, and then the shared ones.

    An option is shared if several commands describe it by the same text.
    """
    from mjbench.cli import cli  # late, as below: asv imports this module without click
    from mjbench.command_names import LISTED

    shared = _shared_options()
    for group, names in LISTED.items():
        yield f"## {group}"
        yield ""
        for name in (each for listed in names for each in _with_modes(listed)):
            yield f"### mjbench {name}"
            yield ""
            yield "```text"
            yield from _help(cli.commands[name], name, shared)
            yield "```"
            yield ""
    yield "## Shared options"
    yield ""
    yield "All commands have `-h, --help`."
    yield ""
    yield "```text"
    yield from _definitions(list(shared))
    yield "```"


def _with_modes(name: str) -> list[str]:
    """Return the name of a command and of its modes, such as `versions --explain`."""
    from mjbench.cli import cli

    return [name, *sorted(each for each in cli.commands if each.startswith(f"{name} "))]


def _shared_options() -> dict[tuple[str, str], int]:
    """Return options, as help shows them, that at least SHARED_BY commands have."""
    from mjbench.cli import cli

    counts = Counter(
        record for name, command in cli.commands.items() for record in _options(command, name)
    )
    return {record: count for record, count in counts.items() if count >= SHARED_BY}


def _options(command: "click.Command", name: str) -> list[tuple[str, str]]:
    context = _context(command, name)
    options = (each for each in command.params if each.param_type_name == "option")
    return [record for each in options if (record := each.get_help_record(context))]


def _context(command: "click.Command", name: str) -> "click.Context":
    import click

    return click.Context(command, info_name=f"mjbench {name}", terminal_width=WIDTH)


def _definitions(records: list[tuple[str, str]]) -> list[str]:
    import click

    formatter = click.HelpFormatter(width=WIDTH)
    formatter.write_dl(records)
    return [line.rstrip() for line in formatter.getvalue().splitlines()]


def _help(command: "click.Command", name: str, shared: dict[tuple[str, str], int]) -> Iterator[str]:
    """Yield the main part of a command's help, with only the names of its shared options."""
    import click

    context = _context(command, name)
    own = copy.copy(command)
    own.add_help_option = False
    own.epilog = None
    first, *others = inspect.cleandoc(command.help or "").split("\n\n")
    own.help = "\n\n".join([first, *(text for text in others if text.startswith(PAGE_PARAGRAPHS))])
    own.params = [each for each in command.params if each.get_help_record(context) not in shared]
    yield from (line.rstrip() for line in own.get_help(_context(own, name)).splitlines())
    also = [
        record[0].split(",")[0].split()[0] for record in _options(command, name) if record in shared
    ]
    if also:
        yield ""
        yield from textwrap.wrap(f"Also: {', '.join(also)}", WIDTH, break_on_hyphens=False)
    if isinstance(command, click.Group):
        for inner in sorted(command.commands):
            yield ""
            yield from _help(command.commands[inner], f"{name} {inner}", shared)


def rule_lines() -> Iterator[str]:
    """Yield the tables of rules: those about wrong results first."""
    from mjbench.commands.lint.rules import RULES

    for title, is_wrong_result in (("Wrong results", True), ("Time", False)):
        rows = (
            (rule.code, _cell(rule.message))
            for rule in RULES
            if rule.is_wrong_result == is_wrong_result
        )
        yield f"### {title}"
        yield ""
        yield from markdown.table_lines(["code", "what lint reports"], rows)
        yield ""


def record_lines() -> Iterator[str]:
    """Yield an example of each line of a run file, below the command that writes it.

    Each is the first good one of the committed reference runs, in today's form. Keys without
    a value, and all keys of a record that none of these has, stand together at the end.
    """
    from mjbench.commands.show.kinds import KINDS
    from mjbench.host.disturbance import Disturbance
    from mjbench.results.runs import RunHeader

    examples = _examples()
    sections: list[tuple[str, tuple[type[Any], ...]]] = [
        ("Every command", (RunHeader, Disturbance))
    ]
    sections += [(" and ".join(f"`{name}`" for name in k.commands), k.records) for k in KINDS]
    for title, records in sections:
        yield f"### {title}"
        yield ""
        yield "```text"
        for kind in records:
            yield from _record_lines(kind, examples.get(kind))
        yield "```"
        yield ""


def _record_lines(kind: type[Any], example: dict[str, Any] | None) -> Iterator[str]:
    yield f'{{"type": "{kind.record_type}",'
    values = example or {each.name: None for each in fields(kind)}
    filled = {key: value for key, value in values.items() if value or value == 0}
    lines = [f' "{key}": {_short(value)},' for key, value in filled.items()]
    empty = ", ".join(f'"{key}"' for key in values if key not in filled)
    lines += textwrap.wrap(empty, WIDTH, initial_indent=" ", subsequent_indent=" ")
    yield from lines[:-1]
    yield f"{lines[-1].removesuffix(',')}}}"


def _examples() -> dict[type[Any], dict[str, Any]]:
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.results import runs

    examples: dict[type[Any], dict[str, Any]] = {}
    for file in sorted(RUNS.glob("reference-*.jsonl")):
        run = runs.load(file, RECORD_TYPES)
        for record in (run.header, *run.records):
            if getattr(record, "status", "ok") == "ok":
                examples.setdefault(type(record), runs.to_json(record))
    return examples


def _short(value: Any) -> str:
    """Return a value as JSON that fits a line: of a list its beginning, of a text as well."""
    text = json.dumps(_first(value), ensure_ascii=False).replace('"…"', "…")
    if len(text) <= VALUE_WIDTH:
        return text
    whole_words = text[:VALUE_WIDTH].rpartition(" ")[0]
    return f"{whole_words or text[:VALUE_WIDTH]}…"


def _first(value: Any) -> Any:
    """Return a JSON value with one item of each list, and four digits of each number."""
    if isinstance(value, list):
        return [*map(_first, value[:1]), *["…"][: len(value) - 1]]
    if isinstance(value, dict):
        return {key: _first(item) for key, item in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _cell(text: str) -> str:
    """Return a text of the code as a cell of a table."""
    text = re.sub(r"\bNone\b", "null", " ".join(text.split()))
    return text.replace("|", "\\|").removesuffix(".")


if __name__ == "__main__":
    main()
