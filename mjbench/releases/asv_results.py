"""Reads what asv measured of the releases: one `Series` for each benchmark and its parameters.

asv stores one file for each release; here its values are put in the order of the releases.
"""

import dataclasses
import itertools
import json
import statistics
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, describe, one_line
from mjbench.releases import bundle
from mjbench.releases.history import AsvMachine, History, Point, Series


def load(folder: Path, release_bundle: Path, machine: str | None = None) -> History:
    """Read the results that asv keeps in `folder`.

    Args:
      folder: such as results/asv.
      release_bundle: the git bundle with the releases that were measured.
      machine: the machine's name in asv; optional where there is only one.

    Raises:
      InputError: there are no results, they are not as asv writes them, or several machines have
        some and none is named.
    """
    try:
        return _load(folder, release_bundle, machine)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: not as asv writes it: {describe(error)}") from error


def _load(folder: Path, release_bundle: Path, machine: str | None) -> History:
    name = _machine_name(folder, machine)
    benchmarks = _read_json(folder / "benchmarks.json")
    results_of = _results_by_version(folder, name, release_bundle)
    if not results_of:
        raise InputError(
            f"the results in {folder / name} belong to none of the releases in {release_bundle}"
        )
    return History(
        machine=_machine(folder / name / "machine.json"),
        versions=list(results_of),
        series=list(_all_series(benchmarks, results_of)),
    )


def _machine_name(folder: Path, name: str | None) -> str:
    names = sorted(path.parent.name for path in folder.glob("*/machine.json"))
    if name is None and len(names) > 1:
        raise InputError(f"{folder} has results of {', '.join(names)}: name one by --machine")
    name = name or (names[0] if names else "")
    if name not in names:
        raise InputError(f"no results of asv in {folder / name}; `asv run` measures some")
    return name


def _results_by_version(folder: Path, machine: str, release_bundle: Path) -> dict[str, Any]:
    """Return asv's results of every release that was measured, in upload order."""
    version_of = {
        commit: tag.removeprefix("v")
        for tag, commit in bundle.hashes(release_bundle).items()
        if tag.startswith("v")
    }
    measured = {
        version_of[results.commit_hash]: results
        for results in _asv_results_module().iter_results_for_machine(str(folder), machine)
        if results.commit_hash in version_of
    }
    return {
        release.version: measured[release.version]
        for release in bundle.read(release_bundle)
        if release.version in measured
    }


def _machine(path: Path) -> AsvMachine:
    stored = _read_json(path)
    known = {field.name for field in dataclasses.fields(AsvMachine)}
    texts = {name: str(value) for name, value in stored.items() if name in known}
    return AsvMachine(**{"machine": path.parent.name, **texts})


def _read_json(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, TypeError) as error:
        raise InputError(f"cannot read {path}: {one_line(error)}") from error


def _asv_results_module() -> Any:
    """Return asv's module that reads results."""
    try:
        from asv import results
    except ImportError:
        raise InputError(
            "reading asv's results needs asv: python -m pip install 'mjbench[history]'"
        ) from None
    return results


def _all_series(benchmarks: Mapping[str, Any], results_of: Mapping[str, Any]) -> Iterator[Series]:
    for benchmark, description in sorted(benchmarks.items()):
        if not isinstance(description, dict):
            continue  # the version of the file's format
        points: dict[tuple[str, ...], dict[str, Point]] = {}
        for version, results in results_of.items():
            for params, point in _points(results, benchmark, description):
                points.setdefault(params, {})[version] = point
        for params, by_version in points.items():
            named_params = dict(zip(description["param_names"], params, strict=True))
            title = description.get("pretty_name") or benchmark
            yield Series(benchmark, title, named_params, by_version)


def _points(
    results: Any, benchmark: str, description: Mapping[str, Any]
) -> Iterator[tuple[tuple[str, ...], Point]]:
    """Yield (parameters, point) of one benchmark of one release.

    Values of an earlier version of the benchmark are left out: they measured something else.
    """
    if results.benchmark_version.get(benchmark) != description["version"]:
        return
    axes = results.get_result_params(benchmark)
    values = results.get_result_value(benchmark, axes)
    samples = results.get_result_samples(benchmark, axes)
    rounds = int(description.get("rounds", 1))
    for quoted, value, durations in zip(itertools.product(*axes), values, samples, strict=True):
        params = tuple(param.strip("'") for param in quoted)
        # asv stores NaN where a benchmark does not apply and None where it failed; so does Point.
        yield params, Point(value, _round_medians(durations or (), rounds))


def _round_medians(samples: Sequence[float], rounds: int) -> tuple[float, ...]:
    """Return the median of each round; asv appends a round's samples to those before."""
    count = len(samples) // rounds
    if not count:
        return ()
    return tuple(statistics.median(samples[i * count : (i + 1) * count]) for i in range(rounds))
