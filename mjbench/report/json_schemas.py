"""The JSON Schemas of what mjbench writes: of documents, and of lines of run files and run sets.

    python -m mjbench.report.json_schemas

writes `mjbench/schemas/NAME.json` for each of them, generated from the types. Do it again when a
type changed; a test compares.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from mjbench.command_names import present_name
from mjbench.report.documents import RunSetDocument
from mjbench.report.kinds import DOCUMENTS, RECORD_TYPES
from mjbench.store.json_form import json_type
from mjbench.store.run_set import SectionHeader, SetHeader
from mjbench.store.runs import RunHeader

SCHEMA_FOLDER = Path(__file__).resolve().parents[1] / "schemas"


def json_schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON Schemas by file name without its suffix.

    There is one a document, `run-file` for a line of a run file, `run-set` for a line of a set that
    is none of a run file, and `show-run-set` for what `show` writes of one.
    """
    schemas = {
        name: _schema(kind, f"mjbench {present_name(name)} --json")
        for name, kind in DOCUMENTS.items()
    }
    schemas["show-run-set"] = _schema(RunSetDocument, "mjbench show --json, of a run set")
    title = "one line of a run file of mjbench"
    schemas["run-file"] = _lines_schema([RunHeader, *RECORD_TYPES.values()], title)
    title = "one line of a run set of mjbench that is none of a run file"
    schemas["run-set"] = _lines_schema([SetHeader, SectionHeader], title)
    return schemas


def _lines_schema(kinds: Sequence[type], title: str) -> dict[str, Any]:
    lines = [_record_schema(kind) for kind in kinds]
    definitions = {name: d for line in lines for name, d in line.pop("$defs").items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "anyOf": lines,
        "$defs": definitions,
    }


def _schema(kind: type, title: str) -> dict[str, Any]:
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
    return {**head, **msgspec.json.schema(json_type(kind))}


def _record_schema(kind: Any) -> dict[str, Any]:
    """Return the schema of a line: a record with its type, which one within another lacks."""
    schema = msgspec.json.schema(kind)
    return {**schema, "properties": {"type": {"const": kind.record_type}}, "required": ["type"]}


def main() -> None:
    SCHEMA_FOLDER.mkdir(exist_ok=True)
    for name, schema in json_schemas().items():
        text = json.dumps(schema, indent=1) + "\n"
        (SCHEMA_FOLDER / f"{name}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
