"""A plan file: TOML, in which every value knows its line, for messages."""

import contextlib
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, one_line, printable, shown, suggestion

# The most that a plan file can have, in bytes: a device or a wrong file would take all memory.
_MAX_BYTES = 1 << 20
_TABLE = re.compile(r"^\s*\[\s*([\w-]+)\s*\]")
_KEY = re.compile(r"^\s*[\"']?([\w-]+)[\"']?\s*=")


class PlanFile:
    """A file that was read; it refuses what is wrong with the place where it stands.

    Attributes:
      values: by table, and within a table by key; the table before the first heading is empty.
    """

    def __init__(self, path: Path):
        self.path = path
        try:
            if path.is_dir():
                raise InputError(f"{path} is a folder; name a plan file in it")
            with path.open("rb") as file:
                content = file.read(_MAX_BYTES + 1)
            if len(content) > _MAX_BYTES:
                raise InputError(f"{path} is too long for a plan")
            text = content.decode("utf-8-sig")
            values = tomllib.loads(text)
        except OSError as error:
            raise InputError(f"cannot read {shown(str(path))}: {error.strerror}") from error
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: not TOML: {one_line(error)}") from error
        self._lines = text.splitlines()
        tables = {name: value for name, value in values.items() if isinstance(value, dict)}
        top = {name: value for name, value in values.items() if name not in tables}
        self.values: Mapping[str, Mapping[str, Any]] = {"": top, **tables}

    def get(self, table: str, key: str, default: Any = None) -> Any:
        return self.values.get(table, {}).get(key, default)

    def texts(self, key: str, default: Sequence[str] = ()) -> list[str]:
        """Return a list of different texts before the first table; one text is a list of it."""
        values = self.get("", key)
        if values is None:
            return list(default)
        values = [values] if isinstance(values, str) else values
        with self.at("", key):
            if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
                raise InputError(f'give a list of texts, such as {key} = ["…"]')
            if not values:
                raise InputError("the list is empty")
        for number, value in enumerate(values):
            if value in values[:number]:
                raise self.error(f"{shown(value)} is given twice", "", key, value)
        return values

    @contextlib.contextmanager
    def at(self, table: str, key: str = "", item: str = "") -> Iterator[None]:
        """Turn an InputError that the block raises into that of a place (see `error`)."""
        try:
            yield
        except InputError as error:
            raise self.error(str(error), table, key, item) from None

    def error(self, text: str, table: str, key: str = "", item: str = "") -> InputError:
        """Return the error that something is wrong at a place.

        Args:
          table: empty before the first one.
          key: empty for the table itself.
        """
        number = self._line(table, key, item)
        where = f", line {number}" if number else ""
        name = ".".join(filter(None, (table, key)))
        return InputError(f"{self.path}{where}: {printable(name)}: {text}")

    def check_keys(self, known: Mapping[str, Iterable[str]]) -> None:
        """Refuse tables and keys that a plan cannot have, which has those in `known` by table."""
        for table, values in self.values.items():
            if table not in known:
                hint = suggestion(table, filter(None, known))
                tables = ", ".join(f"[{name}]" for name in known if name)
                raise self.error(f"no such table{hint}; there are {tables}", table)
            keys = list(known[table])
            for key in values:
                if key not in keys:
                    raise self.error(_unknown(key, table, known), table, key)

    def _line(self, table: str, key: str, item: str) -> int | None:
        current, begin = "", None
        for number, line in enumerate(self._lines, 1):
            if heading := _TABLE.match(line):
                current = heading[1]
                if current == table and not key:
                    return number
            match = _KEY.match(line)
            if begin is None and current == table and match and match[1] == key:
                begin = number
            elif begin is not None and (match or heading):
                break  # the value has ended
            if begin is not None and (not item or item in line):
                return number
        return begin


def _unknown(key: str, table: str, known: Mapping[str, Iterable[str]]) -> str:
    hint = suggestion(key, known[table])
    elsewhere = [name for name, keys in known.items() if key in keys]
    if elsewhere and not hint:
        places = ["before the first table" if not name else f"in [{name}]" for name in elsewhere]
        return f"no such key here; it belongs {' or '.join(places)}"
    return f"no such key{hint}; there are {', '.join(known[table]) or 'none'}"
