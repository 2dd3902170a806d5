"""What a history of releases comes to: its changes, by machine, and the plots of each model."""

import html
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from mjbench.releases.release_ratios import StepRatioRecord
from mjbench.releases.speed_history import SpeedSeries
from mjbench.report import charts, formats, history_plots, speed_across, speed_page
from mjbench.report.content import Column, Conclusion, DataTable, Figure, Section
from mjbench.report.history_files import MachineHistory
from mjbench.report.speed_history import SpeedHistory, listed_changes
from mjbench.units import plain


def of_machines(histories: Sequence[MachineHistory]) -> Iterator[Section]:
    """Yield the history of each machine; of several, first on how many each change is listed."""
    if len(histories) == 1:
        yield from sections(histories[0].history)
        return
    yield _across(histories)
    for each in histories:
        for section in sections(each.history):
            # what is listed on how many machines stands at the head
            yield replace(section, heading=f"{each.name}: {section.heading}", conclusions=())


def _across(histories: Sequence[MachineHistory]) -> Section:
    """Return on how many machines each change is listed."""
    changes = speed_across.changes(histories)
    columns = (
        Column("releases"),
        Column("what"),
        Column("listed"),
        Column("machine"),
        Column("change", _percent),
        Column("standard error", _percent),
    )
    rows = [
        (
            change.releases,
            _plain(change.title),
            change.count,
            machine.machine,
            machine.listed.point.change if machine.listed else None,
            machine.listed.point.deviation if machine.listed else None,
        )
        for change in changes
        for machine in change.machines
    ]
    return Section(
        heading="What changed between releases, by machine",
        conclusions=[Conclusion(speed_across.conclusion(histories, changes))],
        tables=[DataTable("Change points by machine", columns, rows)],
        notes=[
            "Each machine has a history of its own. A machine without a change measured both"
            " releases, and its history lists none."
        ],
    )


def sections(history: SpeedHistory) -> Iterator[Section]:
    """Yield the changes of all models, then the plots of each."""
    yield Section(
        heading="What changed between releases",
        conclusions=[Conclusion(_plain(line)) for line in speed_page.conclusion(history)],
        tables=[_changes(history)],
        notes=[_plain(line) for line in speed_page.provenance(history)],
    )
    for series in history.models:
        yield Section(
            heading=f"{series.name}, release by release",
            figures=[_figure(history, series)],
        )


def _percent(share: float) -> str:
    return f"{plain(100 * share, 3)} %"


def _plain(line: str) -> str:
    """Return a line of Markdown without links, code marks and escapes."""
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", line).replace("`", "")
    return html.unescape(re.sub(r"\\(\W|_)", r"\1", text))


def _changes(history: SpeedHistory) -> DataTable:
    columns = (
        Column("releases"),
        Column("what"),
        Column("change", _percent),
        Column("standard error", _percent),
        Column("cause"),
    )
    rows = []
    for listed in listed_changes(history, [*history.models, *history.operations]):
        before, after = listed.before, listed.after
        rows.append(
            (
                f"{before.release} → {after.release}",
                listed.series.name,
                listed.point.change,
                listed.point.deviation,
                listed.cause.value,
            )
        )
    return DataTable("Change points", columns, rows)


def _figure(history: SpeedHistory, series: SpeedSeries) -> Figure:
    columns = (
        Column("release"),
        Column("ratio", formats.digits(4)),
        Column("standard error", formats.digits(2)),
        Column("contacts", formats.digits(4)),
        Column("drift of one step", formats.digits(2)),
    )
    rows = []
    for each in series.measured:
        work = each.record.work if isinstance(each.record, StepRatioRecord) else None
        rows.append(
            (
                each.release,
                each.ratio.ratio,
                each.ratio.deviation,
                work.contacts if work else None,
                each.record.drift,
            )
        )
    specification = {**history_plots.specification(history, series), **charts.page_colours()}
    first, last = rows[0], rows[-1]
    return Figure(
        title=f"{series.name}: time, instructions, work and drift",
        alternative=f"A step took {first[1]:.2f} times as long in {first[0]} as in the reference,"
        f" and {last[1]:.2f} times as long in {last[0]}. Diamonds are change points.",
        specification=specification,
        data=DataTable(series.name, columns, rows),
    )
