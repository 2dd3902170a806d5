"""Records of every type that a run file may have, with every field filled in."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from msgspec import inspect

from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.paired.records import LaunchRow
from mjbench.results import runs
from mjbench.results.runs import RunHeader

# Returns the text of a field by its key.
Text = Callable[[str], str]
# Values by key where not every one of the type will do: one, or those of successive items.
_VALUES: Mapping[str, Any] = {
    "schema": runs.SCHEMA,
    "status": "ok",
    "model": "m",
    "path": ("python_loop", "rollout"),
    "baseline": "python_loop",
    "candidate": "rollout",
    "variants": (0, 1),
    "variant": (0, 1),
    "engine_bytes": 0,
    "extension_bytes": 64,
    "began": "2026-11-01T12:00:00+00:00",
    "knob": "jacobian",
    "orders": "ABBA",
    # of a microsecond and of two, as HdrHistogram encodes them
    "histogram": "HISTFAAAACd4nJNpmSzMwMDAxgABzFCaEYjFPcpeMNh/gAic52c6y88EAG6uBfs=",
}

# Texts of which no other will do.
_EXACT = ("knob", "orders", "histogram", "schema")
# The records that runs of each command have.
KINDS: Mapping[str, Sequence[str]] = {
    "compare": ("model", "variant", "race"),
    "versions": ("verdict",),
    **{name: (name,) for name in RECORD_TYPES if name not in ("model", "variant", "race")},
}


def record(kind: type, text: Text = str, at: int = 0) -> dict[str, Any]:
    """Return a stored record, the `at`-th of its type, without any field left out."""
    return {"type": kind.record_type, **_filled(inspect.type_info(kind), "", text, at)}


def lines(command: str, text: Text = str) -> list[dict[str, Any]]:
    """Return the lines of a run file of a command: two records of each type that it has."""
    header = record(RunHeader, text) | {"command": command}
    kinds = [RECORD_TYPES[name] for name in KINDS[command]]
    return [header, *(record(kind, text, at) for kind in kinds for at in range(2))]


def _filled(kind: inspect.Type, key: str, text: Text, at: int) -> Any:
    usual = _VALUES.get(key)
    usual = usual[at % 2] if isinstance(usual, tuple) else usual
    match kind:
        case inspect.Metadata():
            return _filled(kind.type, key, text, at)
        case inspect.UnionType():
            some = next(t for t in kind.types if not isinstance(t, inspect.NoneType))
            return _filled(some, key, text, at)
        case inspect.DataclassType():
            filled = {f.encode_name: _filled(f.type, f.name, text, at) for f in kind.fields}
            if kind.cls is LaunchRow:  # four blocks for each order
                filled["ns"] = [[10, 11, 10, 11]] * 2
            return filled
        case inspect.EnumType():
            return usual or next(iter(kind.cls)).value
        case inspect.StrType():
            return "4.0.0" if kind.pattern else usual if key in _EXACT else text(usual or key)
        case inspect.FloatType() | inspect.IntType():
            return 1 if usual is None else usual
        case inspect.BoolType():
            return True
        case inspect.NoneType():
            return None
        case inspect.TupleType():
            return [_filled(item, key, text, i) for i, item in enumerate(kind.item_types)]
        case inspect.CollectionType():
            return [_filled(kind.item_type, key, text, i) for i in range(2)]
        case inspect.DictType():
            name = _filled(kind.key_type, key, text, at)
            return {name: _filled(kind.value_type, key, text, at)}
        case inspect.AnyType():
            return text(key)
    raise AssertionError(f"no value for {key}: {kind}")
