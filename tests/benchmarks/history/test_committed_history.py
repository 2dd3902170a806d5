"""What the committed history of releases says, and docs/history.md with it."""

import itertools
import math
import re
import statistics

import pytest
from commands import ROOT

from benchmarks.history import bundle, files, known_causes, measurements, speed_series
from benchmarks.history import page as of_history
from benchmarks.history.release_ratios import RatioRecord
from benchmarks.history.speed_history import Listed, SpeedHistory, listed_changes
from benchmarks.history.speed_series import NO_CHANGE_PAIRS
from mjbench.paired.outcomes import Cause
from mjbench.releases.release import OLDEST, version_key
from mjbench.results import runs

METHOD = ROOT / "docs/method/history.md"
NO_CHANGE = ROOT / "results/history-checks/reference-history-no-change.jsonl"
WRITE = "python -m benchmarks.history page"


@pytest.fixture(scope="module")
def history() -> SpeedHistory:
    return files.read(files.run_files(ROOT / "results/history"), known_causes.FILE)


@pytest.fixture(scope="module")
def changes(history: SpeedHistory) -> dict[tuple[str, str], Listed]:
    """Return the change points by model or operation and release."""
    listed = listed_changes(history, [*history.models, *history.operations])
    return {(each.series.name, each.after.release): each for each in listed}


def test_all_releases_and_models_were_measured(history: SpeedHistory) -> None:
    known = [release.version for release in bundle.read(bundle.default_path())]
    versions = [version for version in known if version_key(version) >= OLDEST]
    assert history.releases() == versions
    counts = {series.name: len(series.measured) for series in history.models}
    assert counts.pop("cloth") == len(versions) - 1  # MuJoCo 2.3.7 cannot load it
    assert counts.pop("quadruped_terrain") == len(versions) - 5  # nor those before 3.1.2 this
    assert set(counts.values()) == {len(versions)}


@pytest.mark.parametrize(
    ("series", "release", "sign", "cause"),
    [
        ("cartpole", "3.3.1", 1, Cause.CODE),
        ("muscle_arm", "3.3.1", 1, Cause.CODE),
        ("pick_and_place", "3.3.6", -1, Cause.WORK),
        ("linkage", "3.7.0", 1, Cause.WORK),
        ("pick_and_place", "3.8.0", 1, Cause.WORK),
        ("spec", "3.14.0", -1, Cause.CODE),
    ],
)
def test_changes_that_are_known_otherwise_are_listed_with_their_cause(
    changes: dict[tuple[str, str], Listed], series: str, release: str, sign: int, cause: Cause
) -> None:
    listed = changes[series, release]
    assert listed.point.change * sign > 0
    assert listed.cause == cause
    assert listed.causes, "benchmarks/history/causes.toml says why"


@pytest.mark.parametrize(
    ("model", "release"), [("cloth", "3.2.0"), ("cloth", "3.3.2"), ("gripper", "3.1.6")]
)
def test_changes_that_only_the_wheels_placement_made_are_not_listed_as_code(
    changes: dict[tuple[str, str], Listed], model: str, release: str
) -> None:
    listed = changes.get((model, release))
    assert listed is None or listed.cause != Cause.CODE


def test_releases_that_execute_the_same_instructions_hardly_differ(
    history: SpeedHistory, changes: dict[tuple[str, str], Listed]
) -> None:
    log_ratios = []
    for pair in NO_CHANGE_PAIRS:
        for series in history.models:
            releases = [each.release for each in series.measured]
            index = releases.index(pair.new)
            assert releases[index - 1] == pair.old
            log_ratios.append(speed_series.change(*series.pair(index)).log_ratio)
            assert (series.name, pair.new) not in changes
    assert len(log_ratios) == 40
    assert math.sqrt(statistics.fmean(x * x for x in log_ratios)) < 0.005


def test_the_page_of_method_says_how_exact_the_committed_history_is(history: SpeedHistory) -> None:
    (line,) = of_history.no_change_line(history)
    figures = re.search(r"is ([0-9.]+ %), where their standard errors predict ([0-9.]+ %)", line)
    page = METHOD.read_text()
    assert f"three passes, Intel Xeon | {figures[1]} | {figures[2]} |" in page


def test_the_page_is_what_the_command_writes(history: SpeedHistory) -> None:
    text = "\n".join(of_history.document(of_history.sections(history), "history"))
    assert (ROOT / "docs/history.md").read_text() == f"{text}\n", WRITE
    for series in history.models:
        assert (ROOT / "docs/history" / f"{series.name}.svg").is_file()


def test_a_pass_in_turns_is_as_exact_as_the_page_says_and_takes_two_minutes_a_release() -> None:
    measured = files.read([NO_CHANGE], known_causes.FILE)
    (line,) = of_history.no_change_line(measured)
    figures = re.search(r"is ([0-9.]+ %), where their standard errors predict ([0-9.]+ %)", line)
    assert float(figures[1].split()[0]) < 0.5
    assert "; 0 of them are listed" in line
    page = " ".join(METHOD.read_text().split())
    assert f"one pass in groups, AMD EPYC | {figures[1]} | {figures[2]} |" in page
    seconds: dict[str, float] = {}
    for record in runs.load(NO_CHANGE, measurements.RECORD_TYPES).of_type(RatioRecord):
        seconds[record.release] = seconds.get(record.release, 0.0) + record.seconds
    assert max(seconds.values()) <= 120.0


def test_each_pair_without_a_change_is_two_neighbours() -> None:
    versions = [release.version for release in bundle.read(bundle.default_path())]
    neighbours = set(itertools.pairwise(versions))
    assert NO_CHANGE_PAIRS
    assert {(pair.old, pair.new) for pair in NO_CHANGE_PAIRS} <= neighbours
