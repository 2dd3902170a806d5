"""The JSON form of results: what `--json` and tables have of them.

A result is one frozen dataclass: its fields are the facts and raw samples that a run file stores,
its properties the figures that follow from them. `in_json` says which of both its JSON form has;
that of a dataclass without it has all its fields.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass, make_dataclass
from functools import cache, cached_property, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from mjbench.store import runs

_T = TypeVar("_T")


def in_json(
    *keys: str, without: Sequence[str] = (), **attributes: str
) -> Callable[[type[_T]], type[_T]]:
    """Declare what the JSON form of a dataclass has.

    Args:
      keys: in their order; without any, all fields.
      attributes: field or property behind a key of another name.
    """

    def declare(kind: Any) -> Any:
        names = keys or [each.name for each in fields(kind)]
        kind.json_attributes = {k: attributes.get(k, k) for k in names if k not in without}
        return kind

    return declare


def _json_attributes(kind: Any) -> Mapping[str, str]:
    declared: Mapping[str, str] | None = vars(kind).get("json_attributes")
    return {each.name: each.name for each in fields(kind)} if declared is None else declared


def json_form(value: Any) -> Any:
    return runs.to_json(_form(value))


def _form(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _form(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_form(item) for item in value]
    if not is_dataclass(value):
        return value
    kind: Any = type(value)
    if json_type(kind) is kind:  # it has its fields, and so has all within
        return value
    return {key: _form(getattr(value, name)) for key, name in _json_attributes(kind).items()}


@cache
def json_type(kind: Any) -> Any:
    """Return the type of the JSON form of a dataclass, for reading documents.

    What a class declares by `in_json` is always there, so it has no defaults.
    """
    names, hints = _json_attributes(kind), get_type_hints(kind, include_extras=True)
    types = {key: _type(_hint(kind, hints, name)) for key, name in names.items()}
    if types == {each.name: hints[each.name] for each in fields(kind)}:
        return kind
    is_declared = "json_attributes" in vars(kind)
    defaults = {} if is_declared else {each.name: _default(each) for each in fields(kind)}
    form = make_dataclass(
        kind.__name__,
        [(key, kind_of_value, defaults.get(key, field())) for key, kind_of_value in types.items()],
        kw_only=True,
        frozen=True,
    )
    form.__doc__ = kind.__doc__
    return form


def _hint(kind: Any, hints: Mapping[str, Any], name: str) -> Any:
    if name in hints:
        return hints[name]
    figure = getattr(kind, name)
    getter = figure.func if isinstance(figure, cached_property) else figure.fget
    return get_type_hints(getter, include_extras=True)["return"]


def _default(own: Field[Any]) -> Any:
    if own.default_factory is not MISSING:
        return field(default_factory=own.default_factory)
    return field(default=own.default)


def _type(hint: Any) -> Any:
    if isinstance(hint, type) and is_dataclass(hint):
        return json_type(hint)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return Annotated[(_type(arguments[0]), *arguments[1:])]
    if origin in (Union, UnionType):
        return reduce(or_, map(_type, arguments))
    return origin[tuple(map(_type, arguments))] if arguments else hint
