"""Continue a run that ended early: may its records stand beside those still to be measured?"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mjbench.errors import InputError
from mjbench.instrument.runs import RunHeader, as_stored


def check_continues(path: Path, stored: RunHeader, now: RunHeader) -> None:
    """Refuse to continue a run with another command, other arguments, files, or on another machine.

    Args:
      path: of the run file.
      stored: its header.
      now: the header that a new run would have.

    Raises:
      InputError: they differ; the message names the first difference.
    """
    before, after = _identity(stored), _identity(now)
    for key in {**before, **after}:
        if before.get(key) != after.get(key):
            raise InputError(
                f"cannot continue {path}: it was started with {key} {_text(before.get(key))},"
                f" and this command has {_text(after.get(key))}"
            )


def _identity(header: RunHeader) -> dict[str, Any]:
    """Return what must be the same for records to stand side by side, by a name for people."""
    machine = header.machine
    return {
        "the command": header.command,
        **_prefixed("", as_stored(header.arguments)),
        **_prefixed("the file ", header.files),
        "the processor": machine.cpu,
        "usable cores": machine.usable_cores,
        "Python": machine.python,
        **_prefixed("", machine.versions),
        **_prefixed("", machine.flags),
    }


def _prefixed(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    return {f"{prefix}{key}": value for key, value in values.items()}


def _text(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 80 else text[:79] + "…"
