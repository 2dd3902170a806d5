"""Tallies that are committed as JSON in results/: how they are read and written."""

import json
from pathlib import Path
from typing import Any, TypeVar

from mjbench.errors import InputError, one_line, writing
from mjbench.host import files

_Tally = TypeVar("_Tally")


def write(file: Path, tally: Any) -> None:
    """Write a tally; values that are not finite become null."""
    from mjbench.results.runs import to_json

    replace(file, json.dumps(to_json(tally), indent=1, ensure_ascii=False) + "\n")


def replace(file: Path, content: str) -> None:
    """Write a file so that a reader sees the earlier one or the whole new one."""
    with writing(file), files.replacing(file) as partial:
        partial.write_text(content, encoding="utf-8")


def load(file: Path, kind: type[_Tally], content: str) -> _Tally:
    """Return the tally that a file holds.

    Args:
      content: what the tally is of, for the message.

    Raises:
      InputError: the file cannot be read, or is not such a tally.
    """
    import msgspec  # late: asv imports this module where it is missing

    try:
        return msgspec.json.decode(file.read_bytes(), type=kind)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not a tally of {content}: {one_line(error)}") from error


def continued(file: Path, empty: _Tally, content: str) -> _Tally:
    """Return the tally that a file holds, to be continued here; `empty` where there is none.

    Args:
      empty: has `mujoco`, `cpu` and `cores` of this machine.

    Raises:
      InputError: see `load`; or the tally is of another release or machine.
    """
    if not file.exists():
        return empty
    stored = load(file, type(empty), content)
    for name in ("mujoco", "cpu", "cores"):
        there, here = getattr(stored, name), getattr(empty, name)
        if there != here:
            raise InputError(f"{file} is of {name} {there}, not {here}: remove it to begin anew")
    return stored
