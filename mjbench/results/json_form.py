"""The JSON form of results: what `--json` and tables have of them.

A result is one frozen dataclass: its fields are the facts and raw samples that a run file stores,
its properties the figures that follow from them. `in_json` says which of both its JSON form has;
that of a dataclass without it has all its fields.
"""

import json
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar

from mjbench.host.machine import Machine
from mjbench.results import runs

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True)
class ResultsDocument:
    """The document of a command whose results do not depend on one machine."""

    schema: int = runs.SCHEMA
    results: Sequence[object]


@dataclass(frozen=True, kw_only=True)
class MachineResultsDocument:
    """The document of a command that has only results, of one machine."""

    schema: int = runs.SCHEMA
    machine: Machine
    results: Sequence[object]


def in_json(
    *keys: str, also: Sequence[str] = (), **attributes: str
) -> Callable[[type[_T]], type[_T]]:
    """Declare what the JSON form of a dataclass has.

    Args:
      keys: in their order; without any, all fields, and `also` these properties.
      attributes: field or property behind a key of another name, such as `model.nbatch`.
    """

    def declare(kind: Any) -> Any:
        names = keys or [*(each.name for each in fields(kind)), *also]
        kind.json_attributes = {k: attributes.get(k, k) for k in names}
        return kind

    return declare


def _json_attributes(value: Any) -> Mapping[str, str]:
    declared: Mapping[str, str] | None = vars(type(value)).get("json_attributes")
    return {each.name: each.name for each in fields(value)} if declared is None else declared


def json_form(value: Any) -> Any:
    return runs.to_json(_form(value))


def text(document: Any) -> str:
    """Return a document as the text of a file."""
    return json.dumps(json_form(document), indent=1) + "\n"


def _form(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _form(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_form(item) for item in value]
    if not is_dataclass(value):
        return value
    return {
        key: _form(operator.attrgetter(name)(value))
        for key, name in _json_attributes(value).items()
    }
