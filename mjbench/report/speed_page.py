"""The page that `mjbench history` writes, in Markdown; docs/history.md is one."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.host.machine import Machine
from mjbench.releases import speed_history
from mjbench.releases.change_points import (
    FALSE_DISCOVERY_RATE,
    MIN_CHANGE,
    SIMULATED_DEVIATION,
)
from mjbench.releases.release import NO_CHANGE_PAIRS, NoChangePair
from mjbench.releases.speed_history import SpeedSeries
from mjbench.report import history_plots
from mjbench.report.markdown import code, escaped
from mjbench.report.speed_history import SpeedHistory, listed_changes
from mjbench.report.speed_tables import (
    COUNT_THRESHOLD,
    DEVIATIONS,
    MIN_PLACEMENT,
    drifts,
    excursions,
    failures,
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
from mjbench.units import count_of

TITLE = "# What changed between releases\n\nWritten by `mjbench history`; do not edit."
# As many of the largest changes are named in the conclusion.
_LARGEST_CHANGES = 3


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes:
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
        yield f"\nFrom {' and '.join(map(code, self.commands))}."


def lines(history: SpeedHistory, plots: str = "") -> Iterator[str]:
    """Yield the lines of a page, in Markdown.

    Args:
      history: one or more models.
      plots: folder of the plots of each model, as the page is to link it; empty for none.
    """
    yield from conclusion(history)
    yield ""
    yield from provenance(history)
    first = history.releases()[0]
    measure = f"mjbench history measure --since {first}"
    explain = f"mjbench history explain --since {first}"
    for section in _changes(history, measure, explain):
        yield from section.lines()
    if plots:
        yield from _plots(history, plots, measure, explain).lines()
    for section in _figures(history, measure, explain):
        yield from section.lines()


def _changes(history: SpeedHistory, measure: str, explain: str) -> Iterator[Section]:
    """Yield what changed; `measure` and `explain` are the commands that gave its figures."""
    yield Section(
        "Change points of a step",
        "Changes of the time of `mj_step` from one release to the next, from"
        f" {_percent(MIN_CHANGE)} on, with their standard error. The cause is `work` where the work"
        " or the result of a step changed, too, whether or not that accounts for all of it; `code`"
        " where the same work takes another time, with placement averaged out; `undecided` where"
        " that is not known. After a function: by how many percent of the step's instructions its"
        " own count changed.",
        step_changes(history),
        [measure, explain],
    )
    if history.operations:
        yield Section(
            "Change points around the step",
            "Changes of the time of operations around `mj_step`, on one thread; large ones as a"
            " factor, where ×2 is twice the time. `rollout` and `Batch` step, so they change with"
            " `mj_step`, too. After a function: by how many percent of the operation's instructions"
            " its own count changed; C's and Python's functions count, too.",
            operation_changes(history),
            [measure, explain],
        )
    yield Section(
        "Single releases that are off",
        "One release is off, and the next takes back more than half of it.",
        excursions(history),
        [measure],
    )
    yield Section(
        "Drifts",
        "Slow changes over four or more releases. Change points between them are listed above, and"
        " are not part of the figure.",
        drifts(history),
        [measure],
    )
    yield Section(
        "Changed by placement",
        f"Changes of a step that are at least {_percent(MIN_PLACEMENT)} larger or smaller as"
        f" shipped than with placement averaged out, and by more than {DEVIATIONS:g} standard"
        " errors. Few launches are as shipped, so only large differences are seen.",
        placement(history),
        [measure],
    )
    yield Section(
        "From the first release to the last",
        "",
        totals([*history.models, *history.operations]),
        [measure],
    )


def _plots(history: SpeedHistory, folder: str, measure: str, explain: str) -> Section:
    """Return the section of the plots in a folder."""
    return Section(
        "Plots",
        "From top to bottom: the time of a step relative to the reference, with two standard"
        " errors and change points; its instructions; its work; and how far one step ends from"
        " where the reference ends. Shaded: the ratio as shipped, where it certainly differs.",
        _images(history, folder),
        [measure, explain],
    )


def _figures(history: SpeedHistory, measure: str, explain: str) -> Iterator[Section]:
    """Yield what was measured, release by release; see `_changes` for the arguments."""
    yield Section(
        "Time of a step",
        "Microseconds of one `mj_step` from Python: the ratio to the reference, times the"
        " reference's own time, the median over all releases' measurements. ▲ and ▼ mark change"
        " points.",
        times(history, history.models),
        [measure],
    )
    if history.operations:
        yield Section(
            "Time of operations",
            "Microseconds of one load, copy, reset or ray, in the same way; for MjSpec per geom,"
            " compiling included; for `rollout` and `Batch` per simulation of five steps.",
            times(history, history.operations),
            [measure],
        )
    yield Section(
        "Instructions of a step",
        "Thousands of instructions of one `mj_step`, counted by Callgrind. ▲ and ▼ mark changes"
        f" above {100 * COUNT_THRESHOLD:g} % from the release before, where both were counted. A"
        " count says what the code does, not how long it takes.",
        instructions(history),
        [explain],
    )
    yield Section(
        "Releases that compute something else",
        "Releases in which a step does other work than in the release before, or a step or an"
        " operation gives another result.",
        work(history),
        [measure],
    )
    if history.failures:
        yield Section(
            "Measurements that failed",
            "What could not be measured because a process crashed, hung or failed, by a fault of"
            " the release or of mjbench.",
            failures(history),
            [measure],
        )


def _images(history: SpeedHistory, plots: str) -> Iterator[str]:
    for series in history.models:
        yield f"![{escaped(series.name)}]({plots}/{history_plots.file_name(series)})\n"


def conclusion(history: SpeedHistory) -> Iterator[str]:
    """Yield sentences: from the first release to the last, and the largest changes."""
    compared = [total_of(series) for series in history.models if len(series.measured) > 1]
    if not compared:
        yield "No model was timed in more than one release, so there is nothing to compare."
        return
    certain = [
        total.log_ratio
        for total in compared
        if abs(total.log_ratio) >= max(MIN_CHANGE, DEVIATIONS * total.deviation)
    ]
    slower = [log_ratio for log_ratio in certain if log_ratio > 0]
    faster = [log_ratio for log_ratio in certain if log_ratio < 0]
    uncertain = len(compared) - len(certain)
    yield (
        "From the first release that loads a model to the last, a step became slower for"
        f" {len(slower)} of {count_of(len(compared), 'model')}{_range(slower)}, and faster"
        f" for {len(faster)}{_range(faster)}."
        + (f" For {uncertain} the change is not certain." if uncertain else "")
    )
    listed = listed_changes(history, history.models)
    largest = sorted(listed, key=lambda c: -abs(c.point.change))[:_LARGEST_CHANGES]
    if largest:
        texts = [
            f"{log_change(c.point.change)} for {code(c.series.name)} in {c.after.release}"
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
    machine = f", on {_machine(history.machine)}" if history.machine else ""
    if history.operations_machine:
        machine += f" (operations on {_machine(history.operations_machine)})"
    yield (
        f"{len(releases)} releases, {releases[0]} to {releases[-1]}, were timed against the"
        f" reference, {', '.join(references)}{machine}, [each in turns with it](method/history.md),"
        " with the [placement of code](method/placement.md) averaged out."
        " Other machines have other times, and may have other ratios."
    )
    for problem in sorted({each.record.problem for each in measured if each.record.problem}):
        yield f"Placement was not averaged out everywhere: {escaped(problem)}."
    noisy = sum(each.ratio.deviation > SIMULATED_DEVIATION for each in measured)
    yield (
        "In [simulated histories](method/history-errors.md) of 42 releases with two or three"
        f" changes, at most {100 * FALSE_DISCOVERY_RATE:g} % of the listed changes are wrong if"
        f" ratios have standard errors of at most {100 * SIMULATED_DEVIATION:g} %. {noisy} of the"
        f" {len(measured)} ratios here have a larger one."
    )
    yield (
        "Standard errors do not include what the rest of the machine did meanwhile:"
        " [a disturbed run had changes that differ by up to several percent]"
        "(method/history.md#how-exact-it-is)."
    )
    yield from _against_itself(history)
    yield from no_change_line(history)


def _against_itself(history: SpeedHistory) -> Iterator[str]:
    """Yield how far the reference is from itself: the least that a bias of all ratios can be."""
    own = [
        each.ratio.log_ratio
        for series in (*history.models, *history.operations)
        for each in series.measured
        if each.release == each.record.reference
    ]
    if own:
        yield (
            "The reference against itself should differ by 0 %; it differs by"
            f" {_percent(min(own))} to {_percent(max(own))}."
        )


def no_change_line(history: SpeedHistory) -> Iterator[str]:
    """Yield what the page says of releases whose code is that of the one before; none without."""
    log_ratios: list[float] = []
    deviations: list[float] = []
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
            change = speed_history.change(*series.pair(index))
            log_ratios.append(change.log_ratio)
            deviations.append(change.deviation)
            listed += any(p.index == index for p in series.changes.change_points)
    if log_ratios:
        deviation, expected = (
            math.sqrt(statistics.fmean(x * x for x in values))
            for values in (log_ratios, deviations)
        )
        yield (
            "As a check, in some releases a step executes as many instructions as in the one"
            f" before: {', '.join(names)}. The root mean square of their"
            f" {count_of(len(log_ratios), 'change')} is {100 * deviation:.2f} %, where their"
            f" standard errors predict {100 * expected:.2f} %; {listed} of them"
            f" {'is' if listed == 1 else 'are'} listed."
        )


def _index(series: SpeedSeries, pair: NoChangePair) -> int | None:
    """Return the index of the second release of a pair, if the first one is right before it."""
    releases = [each.release for each in series.measured]
    if pair.new not in releases:
        return None
    index = releases.index(pair.new)
    return index if index and releases[index - 1] == pair.old else None


def _machine(machine: Machine) -> str:
    kind = ", virtual" if machine.hypervisor else ""
    return f"{escaped(machine.cpu)}{kind}, {machine.usable_cores} cores"


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
