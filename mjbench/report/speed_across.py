"""The page that `mjbench history` writes of several machines, in Markdown.

Each machine has a history of its own. The page says which changes are listed on how many of them;
nothing is averaged over machines.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.releases.speed_history import SpeedSeries, order
from mjbench.report import markdown
from mjbench.report.history_files import MachineHistory
from mjbench.report.speed_history import Listed, listed_changes, title

COMMAND = "mjbench history --machine NAME"
# Up to so many machines have a column each; with more, each cell of the table is a row.
_MOST_COLUMNS = 8


@dataclass(frozen=True)
class MachineChange:
    """What the history of one machine says of a change.

    Attributes:
      listed: the change; None where its history does not list it.
    """

    machine: str
    listed: Listed | None

    @property
    def cell(self) -> str:
        """The change with its standard error, for a table; `–` where it is not listed."""
        if self.listed is None:
            return "–"
        point = self.listed.point
        return markdown.change_with_error(math.exp(point.change), point.deviation)


@dataclass(frozen=True)
class ChangeAcross:
    """A change of speed that came with a release, on all machines that measured it.

    Attributes:
      title: the model or operation, in Markdown.
      is_operation: whether it is of an operation around the step.
      release: that the change came with.
      before: the release before it; of several machines, each that one of them compares with.
      machines: that measured the model or operation in this release and in an earlier one.
    """

    title: str
    is_operation: bool
    release: str
    before: Sequence[str]
    machines: Sequence[MachineChange]

    @property
    def listing(self) -> list[Listed]:
        """The change on each machine whose history lists it."""
        return [machine.listed for machine in self.machines if machine.listed is not None]

    @property
    def releases(self) -> str:
        """The releases around it."""
        return f"{' or '.join(self.before)} → {self.release}"

    @property
    def count(self) -> str:
        """On how many machines it is listed, such as `slower on 3 of 4`."""
        slower = sum(listed.point.change > 0 for listed in self.listing)
        counts = {"slower": slower, "faster": len(self.listing) - slower}
        parts = [f"{outcome} on {number}" for outcome, number in counts.items() if number]
        return f"{', '.join(parts)} of {len(self.machines)}"


def changes(histories: Sequence[MachineHistory]) -> list[ChangeAcross]:
    """Return the changes that any machine's history lists: by release, steps before operations."""
    keys: dict[tuple[str, bool, str], None] = {}
    listed: dict[tuple[str, str, bool, str], Listed] = {}
    for each in histories:
        for is_operation in (False, True):
            series = each.history.operations if is_operation else each.history.models
            for change in listed_changes(each.history, series):
                key = change.series.name, is_operation, change.after.release
                keys[key] = None
                listed[each.name, *key] = change
    ordered = sorted(keys, key=lambda key: (order(key[2]), key[1], key[0]))
    return [_change(histories, listed, *key) for key in ordered]


def _change(
    histories: Sequence[MachineHistory],
    listed: dict[tuple[str, str, bool, str], Listed],
    name: str,
    is_operation: bool,
    release: str,
) -> ChangeAcross:
    """Return a change on all machines.

    Args:
      listed: by machine, and by the other arguments.
    """
    machines = [
        MachineChange(each.name, listed.get((each.name, name, is_operation, release)))
        for each in histories
        if _measured(each, name, is_operation, release)
    ]
    listing = [machine.listed for machine in machines if machine.listed is not None]
    before = dict.fromkeys(each.before.release for each in listing)
    return ChangeAcross(
        title(listing[0].after.record), is_operation, release, list(before), machines
    )


def _measured(each: MachineHistory, name: str, is_operation: bool, release: str) -> bool:
    """Return whether a machine measured a series in a release and in an earlier one."""
    all_series = each.history.operations if is_operation else each.history.models
    series: SpeedSeries | None = next((s for s in all_series if s.name == name), None)
    return series is not None and release in [m.release for m in series.measured[1:]]


def lines(histories: Sequence[MachineHistory]) -> Iterator[str]:
    """Yield the lines of a page of several machines, in Markdown."""
    all_changes = changes(histories)
    yield conclusion(histories, all_changes)
    yield ""
    yield (
        "Each machine has a history of its own, with its own"
        " [rate of wrong changes](method/history-errors.md). Nothing is averaged over machines."
        f" `{COMMAND}` writes the page of one."
    )
    for heading, is_operation in (
        ("Changes of a step", False),
        ("Changes around the step", True),
    ):
        chosen = [change for change in all_changes if change.is_operation == is_operation]
        if chosen:
            yield f"\n## {heading}\n"
            yield (
                "With their standard errors. `–`: both releases were measured, and no change is"
                " listed.\n"
            )
            yield from _table(chosen, [each.name for each in histories])
    yield "\n## Machines\n"
    yield from _machines(histories)


def conclusion(histories: Sequence[MachineHistory], listed: Sequence[ChangeAcross]) -> str:
    """Return how many changes are listed, and on how many machines."""
    count = len(histories)
    if not listed:
        return f"No history of the {count} machines lists a change."
    kinds = Counter(
        "all machines that measured them"
        if len(change.listing) == len(change.machines)
        else "one machine alone"
        if len(change.listing) == 1
        else "several machines"
        for change in listed
    )
    parts = [f"{number} on {kind}" for kind, number in kinds.most_common()]
    noun = "change is" if len(listed) == 1 else "changes are"
    return f"{len(listed)} {noun} listed on {count} machines: {', '.join(parts)}."


def _table(listed: Sequence[ChangeAcross], names: Sequence[str]) -> Iterator[str]:
    """Yield a table of changes, with a column for each machine; of many machines, with a row."""
    if len(names) > _MOST_COLUMNS:
        headings = ["releases", "what", "listed", "machine", "time"]
        rows = [
            [change.releases, change.title, change.count, markdown.escaped(m.machine), m.cell]
            for change in listed
            for m in change.machines
        ]
        yield from markdown.table(headings, rows, right_aligned=("time",))
        return
    wide = [
        [change.releases, change.title, change.count, *_cells(change, names)] for change in listed
    ]
    columns = [markdown.escaped(name) for name in names]
    yield from markdown.table(["releases", "what", "listed", *columns], wide, columns)


def _cells(change: ChangeAcross, names: Sequence[str]) -> Iterator[str]:
    cells = {machine.machine: machine.cell for machine in change.machines}
    yield from (cells.get(name, "not measured") for name in names)


def _machines(histories: Sequence[MachineHistory]) -> Iterator[str]:
    """Yield a table of the machines, for `--machine`."""
    rows = []
    for each in histories:
        machine, releases = each.history.machine, each.history.releases()
        rows.append(
            [
                markdown.escaped(each.name),
                markdown.escaped(machine.cpu) if machine else "",
                str(machine.usable_cores) if machine else "",
                f"{len(releases)}, {releases[0]} to {releases[-1]}",
                str(len(each.history.models)),
                str(len(each.history.operations)),
            ]
        )
    headings = ["machine", "processor", "cores", "releases", "models", "operations"]
    yield from markdown.table(headings, rows, right_aligned=("cores", "models", "operations"))
