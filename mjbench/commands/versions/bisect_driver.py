"""What `mjbench bisect` measures: commits of the user's code, or releases of MuJoCo."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mjbench.commands.versions import bisect
from mjbench.commands.versions.bisect import (
    BisectComparison,
    BisectMeasured,
    BisectRecord,
    VersionKind,
)
from mjbench.commands.versions.function_sides import RevisionComparison
from mjbench.errors import InputError
from mjbench.paired import targets
from mjbench.paired.verdict import VerdictPlan
from mjbench.paths import BASE
from mjbench.releases import catalogue
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, input_files, pinning_notes
from mjbench.simulation.models import ModelSource

# Yields what is measured; called with what shows the text of a phase, and with earlier records.
_Search = Callable[[Callable[[str], None], Sequence[Record]], Iterator[BisectMeasured]]


def revision_bisection(comparison: RevisionComparison, plan: VerdictPlan) -> Measurement:
    plan = replace(plan, as_shipped=True)
    (function,) = comparison.functions
    return _measurement(
        lambda *observers: bisect.search_revisions(comparison, plan, *observers),
        VersionKind.COMMIT,
        {
            **asdict(plan),
            "revisions": [asdict(each) for each in (comparison.baseline, comparison.candidate)],
            "function": function.text,
            "own_files": comparison.own_files,
        },
        comparison.files,
    )


def release_bisection(
    baseline: ReleaseSpec, candidate: ReleaseSpec, source: ModelSource, plan: VerdictPlan
) -> Measurement:
    """Return the search between two releases; InputError for packages, or another metric."""
    if baseline.has_packages or candidate.has_packages:
        raise InputError(
            "bisect searches releases of MuJoCo alone: `mjbench versions` has packages"
        )
    targets.check_metric(plan.sizes.metric, [BASE])
    releases = catalogue.releases_between(baseline, candidate)
    measurement = _measurement(
        lambda *observers: bisect.search_releases(releases, source, plan, *observers),
        VersionKind.RELEASE,
        {
            **asdict(plan),
            "releases": [release.key for release in releases.specs],
            "model": source.name,
        },
        input_files([source], releases.specs, plan.sizes.starts),
    )
    return replace(measurement, notes=[*releases.notes, *measurement.notes])


def _measurement(
    search: _Search, kind: VersionKind, arguments: Mapping[str, Any], files: Sequence[Path]
) -> Measurement:
    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        if any(isinstance(record, BisectRecord) for record in earlier):
            return
        expected = 0
        for number, record in enumerate(search(observer.begin, earlier), 1):
            yield Item([record])
            if isinstance(record, BisectComparison):
                expected = expected or bisect.expected_comparisons(record.version.number)
                text = bisect.short_name(record.version, kind)
                observer(text, number / max(expected, number + 1))

    return Measurement("bisect", arguments, files, measure, bisect.finished, pinning_notes())
