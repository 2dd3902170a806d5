"""A list of run files."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench import formats
from mjbench.commands.show.reports import NamedRun
from mjbench.host.disturbance import Disturbance
from mjbench.results.content import Column, DataTable
from mjbench.results.machine_identity import identify
from mjbench.results.runs import Run

# What a record says that it is about.
_SUBJECTS = ("model", "environment", "program", "target")


@dataclass(frozen=True)
class StoredRun:
    """A run file in a list.

    Attributes:
      number: by which `mjbench show` takes it, -1 for the newest.
      subjects: models, environments, programs and functions.
      machine: its name among those of the list.
      records: how many things were measured.
    """

    number: int
    file: str
    began: str
    command: str
    subjects: Sequence[str]
    machine: str
    records: int
    is_disturbed: bool


def subjects(run: Run) -> list[str]:
    """Return what a run is about."""
    names = (getattr(record, subject, "") for record in run.records for subject in _SUBJECTS)
    return list(dict.fromkeys(filter(None, names)))


def stored_runs(numbers: Sequence[int], named_runs: Sequence[NamedRun]) -> list[StoredRun]:
    machines = identify([named.run.header.machine for named in named_runs])
    rows = []
    for number, named, machine in zip(numbers, named_runs, machines, strict=True):
        header, records = named.run.header, named.run.records
        disturbances = len(named.run.of_type(Disturbance))
        rows.append(
            StoredRun(
                number,
                str(named.file),
                header.began,
                header.typed_command,
                subjects(named.run),
                machine.name,
                len(records) - disturbances,
                bool(disturbances),
            )
        )
    return rows


def table(rows: Sequence[StoredRun]) -> DataTable:
    return DataTable.of(
        "Runs",
        rows,
        (Column("RUN", str), lambda row: row.number),
        (Column("began (UTC)"), lambda row: row.began[:16].replace("T", " ")),
        (Column("command", wraps=True), lambda row: row.command),
        (Column("of", wraps=True, leaves=2), lambda row: ", ".join(row.subjects)),
        (Column("machine", leaves=1), lambda row: row.machine),
        (Column("records", formats.count), lambda row: row.records),
        (Column("disturbed"), lambda row: "yes" if row.is_disturbed else ""),
    )
