"""Which rules `mjbench lint` checks in a file, by the command line and by pyproject.toml.

The pyproject.toml is that of the file's folder, or of the nearest folder above that has one. On the
command line, `--select` and `--ignore` replace `select` and `ignore` of its `[tool.mjbench.lint]`;
`per-file-ignores` always counts.
"""

import fnmatch
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mjbench.commands.lint.rules import RULES
from mjbench.errors import InputError, one_line

ALL_CODES = tuple(rule.code for rule in RULES)
_TABLE = "[tool.mjbench.lint]"
_KEYS = ("select", "ignore", "per-file-ignores")


@dataclass(frozen=True)
class LintSettings:
    """A table `[tool.mjbench.lint]`; codes are written in full, or as they begin.

    Attributes:
      select: codes to check; none for all.
      per_file_ignores: codes to leave out by pattern, of names or of paths below `folder`.
    """

    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    per_file_ignores: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    folder: Path = Path()

    def ignored_in(self, file: Path) -> list[str]:
        path = file.relative_to(self.folder).as_posix() if self.per_file_ignores else ""
        return [
            code
            for pattern, codes in self.per_file_ignores.items()
            if fnmatch.fnmatch(path, pattern) or fnmatch.fnmatch(file.name, pattern)
            for code in codes
        ]


@dataclass(frozen=True)
class RuleChoice:
    """The rules to check, file by file.

    Attributes:
      select: codes of the command line, or how they begin; none to do as pyproject.toml says.
    """

    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    _by_file: dict[Path | None, LintSettings] = field(
        default_factory=dict, init=False, compare=False
    )

    def codes_for(self, file: str) -> list[str]:
        """Return the codes of the rules to check in a file; InputError for a wrong setting."""
        path = Path(file).parent.resolve() / Path(file).name
        settings = self._settings_of(path.parent)
        ignore = [*(self.ignore or settings.ignore), *settings.ignored_in(path)]
        select = self.select or settings.select
        return sorted((_matching(select) if select else {*ALL_CODES}) - _matching(ignore))

    def _settings_of(self, folder: Path) -> LintSettings:
        files = (each / "pyproject.toml" for each in (folder, *folder.parents))
        file = next(filter(Path.is_file, files), None)
        if file not in self._by_file:
            self._by_file[file] = read_settings(file) if file is not None else LintSettings()
        return self._by_file[file]


def _matching(beginnings: Sequence[str]) -> set[str]:
    for beginning in beginnings:
        if not beginning or not any(code.startswith(beginning.upper()) for code in ALL_CODES):
            raise InputError(f"no rule {beginning!r}; there are {', '.join(ALL_CODES)}")
    wanted = tuple(beginning.upper() for beginning in beginnings)
    return {code for code in ALL_CODES if code.startswith(wanted)}


def read_settings(file: Path) -> LintSettings:
    """Return the settings of a pyproject.toml, or the defaults; InputError where they are wrong."""
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: {one_line(error)}") from error
    table: Any = document
    for key in ("tool", "mjbench", "lint"):
        table = table.get(key, {}) if isinstance(table, dict) else None
    place = f"{file}: {_TABLE}"
    if not isinstance(table, dict):
        raise InputError(f"{place}: not a table")
    if unknown := sorted(set(table) - set(_KEYS)):
        raise InputError(f"{place}: no key {unknown[0]!r}; there are {', '.join(_KEYS)}")
    per_file = table.get("per-file-ignores", {})
    if not isinstance(per_file, dict):
        raise InputError(f"{place}: per-file-ignores is not a table of lists of codes")
    return LintSettings(
        select=_codes_of(table.get("select", []), f"{place}: select"),
        ignore=_codes_of(table.get("ignore", []), f"{place}: ignore"),
        per_file_ignores={
            pattern: _codes_of(each, f"{place}: per-file-ignores of {pattern!r}")
            for pattern, each in per_file.items()
        },
        folder=file.parent,
    )


def _codes_of(values: Any, place: str) -> tuple[str, ...]:
    if not (isinstance(values, list) and all(isinstance(value, str) for value in values)):
        raise InputError(f'{place} is not a list of codes, such as ["MJB001"]')
    try:
        _matching(values)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error
    return tuple(values)
