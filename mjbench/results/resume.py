"""What must be the same for a run to be continued: command, files, machine, and versions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, one_line
from mjbench.host.machine import Machine
from mjbench.results.runs import InputFile, RunHeader, as_stored


def check_continues(path: Path, stored: RunHeader, now: RunHeader) -> None:
    """Refuse to continue a run by another command, with other files, or on another machine."""
    for name, contents in _contents(now.files).items():
        if _contents(stored.files).get(name) not in (None, contents):
            raise InputError(
                f"cannot continue {path}: {name} has changed since that run began; leave out"
                " --resume to begin a new one"
            )
    before, after = _identity(stored, now), _identity(now, stored)
    for key in {**before, **after}:
        if before.get(key) != after.get(key):
            old, new = _quoted(before.get(key)), _quoted(after.get(key))
            values = f"{key} {old}, and this command {new}" if old and new else f"other {key}"
            raise InputError(f"cannot continue {path}: that run has {values}")


def _identity(header: RunHeader, other: RunHeader) -> dict[str, Any]:
    """Return what must be the same for records to stand side by side."""
    machine = header.machine
    return {
        "the command": header.command,
        **_machine_name(machine, other.machine),
        **as_stored(header.arguments),
        "the files": [file.name for file in header.files],
        "the processor": machine.cpu,
        "usable cores": machine.usable_cores,
        "Python": machine.python,
        **machine.versions,
        **machine.flags,
    }


def _machine_name(machine: Machine, other: Machine) -> dict[str, str]:
    """Return what tells a machine from another of its kind: its label, else its host."""
    if machine.label and other.label:
        return {"the machine's label": machine.label}
    if machine.host and other.host:
        return {"the machine's host": machine.host}
    return {}


def _contents(files: Sequence[InputFile]) -> dict[str, str]:
    """Return the hash of each file, by its name; those of one name lie in different folders."""
    names = [file.name for file in files]
    return {
        name: " ".join(file.sha256 for file in files if file.name == name)
        for name in dict.fromkeys(names)
    }


def _quoted(value: Any) -> str:
    """Return a value for people; an empty text where it has parts that they do not read."""
    values = value if isinstance(value, list) else [] if value is None else [value]
    if any(isinstance(each, list | dict) for each in values):
        return ""
    return one_line(", ".join(map(str, values)) or "nothing", 80)
