"""What `--html`, `--markdown`, `--csv` and `--json` write of results."""

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.commands.show import kinds, machine_comparison, reports, rows
from mjbench.commands.show.documents import MachinesDocument
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.show.rows import Cell
from mjbench.errors import InputError
from mjbench.formats import csv_text
from mjbench.results import json_form
from mjbench.results.content import Report, Section


@dataclass(frozen=True)
class Forms:
    """What results come to in each form, which is made when it is written.

    Attributes:
      document: for JSON.
      table: for CSV.
    """

    report: Callable[[], Report]
    document: Callable[[], object]
    table: Callable[[], Sequence[Mapping[str, Cell]]]

    def html(self) -> str:
        from mjbench.results import html

        return html.render(self.report())

    def markdown(self) -> str:
        from mjbench.results import markdown

        return "\n".join(markdown.render(self.report())) + "\n"

    def csv(self) -> str:
        table = self.table()
        return csv_text([list(table[0]) if table else [], *(row.values() for row in table)])

    def json(self) -> str:
        return json_form.text(self.document())


def of_runs(named_runs: Sequence[NamedRun]) -> Forms:
    """Return the forms of one run, or of several together."""
    stored = [named.run for named in named_runs]

    def document() -> object:
        if len(stored) == 1:
            return kinds.kind_of(stored[0]).document(stored[0])
        return MachinesDocument.of(stored, machine_comparison.of_runs(stored))

    def table() -> Sequence[Mapping[str, Cell]]:
        if len(stored) > 1:
            raise InputError("--csv takes one RUN")
        return rows.of_run(stored[0])

    return Forms(lambda: reports.build(named_runs), document, table)


def of_sections(
    words: Sequence[str], sections: Sequence[Section], document: object, results: Iterable[object]
) -> Forms:
    """Return the forms of what has no run file.

    Args:
      words: of the command line, after `mjbench`.
      results: each is a row.
    """

    def report() -> Report:
        command = shlex.join(["mjbench", *words])
        conclusions = [conclusion for each in sections for conclusion in each.conclusions]
        shown = [
            replace(each, conclusions=(), command=command, is_open=True)
            for each in sections
            if each.facts or each.tables
        ]
        return Report(command, conclusions, shown)

    return Forms(report, lambda: document, lambda: rows.table_of(results))
