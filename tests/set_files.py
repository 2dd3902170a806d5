"""Run files of invented machines, for tests of what reads them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from mjbench.host.machine import Machine
from mjbench.results import runs
from mjbench.results.run_writer import RunFile
from mjbench.results.runs import Record, Run, RunHeader

MACHINE = Machine(
    cpu="AMD EPYC 7763 64-Core Processor",
    architecture="x86_64",
    system="Linux",
    cores=4,
    usable_cores=4,
    memory_bytes=2**34,
    load_1min=0.0,
    hypervisor=True,
    python="3.11.7",
    versions={"mujoco": "4.0.0"},
)


def labelled(label: str, **fields: Any) -> Machine:
    """Return a machine that the user gave a name."""
    return replace(MACHINE, **{"label": label, **fields})


def run_of(
    command: str,
    *records: Record,
    machine: Machine = MACHINE,
    arguments: dict[str, Any] | None = None,
    **header: Any,
) -> Run:
    """Return a run of a command."""
    return Run(RunHeader(runs.SCHEMA, command, machine, arguments or {}, **header), records)


def run_file(
    folder: Path, machine: Machine, *records: Record, command: str = "compare", **header: Any
) -> Path:
    """Return a run file of a machine."""
    words = (command, "a model")
    run = run_of(command, *records, machine=machine, command_line=words, **header)
    file = RunFile.create(folder, run.header)
    for record in run.records:
        file.append(record)
    file.close()
    return file.path
