"""The page of the history: what changed between releases, what accounts for it, and plots."""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence

from benchmarks.history import plots, speed_series, tables
from benchmarks.history.change_points import (
    FALSE_DISCOVERY_RATE,
    MIN_CHANGE,
    MIN_DEVIATIONS,
    SIMULATED_DEVIATION,
)
from benchmarks.history.log_estimates import LogEstimate, log_change
from benchmarks.history.speed_history import SpeedHistory, listed_changes
from benchmarks.history.speed_series import NO_CHANGE_PAIRS, MeasuredRelease, SpeedSeries
from mjbench.formats import count_of
from mjbench.host.machine import Machine
from mjbench.results import markdown
from mjbench.results.content import Conclusion, Section
from mjbench.simulation import models

# As many of the largest changes are named in the conclusion.
_LARGEST_CHANGES = 3
_METHODS = {
    "how releases are timed": "method/history.md",
    "how exact that is": "method/history.md#how-exact-it-is",
    "how placement is averaged out": "method/placement.md",
    "simulated histories": "method/history.md#which-changes-are-listed",
}


def document(sections: Iterable[Section], folder: str) -> Iterator[str]:
    """Yield the lines of a document of sections; the first one has its title.

    Args:
      folder: of the sections' figures, as the page is to link it.
    """
    for number, section in enumerate(sections):
        if number:
            yield ""
        yield f"{'##' if number else '#'} {markdown.escaped(section.heading)}"
        for text in (*(each.text for each in section.conclusions), *section.facts):
            yield ""
            yield markdown.escaped(text)
        for figure in section.figures:
            yield ""
            yield f"![{markdown.escaped(figure.title)}]({folder}/{plots.file_name(figure.title)})"
        if not section.figures:
            yield from markdown.tables(section)
        for note in section.notes:
            yield ""
            yield markdown.escaped(note)
        if not number:
            links = (f"[{about}]({page})" for about, page in _METHODS.items())
            yield ""
            yield f"See {', '.join(links)}."
        yield ""
        yield f"Measured by {markdown.code(section.command)}"
    yield ""
    yield "Written by mjbench; do not edit."


def sections(history: SpeedHistory) -> Iterator[Section]:
    """Yield what changed, a plot of each model, and the change points."""
    first = history.releases()[0]
    measure = f"python -m benchmarks.history measure --since {first}"
    both = f"{measure} && python -m benchmarks.history explain --since {first}"
    yield Section(
        "What changed between releases",
        conclusions=[Conclusion(sentence) for sentence in conclusions(history)],
        notes=[*_provenance(history)],
        command=measure,
    )
    yield Section(
        "Change points of a step",
        facts=[
            f"Changes of {_percent(tables.MIN_CHANGE)} or more, with standard errors. *Code* means"
            " that the same work takes a different time, *work* that the step computes something"
            " different. A percentage after a function is the change of its instructions, as a"
            " share of the step's."
        ],
        tables=[tables.step_changes(history)],
        command=both,
    )
    if history.operations:
        yield Section(
            "Change points around the step",
            facts=[
                f"Changes of {_percent(tables.MIN_OPERATION_CHANGE)} or more, on one thread. ×2 is"
                " twice the time. rollout steps, so it changes with mj_step, too."
            ],
            tables=[tables.operation_changes(history)],
            command=both,
        )
    yield Section(
        "Plots",
        facts=[
            "From top to bottom: the time of a step over that of the reference, with two standard"
            " errors and all change points; its instructions; its work; and how far the result of"
            " one step is from the reference's. Shaded: the ratio as shipped, where it differs."
        ],
        figures=[plots.figure(history, series) for series in history.models],
        command=both,
        is_open=True,
    )


def conclusions(history: SpeedHistory) -> Iterator[str]:
    """Yield sentences: from the first release to the last, and the largest changes."""
    compared = [
        speed_series.change(series.measured[0], series.measured[-1])
        for series in history.models
        if len(series.measured) > 1
    ]
    if not compared:
        yield "No model was timed in more than one release, so there is nothing to compare."
        return
    certain = [
        total.log_ratio
        for total in compared
        if abs(total.log_ratio) >= max(MIN_CHANGE, MIN_DEVIATIONS * total.deviation)
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
            f"{log_change(c.point.change)} for {c.series.name} in {c.after.release}"
            for c in largest
        ]
        yield f"The largest changes from one release to the next are {', '.join(texts)}."


def _range(log_ratios: Sequence[float]) -> str:
    if not log_ratios:
        return ""
    ends = sorted(log_ratios, key=abs)[:: max(1, len(log_ratios) - 1)]
    return f" ({' to '.join(map(log_change, ends))})"


def _provenance(history: SpeedHistory) -> Iterator[str]:
    """Yield sentences: what was measured, where, and how often what is listed is wrong."""
    releases = history.releases()
    measured = [each for series in history.all_series for each in series.measured]
    references = sorted({each.record.reference for each in measured})
    machine = f", on {_machine(history.machine)}" if history.machine else ""
    if history.operations_machine:
        machine += f" (operations on {_machine(history.operations_machine)})"
    yield (
        f"{len(releases)} releases, {releases[0]} to {releases[-1]}, were timed against the"
        f" reference, {', '.join(references)}{machine}. A release and the reference ran"
        " alternately, with the placement of code averaged out. Other machines may have other"
        " ratios."
    )
    for problem in sorted({each.record.problem for each in measured if each.record.problem}):
        yield f"Placement was not averaged out everywhere: {problem}."
    noisy = sum(each.ratio.deviation > SIMULATED_DEVIATION for each in measured)
    yield (
        "In simulated histories of 42 releases with two or three changes, at most"
        f" {100 * FALSE_DISCOVERY_RATE:g} % of the listed changes are wrong if ratios have standard"
        f" errors of at most {100 * SIMULATED_DEVIATION:g} %. {noisy} of the {len(measured)} ratios"
        " here have a larger one."
    )
    own = [each.ratio.log_ratio for each in measured if each.release == each.record.reference]
    if own:  # the least that a bias of all ratios can be
        yield (
            "The reference against itself should differ by 0 %; it differs by"
            f" {_percent(min(own))} to {_percent(max(own))}."
        )
    yield from no_change_line(history)


def no_change_line(history: SpeedHistory) -> Iterator[str]:
    """Yield how much releases differ whose code is that of the one before; nothing without any."""
    changes: list[LogEstimate] = []
    names: dict[str, None] = {}
    listed = 0
    shipped = models.shipped()
    for pair in NO_CHANGE_PAIRS:
        for series, before, after in _pairs(history, pair.new):
            if before.release == pair.old and series.name in shipped:
                names[pair.new] = None
                changes.append(speed_series.change(before, after))
                points = series.changes.change_points
                listed += any(series.measured[point.index] is after for point in points)
    if changes:
        deviation, expected = (
            math.sqrt(statistics.fmean(x * x for x in values))
            for values in ([c.log_ratio for c in changes], [c.deviation for c in changes])
        )
        yield (
            "As a check, a step of some releases executes as many instructions as in the release"
            f" before: {', '.join(names)}. The root mean square of their"
            f" {count_of(len(changes), 'change')} is {100 * deviation:.2f} %, where their"
            f" standard errors predict {100 * expected:.2f} %; {listed} of them"
            f" {'is' if listed == 1 else 'are'} listed."
        )


def _pairs(
    history: SpeedHistory, release: str
) -> Iterator[tuple[SpeedSeries, MeasuredRelease, MeasuredRelease]]:
    """Yield each model that was measured in a release and before it, with both."""
    for series in history.models:
        releases = [each.release for each in series.measured]
        if release in releases[1:]:
            yield series, *series.pair(releases.index(release))


def _machine(machine: Machine) -> str:
    kind = ", virtual" if machine.hypervisor else ""
    return f"{machine.cpu}{kind}, {machine.usable_cores} cores"


def _percent(log_ratio: float) -> str:
    return f"{100 * math.expm1(log_ratio):.2g} %"
