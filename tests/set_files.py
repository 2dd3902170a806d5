"""Run files and run sets of invented machines, for tests of what reads them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mjbench.host.machine import Machine
from mjbench.report.kinds import RECORD_TYPES
from mjbench.store import runs
from mjbench.store.run_set import RunSection, RunSetFile
from mjbench.store.run_writer import RunFile
from mjbench.store.runs import Record, RunHeader

MACHINE = Machine(
    cpu="AMD EPYC 7763 64-Core Processor",
    architecture="x86_64",
    system="Linux",
    cores=4,
    usable_cores=4,
    cgroup_quota_cores=None,
    memory_bytes=2**34,
    load_1min=0.0,
    governor="",
    hypervisor=True,
    python="3.11.7",
    versions={"mujoco": "4.0.0"},
)


def labelled(label: str, **fields: Any) -> Machine:
    """Return a machine that the user gave a name."""
    return replace(MACHINE, **{"label": label, **fields})


def run_file(
    folder: Path,
    machine: Machine,
    *records: Record,
    command: str = "compare",
    arguments: dict[str, Any] | None = None,
    began: str = "",
) -> Path:
    """Return a run file of a machine."""
    header = RunHeader(
        runs.SCHEMA, command, machine, arguments or {}, (), (command, "a model"), began
    )
    file = RunFile.create(folder, header)
    for record in records:
        file.append(record)
    file.close()
    return file.path


def section_of(
    path: Path, record_types: Mapping[str, type] = RECORD_TYPES, cell: str = ""
) -> RunSection:
    """Return a run file as a section."""
    return RunSection(cell, runs.load(path, record_types), tuple(runs.read_lines(path)))


def set_of(path: Path, files: Sequence[Path]) -> Path:
    """Return a run set of run files."""
    file = RunSetFile.create(path)
    for one in files:
        file.append(section_of(one))
    file.close()
    return path
