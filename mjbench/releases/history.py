"""What a history measured by asv shows: the steps between releases, and whether the work changed.

asv keeps one file for every release. Here they become series, one for each benchmark and choice
of parameters. A step is a change between two neighbouring releases: of the paired ratio to a
reference release, or of a time, if every round shows it and the releases around it stand apart.
"""

import itertools
import json
import math
import re
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, one_line
from mjbench.releases import catalogue
from mjbench.simulation import agreement

# The smallest change of a time that counts as a step.
THRESHOLD = 0.05
# Releases on each side of a step that must all lie on their side of it.
LEVEL = 3
# Benchmarks that say whether a step of the engine did the same work.
WORK = {
    "contacts": "step.Work.track_contacts",
    "constraints": "step.Work.track_constraints",
    "solver iterations": "step.Work.track_solver_iterations",
}
DRIFT = "step.Drift.track_drift"
# Times of a step, unpaired.
TIMES = ("step.Step.time_1000_steps", "step.HeavyStep.time_100_steps")
# Time of a step over the reference release's, paired.
RATIO = "reference.Reference.track_ratio_to_reference"
# Instructions of a step, counted: exact.
COUNT = "instructions.Instructions.track_instructions_per_step"
# The smallest change of a count that is marked.
COUNT_THRESHOLD = 0.01


@dataclass(frozen=True)
class Point:
    """One benchmark of one release.

    Attributes:
      value: seconds of one call, bytes, or what a counter says; NaN where it does not apply, and
        None where it failed.
      rounds: the median of each round's samples, in the order they were taken; empty of counters.
    """

    value: float | None
    rounds: tuple[float, ...] = ()

    @property
    def measured(self) -> bool:
        """Return whether there is a number."""
        return self.value is not None and not math.isnan(self.value)


@dataclass(frozen=True)
class Series:
    """One benchmark with one choice of parameters, along the releases.

    Attributes:
      benchmark: its name, such as `step.Step.time_1000_steps`.
      title: the name for readers.
      params: the parameters by name.
      points: by version, in upload order.
    """

    benchmark: str
    title: str
    params: Mapping[str, str]
    points: Mapping[str, Point]

    @property
    def timed(self) -> bool:
        """Return whether its values are seconds."""
        return bool(re.search(r"\.time(raw)?_", self.benchmark))

    @property
    def times(self) -> int:
        """Return how many things one call does."""
        found = re.search(r"\.time_(\d+)_", self.benchmark)
        return int(found[1]) if found else 1

    @property
    def label(self) -> str:
        """Return the parameters as people write them."""
        return ", ".join(self.params.values())


@dataclass(frozen=True)
class History:
    """What asv measured on one machine.

    Attributes:
      machine: what asv knows of it.
      versions: the releases measured, in upload order.
      series: every benchmark and choice of parameters.
    """

    machine: Mapping[str, str]
    versions: Sequence[str]
    series: Sequence[Series]

    def find(self, benchmark: str, **params: str) -> Series | None:
        """Return a series, or None."""
        for one in self.series:
            if one.benchmark == benchmark and dict(one.params) == params:
                return one
        return None


@dataclass(frozen=True)
class ChangePoint:
    """A change between two neighbouring releases.

    Attributes:
      series: where.
      old: the last release before it.
      new: the release it came in.
      ratio: new value over old value.
      rounds: the same by round; empty of a series without rounds.
    """

    series: Series
    old: str
    new: str
    ratio: float
    rounds: tuple[float, ...]


# -- reading ------------------------------------------------------------------------------------


def load(folder: Path, bundle: Path, machine: str | None = None) -> History:
    """Read the results that asv keeps in `folder`.

    Args:
      folder: such as results/asv.
      bundle: the history of releases that they are of.
      machine: its name; may be left out where there is one.

    Raises:
      InputError: no such results, or more than one machine and none named.
    """
    machines = sorted(p.parent.name for p in folder.glob("*/machine.json"))
    if machine is None and len(machines) > 1:
        raise InputError(f"{folder} has results of {', '.join(machines)}: name one by --machine")
    name = machine or (machines[0] if machines else "")
    if name not in machines:
        raise InputError(f"no results of asv in {folder / name}: measure some by `asv run`")
    known = _json(folder / "benchmarks.json")
    versions = {
        commit: tag.removeprefix("v")
        for tag, commit in catalogue.hashes(bundle).items()
        if tag.startswith("v")
    }
    order = [r.version for r in catalogue.read(bundle)]
    found = {
        versions[results.commit_hash]: results
        for results in _asv().iter_results_for_machine(str(folder), name)
        if results.commit_hash in versions
    }
    measured = [version for version in order if version in found]
    if not measured:
        raise InputError(f"the results in {folder / name} are of none of the releases of {bundle}")
    return History(
        machine=_json(folder / name / "machine.json"),
        versions=measured,
        series=list(_series(known, {version: found[version] for version in measured})),
    )


def _json(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"cannot read {path}: {one_line(error)}") from error


def _asv() -> Any:
    """Return asv's reader of results."""
    try:
        from asv import results
    except ImportError:
        raise InputError(
            "reading asv's results needs asv: python -m pip install 'mjbench[history]'"
        ) from None
    return results


def _series(known: Mapping[str, Any], found: Mapping[str, Any]) -> Iterator[Series]:
    for benchmark, about in sorted(known.items()):
        if not isinstance(about, dict):
            continue  # the version of the file's format
        points: dict[tuple[str, ...], dict[str, Point]] = {}
        for version, results in found.items():
            for params, point in _points(results, benchmark, about):
                points.setdefault(params, {})[version] = point
        for params, by_version in points.items():
            named = dict(zip(about["param_names"], params, strict=True))
            title = about.get("pretty_name") or benchmark
            yield Series(benchmark, title, named, by_version)


def _points(
    results: Any, benchmark: str, about: Mapping[str, Any]
) -> Iterator[tuple[tuple[str, ...], Point]]:
    """Yield (parameters, point) of one benchmark of one release.

    What another version of the benchmark measured is another thing, and left out.
    """
    if results.benchmark_version.get(benchmark) != about["version"]:
        return
    axes = results.get_result_params(benchmark)
    values = results.get_result_value(benchmark, axes)
    samples = results.get_result_samples(benchmark, axes)
    for params, value, taken in zip(itertools.product(*axes), values, samples, strict=True):
        plain = tuple(word.strip("'") for word in params)
        # asv stores what does not apply as NaN and what failed as None
        yield plain, Point(value, _by_round(taken or (), int(about.get("rounds", 1))))


def _by_round(samples: Sequence[float], rounds: int) -> tuple[float, ...]:
    """Return the median of each round; asv appends a round's samples to those before."""
    each = len(samples) // rounds
    if not each:
        return ()
    return tuple(statistics.median(samples[i * each : (i + 1) * each]) for i in range(rounds))


# -- deriving -----------------------------------------------------------------------------------


def change_points(history: History, threshold: float = THRESHOLD) -> list[ChangePoint]:
    """Return the steps of all timed series, by release and then the largest first.

    An unpaired time of a release is the smaller of its rounds' medians, since what disturbs a
    process only adds. A step is a change by more than `threshold` from one release to the next, in
    the same direction in every round, after which up to LEVEL releases all lie on the other side
    of all of the LEVEL before. One odd release is no step.
    """
    found = [s for one in history.series if one.timed for s in _change_points_of(one, threshold)]
    return _in_order(history, found)


def paired_change_points(history: History, threshold: float = THRESHOLD) -> list[ChangePoint]:
    """Return the steps of the paired ratio to the reference release, by release.

    A step is a change of more than `threshold` from one release to the next, of which the unpaired
    times show at least half in some round. Its rounds are those of the unpaired times.
    """
    found = []
    for one in history.series:
        if one.benchmark != RATIO:
            continue
        measured = [(v, float(p.value or 0.0)) for v, p in one.points.items() if p.measured]
        for (old, before), (new, after) in itertools.pairwise(measured):
            change = math.log(after / before)
            rounds = unpaired(history, one.params["model"], old, new)
            shown = any(math.log(r) * math.copysign(1, change) > abs(change) / 2 for r in rounds)
            if shown and abs(change) > math.log1p(threshold):
                found.append(ChangePoint(one, old, new, after / before, rounds))
    return _in_order(history, found)


def unpaired(history: History, model: str, old: str, new: str) -> tuple[float, ...]:
    """Return new over old time of a step of a model, round by round."""
    for benchmark in TIMES:
        series = history.find(benchmark, model=model)
        before, after = (series.points.get(v) if series else None for v in (old, new))
        if before and after:
            return tuple(b / a for a, b in zip(before.rounds, after.rounds, strict=False))
    return ()


def count_ratio(history: History, model: str, old: str, new: str) -> float | None:
    """Return new over old instructions of a step of a model; None where one was not counted."""
    before, after = (_value(history, COUNT, model, version) for version in (old, new))
    return after / before if before and after else None


def _in_order(history: History, found: Sequence[ChangePoint]) -> list[ChangePoint]:
    order = {version: i for i, version in enumerate(history.versions)}
    return sorted(found, key=lambda s: (order[s.new], -abs(math.log(s.ratio))))


def _change_points_of(series: Series, threshold: float) -> Iterator[ChangePoint]:
    measured = [(v, p) for v, p in series.points.items() if p.measured]
    values = [min(p.rounds or (float(p.value or 0.0),)) for _, p in measured]
    least = math.log1p(threshold)
    for i in range(1, len(measured)):
        (old, before), (new, after) = measured[i - 1], measured[i]
        below, above = values[max(0, i - LEVEL) : i], values[i : i + LEVEL]
        rounds = tuple(b / a for a, b in zip(before.rounds, after.rounds, strict=False))
        logs = [math.log(x) for x in (values[i] / values[i - 1], *rounds)]
        apart = min(above) > max(below) if logs[0] > 0 else max(above) < min(below)
        if apart and (all(x > least for x in logs) or all(x < -least for x in logs)):
            yield ChangePoint(series, old, new, values[i] / values[i - 1], rounds)


def work_changes(history: History, model: str, old: str, new: str) -> list[str]:
    """Return how a step of a model differs in work between two releases, in words.

    Counters first; then the drift, which is the difference to the reference release: where it
    differs between two releases, one of them computes something else.
    """
    before, after = (
        {
            name: value
            for name, benchmark in WORK.items()
            if (value := _value(history, benchmark, model, version)) is not None
        }
        for version in (old, new)
    )
    words = agreement.counter_changes(before, after)
    drifts = [_value(history, DRIFT, model, version) for version in (old, new)]
    if None not in drifts:
        low, high = sorted(float(drift or 0.0) for drift in drifts)
        if high > agreement.ROUNDING and high - low > 1e-3 * high:
            words.append("other result of a step")
    return words


def _value(history: History, benchmark: str, model: str, version: str) -> float | None:
    series = history.find(benchmark, model=model)
    point = series.points.get(version) if series else None
    return point.value if point and point.measured else None


def gaps(history: History) -> list[tuple[str, str, list[str], str]]:
    """Return (title, parameters, releases, `failed` or `not applicable`) of what has no number."""
    found = []
    for one in history.series:
        missing: dict[str, list[str]] = {}
        for version, point in one.points.items():
            if not point.measured:
                kind = "failed" if point.value is None else "not applicable"
                missing.setdefault(kind, []).append(version)
        found += [(one.title, one.label, versions, kind) for kind, versions in missing.items()]
    return found
