"""What a measurement in a program returns: a value that prints what the command prints."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import one_line
from mjbench.host.machine import Machine
from mjbench.pages import fragment, reports, terminal
from mjbench.pages.reports import NamedRun
from mjbench.report import kinds, rows
from mjbench.report.content import Report
from mjbench.report.rows import Cell
from mjbench.store.json_form import json_form
from mjbench.store.run_file import RunFile
from mjbench.store.runs import Run

# The longest conclusion in the one line of `repr`.
_REPR_CHARACTERS = 200


@dataclass(frozen=True, repr=False, eq=False)
class Measured:
    """Records of a measurement; all else is derived from them, as the commands do.

    `print` shows what the command prints; a notebook shows conclusions and tables.

    Attributes:
      run: what a run file would hold: the machine, and the records with all raw samples that the
        command would store.
      notes: what made timings unreliable, a sentence each; usually none.
    """

    run: Run
    notes: tuple[str, ...] = ()

    @property
    def machine(self) -> Machine:
        """What it was measured on."""
        return self.run.header.machine

    def save(self, folder: str | Path = "results/runs") -> Path:
        """Write a run file, which `mjbench show`, `report` and `diff` read; return its path.

        Args:
          folder: for the file, which is named by time and command.

        Raises:
          MachineError: it cannot be written.
        """
        file = RunFile.create(Path(folder), self.run.header)
        try:
            for record in self.run.records:
                file.append(record)
        finally:
            file.close()
        return file.path

    def rows(self) -> list[dict[str, Cell]]:
        """Return the results as flat dictionaries, for `pandas.DataFrame`; see `mjbench.load`."""
        return rows.of_run(self.run)

    def to_dict(self) -> Any:
        """Return the JSON document of the command, as JSON-ready values."""
        return json_form(kinds.kind_of(self.run).document(self.run))

    def report(self) -> Report:
        """Return the content of a report: conclusions, tables, and the data of charts."""
        file = Path(f"{self.run.header.command}.jsonl")
        return reports.build([NamedRun(file, self.run)])

    def __str__(self) -> str:
        sections = kinds.kind_of(self.run).sections(self.run)
        return "\n".join([terminal.text_of(sections), *self.notes])

    def __repr__(self) -> str:
        conclusions = [conclusion.text for conclusion in self.report().conclusions[:1]]
        text = one_line("; ".join(conclusions), _REPR_CHARACTERS)
        return f"<mjbench {type(self).__name__}: {text}>"

    def _repr_html_(self) -> str:
        return fragment.render(self.report(), self.notes)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # IPython in a terminal
        printer.text("…" if cycle else str(self))
