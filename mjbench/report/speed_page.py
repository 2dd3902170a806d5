"""The page that `mjbench history` writes, in Markdown; docs/history.md is one."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.instrument.machine import Machine
from mjbench.releases import speed_history
from mjbench.releases.change_points import (
    FALSE_DISCOVERY_RATE,
    MIN_CHANGE,
    SIMULATED_DEVIATION,
)
from mjbench.releases.no_change_pairs import NO_CHANGE_PAIRS, NoChangePair
from mjbench.releases.speed_history import SpeedSeries
from mjbench.report import history_plots
from mjbench.report.speed_history import SpeedHistory, listed_changes
from mjbench.report.speed_tables import (
    COUNT_THRESHOLD,
    DEVIATIONS,
    MIN_PLACEMENT,
    drifts,
    excursions,
    instructions,
    log_change,
    operation_changes,
    placement,
    step_changes,
    times,
    total_of,
    totals,
    work,
)
from mjbench.simulation import models

TITLE = "# What changed between releases"
# As many of the largest changes are named in the conclusion.
_LARGEST_CHANGES = 3


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes:
      heading: of the section.
      introduction: what its figures are; empty where the heading says it.
      body: lines in Markdown, a table or a sentence in its place.
      commands: that give its figures.
    """

    heading: str
    introduction: str
    body: Iterator[str]
    commands: Sequence[str]

    def lines(self) -> Iterator[str]:
        """Yield it in Markdown."""
        yield f"\n## {self.heading}\n"
        if self.introduction:
            yield self.introduction + "\n"
        yield from self.body
        yield f"\nFrom {' and '.join(f'`{command}`' for command in self.commands)}."


def lines(history: SpeedHistory, plots: str = "") -> Iterator[str]:
    """Yield the lines of a page, in Markdown.

    Args:
      history: one or more models.
      plots: folder of the plots of each model, as the page is to link it; empty for none.
    """
    yield from conclusion(history)
    yield ""
    yield from provenance(history)
    for section in _sections(history, plots):
        yield from section.lines()


def _sections(history: SpeedHistory, plots: str) -> Iterator[Section]:
    first = history.releases()[0]
    measure = f"mjbench history measure --since {first}"
    explain = f"mjbench history explain --since {first}"
    yield Section(
        "Change points of a step",
        "Changes of the time of `mj_step` from one release to the next, from"
        f" {_percent(MIN_CHANGE)} on, with their standard error. The cause is `work` where the work"
        " or the result of a step changed, too, whether or not that accounts for all of it; `code`"
        " where the same work takes another time, with placement averaged out; `undecided` where"
        " that is not known. The percentage after a function is the change of its instructions,"
        " relative to those of the step.",
        step_changes(history),
        [measure, explain],
    )
    if history.operations:
        yield Section(
            "Change points around the step",
            "The same for what programs do around it, on one thread. `rollout` and `Batch` step,"
            " so they change with `mj_step`, too.",
            operation_changes(history),
            [measure],
        )
    yield Section(
        "Single releases that are off",
        "Changes that the next release takes back.",
        excursions(history),
        [measure],
    )
    yield Section(
        "Drifts",
        "Slow changes, of which no single one is a change point.",
        drifts(history),
        [measure],
    )
    yield Section(
        "Changed by placement",
        f"Changes of a step that differ by at least {_percent(MIN_PLACEMENT)} where placement is"
        " averaged out: the difference comes from where the code lies in memory. Few launches are"
        " as shipped, so that only large differences are seen.",
        placement(history),
        [measure],
    )
    yield Section(
        "From the first release to the last",
        "",
        totals([*history.models, *history.operations]),
        [measure],
    )
    if plots:
        yield Section(
            "Plots",
            "From top to bottom: the time of a step relative to the reference, with two standard"
            " errors, change points marked, and the distance to the ratio as shipped shaded; its"
            " instructions; its work; and how far one step is from that of the reference.",
            _images(history, plots),
            [measure, explain],
        )
    yield Section(
        "Time of a step",
        "Microseconds of one `mj_step` from Python: the ratio to the reference, times the"
        " reference's own time, which is the median of all runs. ▲ and ▼ mark change points.",
        times(history, history.models),
        [measure],
    )
    if history.operations:
        yield Section(
            "Time of operations",
            "Microseconds of one, in the same way; of MjSpec, of one geom; of `rollout` and"
            " `Batch`, of one simulation.",
            times(history, history.operations),
            [measure],
        )
    yield Section(
        "Instructions of a step",
        "Thousands of instructions of one `mj_step`, counted by Callgrind. ▲ and ▼ mark changes"
        f" above {100 * COUNT_THRESHOLD:g} % from the release before. A count says what the code"
        " does, not how long it takes.",
        instructions(history),
        [explain],
    )
    yield Section(
        "Releases that compute something else",
        "Compared with the release before: the work of a step, and results.",
        work(history),
        [measure],
    )


def _images(history: SpeedHistory, plots: str) -> Iterator[str]:
    for series in history.models:
        yield f"![{series.name}]({plots}/{history_plots.file_name(series)})\n"


def conclusion(history: SpeedHistory) -> Iterator[str]:
    """Yield sentences: from the first release to the last, and the largest changes."""
    compared = [total_of(series) for series in history.models if len(series.measured) > 1]
    certain = [
        total.log_ratio
        for total in compared
        if abs(total.log_ratio) >= max(MIN_CHANGE, DEVIATIONS * total.deviation)
    ]
    slower = [log_ratio for log_ratio in certain if log_ratio > 0]
    faster = [log_ratio for log_ratio in certain if log_ratio < 0]
    yield (
        f"From the first release measured to the last, a step became slower for {len(slower)} of"
        f" {len(compared)} models{_range(slower)}, and faster for {len(faster)}{_range(faster)}."
    )
    listed = listed_changes(history, history.models)
    largest = sorted(listed, key=lambda c: -abs(c.point.change))[:_LARGEST_CHANGES]
    if largest:
        texts = [
            f"{log_change(c.point.change)} for `{c.series.name}` in {c.after.release}"
            for c in largest
        ]
        yield f"The largest changes from one release to the next are {', '.join(texts)}."


def provenance(history: SpeedHistory) -> Iterator[str]:
    """Yield sentences: what was measured, where, and how often what is listed is wrong."""
    releases = history.releases()
    measured = [
        each for series in (*history.models, *history.operations) for each in series.measured
    ]
    references = sorted({each.record.reference for each in measured})
    machine = f" on {_machine(history.machine)}" if history.machine else ""
    yield (
        f"{len(releases)} releases, {releases[0]} to {releases[-1]}, were timed against"
        f" {', '.join(references)}{machine}, in turns, with the placement of code averaged out."
        " Ratios hold for other machines as far as their processors are alike; times do not."
    )
    for problem in sorted({each.record.problem for each in measured if each.record.problem}):
        yield f"Placement was not averaged out everywhere: {problem}."
    noisy = sum(each.ratio.deviation > SIMULATED_DEVIATION for each in measured)
    yield (
        "In [simulated histories](method/history-errors.md) of 42 releases with two or three"
        f" changes, at most {100 * FALSE_DISCOVERY_RATE:g} % of the listed changes are wrong if the"
        f" standard errors of ratios are at most {100 * SIMULATED_DEVIATION:g} %; here {noisy} of"
        f" {len(measured)} are larger."
    )
    yield from _against_itself(history)
    yield from no_change_line(history)


def _against_itself(history: SpeedHistory) -> Iterator[str]:
    """Yield how far the reference is from itself, which bounds a bias of all ratios alike."""
    own = [
        each.ratio.log_ratio
        for series in (*history.models, *history.operations)
        for each in series.measured
        if each.release == each.record.reference
    ]
    if own:
        yield (
            f"The reference against itself, which should be 0 %, came out at"
            f" {_percent(min(own))} to {_percent(max(own))}: by as much all releases of a model or"
            " an operation may be off alike, so that changes between them are not affected."
        )


def no_change_line(history: SpeedHistory) -> Iterator[str]:
    """Yield what the page says of releases whose code is that of the one before; none without."""
    log_ratios: list[float] = []
    names: list[str] = []
    listed = 0
    shipped = models.shipped()
    for pair in NO_CHANGE_PAIRS:
        for series in history.models:
            index = _index(series, pair)
            if index is None or series.name not in shipped or not history.lists(pair.new):
                continue
            if pair.new not in names:
                names.append(pair.new)
            log_ratios.append(speed_history.change(*series.pair(index)).log_ratio)
            listed += any(p.index == index for p in series.changes.change_points)
    if log_ratios:
        deviation = math.sqrt(statistics.fmean(x * x for x in log_ratios))
        yield (
            "In some releases a step executes as many instructions as in the one before:"
            f" {', '.join(names)}. Their {len(log_ratios)} changes have a root mean square of"
            f" {100 * deviation:.2f} %, and {listed or 'none'} of them {_are(listed)} listed."
        )


def _are(count: int) -> str:
    return "is" if count <= 1 else "are"


def _index(series: SpeedSeries, pair: NoChangePair) -> int | None:
    """Return the index of the second release of a pair, if the first one is right before it."""
    releases = [each.release for each in series.measured]
    if pair.new not in releases:
        return None
    index = releases.index(pair.new)
    return index if index and releases[index - 1] == pair.old else None


def _machine(machine: Machine) -> str:
    kind = ", virtual" if machine.hypervisor else ""
    return f"{machine.cpu}{kind}, {machine.usable_cores} cores"


def _percent(log_ratio: float) -> str:
    return f"{100 * math.expm1(log_ratio):.2g} %"


def _range(log_ratios: Sequence[float]) -> str:
    """Return in brackets how large changes are, smallest to largest; empty without any."""
    if not log_ratios:
        return ""
    ordered = sorted(log_ratios, key=abs)
    if len(ordered) == 1:
        return f" ({log_change(ordered[0])})"
    return f" ({log_change(ordered[0])} to {log_change(ordered[-1])})"
