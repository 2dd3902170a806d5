"""Write what pages have of the code: commands, rules of lint, settings of tune, lines of files.

    python -m benchmarks.studies.reference_pages

writes parts of docs/commands.md, docs/lint.md, docs/method/tune.md and docs/formats.md. Do it
again when a command's options, a rule, a setting or a record changed; a test compares.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.studies.page_part import PagePart
from mjbench.pages import markdown

if TYPE_CHECKING:
    import click

WRITER = "benchmarks.studies.reference_pages"
COMMANDS = PagePart("commands.md", "commands", WRITER)
LINT_RULES = PagePart("lint.md", "rules", WRITER)
SETTINGS = PagePart("method/tune.md", "settings", WRITER)
RECORDS = PagePart("formats.md", "records", WRITER)
# Characters of a line of help, or of an example.
WIDTH = 96
RUNS = Path(__file__).resolve().parents[2] / "results" / "runs"


def main() -> None:
    """Write all parts."""
    COMMANDS.write(command_lines())
    LINT_RULES.write(rule_lines())
    SETTINGS.write(setting_lines())
    RECORDS.write(record_lines())


def command_lines() -> Iterator[str]:
    """Yield a section for each command, with its help, in the order of `mjbench --help`."""
    from mjbench.cli import cli  # late, as below: asv imports this module without click
    from mjbench.command_names import LISTED

    for group, names in LISTED.items():
        yield f"## {group}"
        yield ""
        for name in (each for listed in names for each in _with_modes(listed)):
            yield f"### mjbench {name}"
            yield ""
            yield "```text"
            yield from _help(cli.commands[name], name)
            yield "```"
            yield ""


def _with_modes(name: str) -> list[str]:
    """Return the name of a command and of its modes, such as `versions --explain`."""
    from mjbench.cli import cli

    return [name, *sorted(each for each in cli.commands if each.startswith(f"{name} "))]


def _help(command: "click.Command", name: str) -> Iterator[str]:
    import click

    from mjbench.cli import cli

    names = cli.context_settings["help_option_names"]
    context = click.Context(
        command, info_name=f"mjbench {name}", terminal_width=WIDTH, help_option_names=names
    )
    yield from (line.rstrip() for line in command.get_help(context).splitlines())
    if isinstance(command, click.Group):
        for inner in sorted(command.commands):
            yield ""
            yield from _help(command.commands[inner], f"{name} {inner}")


def rule_lines() -> Iterator[str]:
    """Yield the table of rules: those about wrong results first."""
    from mjbench.loop.lint_rules import RULES

    ordered = sorted(RULES, key=lambda rule: not rule.is_wrong_result)
    rows = (
        (rule.code, _cell(rule.message), "result" if rule.is_wrong_result else "time")
        for rule in ordered
    )
    yield from markdown.table_lines(["code", "what lint reports", "about"], rows)


def setting_lines() -> Iterator[str]:
    """Yield the table of what `tune` may change."""
    from mjbench.tuning.knobs import KNOBS

    rows = ((knob.name, _cell(knob.changes), knob.since) for knob in KNOBS)
    yield from markdown.table_lines(["setting", "what it may change", "since MuJoCo"], rows)


def record_lines() -> Iterator[str]:
    """Yield an example of each line of a run file, below the command that writes it.

    Each is the first good one of the committed reference runs, in today's form. A record that none
    of these has is shown by its keys.
    """
    from mjbench.host.neighbours import Disturbance
    from mjbench.report.kinds import KINDS
    from mjbench.store.runs import RunHeader

    examples = _examples()
    sections: list[tuple[str, tuple[type[Any], ...]]] = [
        ("every command", (RunHeader, Disturbance))
    ]
    sections += [(" and ".join(f"`{name}`" for name in k.commands), k.records) for k in KINDS]
    for title, records in sections:
        yield f"### Of {title}"
        yield ""
        for kind in records:
            keys = examples.get(kind, {each.name: ... for each in fields(kind)})
            yield "```text"
            yield f'{{"type": "{kind.record_type}",'
            yield from (f' "{key}": {_short(value)},' for key, value in keys.items())
            yield "}"
            yield "```"
            yield ""


def _examples() -> dict[type[Any], dict[str, Any]]:
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import runs

    examples: dict[type[Any], dict[str, Any]] = {}
    for file in sorted(RUNS.glob("reference-*.jsonl")):
        run = runs.load(file, RECORD_TYPES)
        for record in (run.header, *run.records):
            if getattr(record, "status", "ok") == "ok":
                examples.setdefault(type(record), runs.to_json(record))
    return examples


def _short(value: Any) -> str:
    """Return a value as JSON that fits a line: of a list its beginning, of a text as well."""
    text = "…" if value is ... else json.dumps(_first(value), ensure_ascii=False)
    text = text.replace('"…"', "…")
    return text if len(text) <= WIDTH - 20 else f"{text[: WIDTH - 21]}…"


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
