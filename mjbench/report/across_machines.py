"""Results of several machines side by side, for `show` and reports.

Verdicts of paired comparisons are decided together (see `paired.across_machines`). Of runs of
`compare`, the tables have the advised path on each machine.
"""

import shlex
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console

from mjbench.instrument.machine_identity import MachineIdentity, identify
from mjbench.instrument.runs import Run
from mjbench.paired import across_machines
from mjbench.paired.across_machines import AcrossMachines, MachineComparison, MachineVerdict
from mjbench.report import advice_across, tables, verdicts
from mjbench.report.advice_across import AdviceAcross

# Up to so many machines have a column each on a page; with more, each cell of the table is a row.
MOST_COLUMNS = 8


@dataclass(frozen=True)
class SideBySide:
    """Results of several machines, side by side.

    Attributes:
      machines: of each run, in the order of the runs.
      verdicts: of paired comparisons.
      advice: of runs of `compare`.
    """

    machines: Sequence[MachineIdentity]
    verdicts: AcrossMachines
    advice: Sequence[AdviceAcross]

    @property
    def has_several(self) -> bool:
        """Whether the runs are of more than one machine."""
        return len(set(self.machines)) > 1


@dataclass(frozen=True)
class Matrix:
    """A table of results by machine.

    Attributes:
      subject: heading of the first column.
      machines: their names.
      rows: what was measured, and a cell for each machine that measured it.
    """

    title: str
    subject: str
    machines: Sequence[str]
    rows: Sequence[tuple[str, Mapping[str, str]]]

    def wide(self) -> tuple[list[str], list[list[str]]]:
        """Return headings and rows of a table with a column for each machine."""
        rows = [
            [name, *(cells.get(machine, "–") for machine in self.machines)]
            for name, cells in self.rows
        ]
        return [self.subject, *self.machines], rows

    def long(self) -> tuple[list[str], list[list[str]]]:
        """Return headings and rows of a table with a row for each cell."""
        rows = [
            [name, machine, cell] for name, cells in self.rows for machine, cell in cells.items()
        ]
        return [self.subject, "machine", "result"], rows


def side_by_side(runs: Sequence[Run]) -> SideBySide:
    """Return the results of runs, side by side."""
    machines = identify([run.header.machine for run in runs])
    names = [machine.name for machine in machines]
    decided = across_machines.decide(across_machines.rows_of(runs, names))
    return SideBySide(machines, decided, advice_across.advice_across(runs, names))


def matrices(results: SideBySide) -> Iterator[Matrix]:
    """Yield verdicts by machine, and advised paths by machine, where there are any."""
    if comparisons := named_comparisons(results):
        rows = [
            (name, {verdict.machine: verdict_cell(verdict) for verdict in comparison.machines})
            for name, comparison in comparisons
        ]
        yield _matrix("Verdicts by machine", "comparison", rows)
    if results.advice:
        rows = [
            (across.question.name, {m.machine: advice_across.cell(m) for m in across.machines})
            for across in results.advice
        ]
        yield _matrix("Advised paths by machine", "model", rows)


def _matrix(title: str, subject: str, rows: Sequence[tuple[str, Mapping[str, str]]]) -> Matrix:
    machines = list(dict.fromkeys(machine for _, cells in rows for machine in cells))
    return Matrix(title, subject, machines, rows)


def conclusions(results: SideBySide) -> Iterator[str]:
    """Yield a sentence on all verdicts, one on each comparison, and which paths are advised.

    Comparisons with a change come first.
    """
    if results.verdicts.comparisons:
        yield verdicts.describe_all_machines(results.verdicts)
    for name, comparison in named_comparisons(results):
        yield verdicts.describe_machines(comparison, name)
    yield from advice_across.describe(results.advice)
    yield from notes(results)


def named_comparisons(results: SideBySide) -> list[tuple[str, MachineComparison]]:
    """Return comparisons with their names, those with a change first."""
    comparisons = results.verdicts.comparisons
    named = zip(comparison_names(comparisons), comparisons, strict=True)
    return sorted(named, key=lambda pair: not pair[1].names_change)


def notes(results: SideBySide) -> Iterator[str]:
    """Yield which results are not compared because machines did different work, and what to do."""
    machines: dict[str, list[set[str]]] = defaultdict(list)
    for comparison in results.verdicts.comparisons:
        names = {verdict.machine for verdict in comparison.machines}
        machines[verdicts.comparison_name(comparison)].append(names)
    for across in results.advice:
        name = f"{across.question.model}, {across.question.loop} loop"
        machines[name].append({machine.machine for machine in across.machines})
    apart = [
        name
        for name, of_sizes in machines.items()
        if len(of_sizes) > 1 and sum(map(len, of_sizes)) == len(set.union(*of_sizes))
    ]
    if apart:
        yield (
            f"Not compared, because machines did different work: {'; '.join(apart)}. Give the same"
            " --nbatch, --nstep, --settle and files on all machines."
        )


def comparison_names(comparisons: Sequence[MachineComparison]) -> list[str]:
    """Return a name for each, with its size where others have the same name."""
    names = [verdicts.comparison_name(comparison) for comparison in comparisons]
    counts = Counter(names)
    return [
        f"{name}, {c.nbatch:,} × {c.nstep:,} steps"
        if counts[name] > 1 and c.nbatch is not None and c.nstep is not None
        else name
        for name, c in zip(names, comparisons, strict=True)
    ]


def print_side_by_side(out: Console, results: SideBySide) -> None:
    """Print what disturbed machines, their tables, and the conclusions."""
    for line in advice_across.cautions(results.advice):
        out.print(line, soft_wrap=True)
    for matrix in matrices(results):
        headings, rows = matrix.wide()
        widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
        if sum(widths) + len(widths) > out.width:
            headings, rows = matrix.long()
        table = tables.plain_table(headings)
        above = ""
        for name, *cells in rows:
            table.add_row("" if name == above else name, *cells)
            above = name
        out.print(table)
        out.print()
    for line in conclusions(results):
        out.print(line, soft_wrap=True)


def print_runs(out: Console, runs: Sequence[Run], names: Sequence[str]) -> None:
    """Print a list of runs.

    Args:
      runs: of any command.
      names: the name of each run's machine.
    """
    table = tables.plain_table(["machine", "command", "began", "records"], right=(3,))
    for run, name in zip(runs, names, strict=True):
        command = run.header.command_line or (run.header.command,)
        table.add_row(name, shlex.join(command), run.header.began, str(len(run.records)))
    out.print(table)


def verdict_cell(verdict: MachineVerdict) -> str:
    """Return a machine's verdict, with its ratio and interval, for a cell of a table."""
    detail = f" ({verdict.detail})" if verdict.detail else ""
    outcome = f"{verdict.outcome}{detail}"
    ratio = verdict.ratio
    if ratio is None:
        return outcome
    change = f"{100 * (ratio.estimate - 1):+.2f} %"
    if ratio.low is not None and ratio.high is not None:
        change += f" ({100 * (ratio.low - 1):+.2f} to {100 * (ratio.high - 1):+.2f})"
    return f"{change} {outcome}"
