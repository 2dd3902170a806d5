"""On how many machines a history lists each change between releases.

Each machine has a history of its own; nothing is averaged over machines.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.measuring.ratio import LogEstimate
from mjbench.releases.speed_history import SpeedSeries, order
from mjbench.report import formats, history
from mjbench.report.content import Column, Conclusion, DataTable, Section
from mjbench.report.machines_side_by_side import by_machine
from mjbench.report.speed_history import Listed, SpeedHistory, listed_changes

_NOT_LISTED = "not listed"


@dataclass(frozen=True)
class ChangeAcross:
    """A change of speed that came with a release, on all machines that measured it.

    Attributes:
      title: the model or operation.
      release: that the change came with.
      by_machine: of those that measured the model or operation in this release and in an earlier
        one; None where the machine's history does not list it.
    """

    title: str
    release: str
    by_machine: Mapping[str, Listed | None]

    @property
    def listed(self) -> list[Listed]:
        """The change on each machine whose history lists it."""
        return [listed for listed in self.by_machine.values() if listed is not None]

    @property
    def name(self) -> str:
        before = " or ".join(dict.fromkeys(each.before.release for each in self.listed))
        slower = sum(each.point.change > 0 for each in self.listed)
        counts = {"slower": slower, "faster": len(self.listed) - slower}
        parts = [f"{outcome} on {number}" for outcome, number in counts.items() if number]
        total = len(self.by_machine)
        return f"{before} → {self.release}, {self.title}: {', '.join(parts)} of {total}"

    @property
    def cells(self) -> dict[str, str]:
        return {
            machine: _NOT_LISTED
            if listed is None
            else formats.change_with_error(LogEstimate(listed.point.change, listed.point.deviation))
            for machine, listed in self.by_machine.items()
        }


def changes(histories: Sequence[SpeedHistory]) -> list[ChangeAcross]:
    """Return the changes that any machine's history lists: by release, steps before operations."""
    listed = {
        (is_operation, change.series.name, change.after.release, each.name): change
        for each in histories
        for is_operation, series in _kinds(each)
        for change in listed_changes(each, series)
    }
    keys = dict.fromkeys(key[:3] for key in listed)
    across = []
    for is_operation, name, release in sorted(keys, key=lambda k: (order(k[2]), k[0], k[1])):
        by_machine = {
            each.name: listed.get((is_operation, name, release, each.name))
            for each in histories
            for series in dict(_kinds(each))[is_operation]
            if series.name == name and release in [m.release for m in series.measured[1:]]
        }
        title = next(change.title for change in by_machine.values() if change is not None)
        across.append(ChangeAcross(title, release, by_machine))
    return across


def _kinds(each: SpeedHistory) -> Iterator[tuple[bool, Sequence[SpeedSeries]]]:
    yield False, each.models
    yield True, each.operations


def section(histories: Sequence[SpeedHistory]) -> Section:
    all_changes = changes(histories)
    cells = {change.name: change.cells for change in all_changes}
    return Section(
        "What changed between releases, by machine",
        conclusions=[Conclusion(conclusion(histories, all_changes))],
        facts=[
            "Each machine has a history of its own, with its own rate of wrong changes. Nothing is"
            " averaged over machines. mjbench history --machine NAME writes the page of one."
        ],
        tables=[by_machine("Change points by machine", "change", cells), _machines(histories)],
        notes=[
            "Changes have their standard errors. A machine without a cell did not measure both"
            f" releases; “{_NOT_LISTED}” means that it measured both, and its history lists no"
            " change."
        ],
        command="mjbench history",
    )


def sections(histories: Sequence[SpeedHistory]) -> Iterator[Section]:
    """Yield the history of each machine; of several, first on how many each change is listed."""
    if len(histories) == 1:
        yield from history.sections(histories[0])
        return
    yield section(histories)
    for each in histories:
        for own in history.sections(each):
            # what is listed on how many machines stands at the head
            yield replace(own, heading=f"{each.name}: {own.heading}", conclusions=())


def conclusion(histories: Sequence[SpeedHistory], listed: Sequence[ChangeAcross]) -> str:
    count = len(histories)
    if not listed:
        return f"No history of the {count} machines lists a change."
    kinds = Counter(
        "all machines that measured them"
        if len(change.listed) == len(change.by_machine)
        else "one machine alone"
        if len(change.listed) == 1
        else "several machines"
        for change in listed
    )
    parts = [f"{number} on {kind}" for kind, number in kinds.most_common()]
    noun = "change is" if len(listed) == 1 else "changes are"
    return f"{len(listed)} {noun} listed on {count} machines: {', '.join(parts)}."


def _machines(histories: Sequence[SpeedHistory]) -> DataTable:
    return DataTable.of(
        "Machines of these histories",
        histories,
        (Column("machine"), lambda each: each.name),
        (Column("processor"), lambda each: m.cpu if (m := each.machine) else None),
        (
            Column("cores", formats.count),
            lambda each: m.usable_cores if (m := each.machine) else None,
        ),
        (Column("releases"), lambda each: _releases(each.releases())),
        (Column("models", formats.count), lambda each: len(each.models)),
        (Column("operations", formats.count), lambda each: len(each.operations)),
    )


def _releases(releases: Sequence[str]) -> str:
    return f"{len(releases)}, {releases[0]} to {releases[-1]}"
