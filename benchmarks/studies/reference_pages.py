"""Write what pages have of the code: commands, rules of lint, settings of tune, keys of files.

    python -m benchmarks.studies.reference_pages

writes parts of docs/commands.md, docs/lint.md and docs/method/tune.md, and docs/keys.md. Do it
again when a command's options, a rule, a setting or a record changed; a test compares.
"""

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from benchmarks.studies.page_part import PagePart
from mjbench.pages import markdown

if TYPE_CHECKING:
    import click

WRITER = "benchmarks.studies.reference_pages"
COMMANDS = PagePart("commands.md", "commands", WRITER)
LINT_RULES = PagePart("lint.md", "rules", WRITER)
SETTINGS = PagePart("method/tune.md", "settings", WRITER)
KEYS = PagePart("keys.md", "keys", WRITER)
# Characters of a line of help.
WIDTH = 96


def main() -> None:
    """Write all parts."""
    COMMANDS.write(command_lines())
    LINT_RULES.write(rule_lines())
    SETTINGS.write(setting_lines())
    KEYS.write(key_lines())


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
    """Return the name of a command and of its modes, such as `doctor --verdicts`."""
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


def key_lines() -> Iterator[str]:
    """Yield which type each line and document has, then a section for each type."""
    from mjbench.report.json_schemas import json_schemas
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store.runs import RunHeader

    schemas = json_schemas()
    types: dict[str, dict[str, Any]] = {}
    for schema in schemas.values():
        types |= schema["$defs"]
    link = functools.partial(_link, types)
    yield "## Lines of a run file"
    yield ""
    kinds: dict[str, type[Any]] = {"run": RunHeader, **RECORD_TYPES}
    records = ((f"`{name}`", link(_reference(kind.__name__))) for name, kind in kinds.items())
    yield from markdown.table_lines(["type", "keys"], records)
    yield ""
    yield "## Documents"
    yield ""
    documents = ((f"`{s['title']}`", link(s)) for s in schemas.values() if "$ref" in s)
    yield from markdown.table_lines(["written by", "keys"], documents)
    yield ""
    yield "## Types"
    for name in sorted(types, key=str.lower):
        if "enum" not in types[name]:
            yield ""
            yield from _type_lines(name, types[name], link)


def _type_lines(
    name: str, schema: Mapping[str, Any], link: Callable[[Mapping[str, Any]], str]
) -> Iterator[str]:
    """Yield what a type is, and its keys."""
    summary, meanings = _described(schema.get("description", ""))
    yield f"### {_title(name)}"
    yield ""
    if summary:
        yield _cell(summary) + "."
        yield ""
    rows = (
        (f"`{key}`", link(value), _cell(meanings.get(key, "")))
        for key, value in schema["properties"].items()
    )
    yield from markdown.table_lines(["key", "value", "meaning"], rows)


def _described(description: str) -> tuple[str, dict[str, str]]:
    """Return the first paragraph of a type's docstring, and what it says of the keys."""
    text, _, attributes = inspect.cleandoc(description).partition("Attributes:\n")
    entries = re.split(r"^ {2}(?=\w+: )", attributes, flags=re.M)[1:]
    return text.partition("\n\n")[0], dict(entry.split(": ", 1) for entry in entries)


def _link(types: Mapping[str, Mapping[str, Any]], schema: Mapping[str, Any]) -> str:
    """Return the type of a value; a link to its section if it has keys of its own."""
    link = functools.partial(_link, types)
    match schema:
        case {"$ref": str(reference)}:
            name = reference.rpartition("/")[2]
            title = _title(name)
            is_enum = "enum" in types[name]
            return (
                link(types[name]) if is_enum else f"[{title}](#{title.lower().replace(' ', '-')})"
            )
        case {"anyOf": options}:
            return " or ".join(map(link, options))
        case {"const": value}:
            return f"`{value}`"
        case {"enum": words}:
            return " or ".join(f"`{word}`" for word in words)
        case {"type": "array", "items": dict(items)}:
            return f"list of {link(items)}"
        case {"type": "object", "additionalProperties": dict(values)}:
            return f"map of {link(values)}"
        case {"type": str(kind)}:
            return kind
    return "any"


def _reference(name: str) -> dict[str, str]:
    return {"$ref": f"#/$defs/{name}"}


def _title(name: str) -> str:
    """Return a type's name for people; those of generic types are long."""
    generic, _, parameter = name.partition("_")
    inner = re.findall(r"Work|int|float", parameter)
    return f"{generic} of {inner[0].lower()}" if inner else name


def _cell(text: str) -> str:
    """Return a text of the code as a cell of a table."""
    text = re.sub(r"\bNone\b", "null", " ".join(text.split()))
    return text.replace("|", "\\|").removesuffix(".")


if __name__ == "__main__":
    main()
