"""`mjbench show --against`: two run files, or two run sets, of `compare`."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.cli.context import RunContext
from mjbench.cli.fail_on import FailOn
from mjbench.cli.group import report_line
from mjbench.errors import InputError
from mjbench.status import exit_code

if TYPE_CHECKING:
    from mjbench.store.run_set import RunSet


def show(old: Path, new: Path, across: bool, fail_on: FailOn, json_file: str | None) -> None:
    from mjbench.report.documents import DiffDocument
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.report.run_differences import differences, differences_section
    from mjbench.store import run_set

    with RunContext(json_file, [old, new]) as run:
        stored = [run_set.read(path, RECORD_TYPES) for path in (old, new)]
        rows = differences(stored[0], stored[1], across)
        if line := _left_out(stored):
            report_line(line)
        if rows:
            run.show([differences_section(rows)])
        if not any(row.path for row in rows):
            raise InputError(f"{old} and {new} have no timed row of `compare` in common")
        run.write(DiffDocument(results=rows))
    run.exit_with(exit_code(row.status for row in rows) or fail_on.of_differences(rows))


def _left_out(stored: "Sequence[RunSet]") -> str:
    """Return which runs of sets are not compared, in a line; empty where all are."""
    from mjbench.comparison.records import ModelRecord

    commands = Counter(
        each.header.command
        for one in stored
        if not one.is_run_file
        for each in one.runs
        if not each.of_type(ModelRecord)
    )
    if not commands:
        return ""
    counts = ", ".join(f"{count} of {command}" for command, count in commands.items())
    return f"left out: runs of other commands than compare ({counts})"
