"""The JSON Schemas that are shipped, held against the types and against committed files."""

import functools
import json
from pathlib import Path

import jsonschema
import pytest
from commands import ROOT
from set_files import set_of

from mjbench.report import json_schemas


@functools.cache
def validator(name: str) -> jsonschema.Draft202012Validator:
    schema = json.loads((json_schemas.SCHEMA_FOLDER / f"{name}.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@functools.cache
def line_validator(record_type: str | None) -> jsonschema.Draft202012Validator:
    """Return the validator of one type of line; that of all lines for one that names no type."""
    schema = validator("run-file").schema
    for line in schema["anyOf"]:
        if line["properties"]["type"] == {"const": record_type}:
            return jsonschema.Draft202012Validator({**line, "$defs": schema["$defs"]})
    return validator("run-file")


def test_the_shipped_schemas_are_those_of_the_types() -> None:
    shipped = {
        file.stem: json.loads(file.read_text())
        for file in json_schemas.SCHEMA_FOLDER.glob("*.json")
    }
    generated = json.loads(json.dumps(json_schemas.json_schemas()))  # with lists for tuples
    assert shipped == generated, "python -m mjbench.report.json_schemas"


RUN_FILES = sorted((ROOT / "results/runs").glob("reference-*.jsonl"))


@pytest.mark.parametrize("file", RUN_FILES, ids=lambda file: file.stem)
def test_committed_run_files_fit_the_schema(file: Path) -> None:
    records = [json.loads(line) for line in file.read_text().splitlines()]
    assert len(records) > 1
    for record in records:
        line_validator(record.get("type")).validate(record)


def test_lines_of_a_set_fit_the_schemas(tmp_path: Path) -> None:
    own, of_run = validator("run-set"), validator("run-file")
    lines = set_of(tmp_path / "set.jsonl", RUN_FILES[:1]).read_text().splitlines()
    for line in lines[:2]:
        own.validate(json.loads(line))
    for line in lines[2:]:
        of_run.validate(json.loads(line))
        with pytest.raises(jsonschema.ValidationError):
            own.validate(json.loads(line))


def test_a_line_that_is_no_record_does_not_fit() -> None:
    with pytest.raises(jsonschema.ValidationError):
        validator("run-file").validate({"type": "trial", "model": 3})
