"""What a history shows: steps, changed work, gaps, and the page made of them."""

import json
import math
import re
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from commands import ROOT

from mjbench.errors import InputError
from mjbench.releases import catalogue
from mjbench.releases import history as room
from mjbench.releases.history import History, Point, Series
from mjbench.report import history as report

VERSIONS = ["1.0", "1.1", "1.2", "1.3", "1.4", "1.5"]


def timed(*values: Any, model: str = "pole", rounds: Any = None) -> Series:
    """Return a series of step times in seconds, both rounds alike unless given."""
    points = {}
    for i, (version, value) in enumerate(zip(VERSIONS, values, strict=False)):
        both = (value,) * (2 if value else 0) if rounds is None else rounds[i]
        points[version] = Point(value, both)
    return Series(room.TIMES[0], "1000 × mj_step", {"model": model}, points)


def counted(benchmark: str, *values: float, model: str = "pole") -> Series:
    points = {v: Point(x) for v, x in zip(VERSIONS, values, strict=False)}
    return Series(benchmark, benchmark, {"model": model}, points)


def history(*series: Series) -> History:
    return History({"machine": "here"}, VERSIONS, series)


def test_a_step_is_found_where_it_came() -> None:
    (step,) = room.change_points(history(timed(1.0, 1.01, 0.99, 1.2, 1.21, 1.19)))
    assert (step.old, step.new) == ("1.2", "1.3")
    assert step.ratio == pytest.approx(1.2 / 0.99)


def test_a_step_down_is_one_too() -> None:
    (step,) = room.change_points(history(timed(1.0, 1.0, 0.8, 0.8, 0.8, 0.8)))
    assert step.ratio == pytest.approx(0.8)


@pytest.mark.parametrize(
    "values",
    [
        (1.0, 1.04, 1.0, 1.04, 1.0, 1.04),  # too small
        (1.0, 1.0, 1.3, 1.0, 1.0, 1.0),  # one odd release
        (1.0, 1.3, 1.0, 1.2, 1.2, 1.2),  # the releases before do not stand apart
        (1.0, 1.04, 1.08, 1.12, 1.16, 1.2),  # a slope, no single step above 5 %
    ],
)
def test_what_is_no_step(values: tuple[float, ...]) -> None:
    assert room.change_points(history(timed(*values))) == []


def test_a_step_must_show_in_every_round() -> None:
    """The machine was slow for the whole of one round from 1.3 on: nothing is told."""
    values = (1.0, 1.0, 1.0, 1.1, 1.1, 1.1)
    rounds = [(1.0, 1.0)] * 3 + [(1.2, 1.0)] * 3
    assert room.change_points(history(timed(*values, rounds=rounds))) == []


def test_releases_without_a_number_are_passed_over() -> None:
    (step,) = room.change_points(history(timed(1.0, 1.0, math.nan, None, 1.5, 1.5)))
    assert (step.old, step.new) == ("1.1", "1.4")


def test_what_slows_one_round_does_not_count() -> None:
    rounds = [(1.0, 1.0)] * 3 + [(1.2, 1.3)] * 3
    (step,) = room.change_points(history(timed(1.0, 1.0, 1.0, 1.25, 1.25, 1.25, rounds=rounds)))
    assert step.ratio == pytest.approx(1.2)
    assert step.rounds == pytest.approx((1.2, 1.3))


def test_a_paired_step_is_one_by_itself() -> None:
    ratios = counted(room.RATIO, 1.0, 1.02, 1.3, 1.0, math.nan, 0.9)
    times = timed(1.0, 1.0, 1.2, 1.0, 1.0, 0.9)
    found = room.paired_change_points(history(ratios, times))
    assert [(s.old, s.new) for s in found] == [("1.1", "1.2"), ("1.2", "1.3"), ("1.3", "1.5")]


def test_a_paired_step_that_no_unpaired_round_shows_is_none() -> None:
    ratios = counted(room.RATIO, 1.0, 1.0, 1.1, 1.1, 1.1, 1.1)
    times = timed(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    assert room.paired_change_points(history(ratios, times)) == []


def test_changed_work_is_told_in_words() -> None:
    found = history(
        counted(room.WORK["contacts"], 1.0, 5.0),
        counted(room.WORK["constraints"], 4.0, 4.0),
        counted(room.DRIFT, 1e-3, 1e-3),
    )
    assert room.work_changes(found, "pole", "1.0", "1.1") == ["contacts 1 → 5"]


@pytest.mark.parametrize(
    ("drifts", "words"),
    [
        ((0.0, 0.0), []),
        ((1e-15, 0.0), []),  # rounding
        ((1e-3, 0.0), ["other result of a step"]),
        ((1e-3, 2e-3), ["other result of a step"]),
    ],
)
def test_another_result_of_a_step_is_told(drifts: tuple[float, float], words: list[str]) -> None:
    assert room.work_changes(history(counted(room.DRIFT, *drifts)), "pole", "1.0", "1.1") == words


def test_rounds_are_the_parts_of_the_samples() -> None:
    assert room._by_round([1.0, 2.0, 3.0, 10.0, 20.0, 30.0], 2) == (2.0, 20.0)
    assert room._by_round([], 2) == ()


def test_the_page_names_steps_causes_and_gaps() -> None:
    series = timed(1.0e-3, 1.0e-3, math.nan, 1.5e-3, 1.5e-3, None)
    ratios = counted(room.RATIO, 1.0, 1.0, math.nan, 1.4, 1.4, 1.4)
    contacts = counted(room.WORK["contacts"], 1, 1, 1, 5, 5, 5)
    causes = [report.Cause("1.3", "pole", "abc123", "more contacts")]
    page = report.page(history(series, ratios, contacts), causes)
    assert "| 1.3 | `pole` | +40.0 % |" in page
    assert "| contacts 1 → 5 |" in page
    assert "more contacts (`abc123`)" in page
    assert "| not applicable | 1.2 |" in page
    assert "| failed | 1.5 |" in page
    assert "| 1.3 | 1.5▲ |" in page


def test_instructions_stand_beside_a_step_and_in_a_table_of_their_own() -> None:
    series = timed(1.0e-3, 1.0e-3, 1.5e-3)
    ratios = counted(room.RATIO, 1.0, 1.0, 1.4)
    counts = counted(room.COUNT, 10_000.0, 10_050.0, 11_100.0)
    found = history(series, ratios, counts)
    assert room.count_ratio(found, "pole", "1.1", "1.2") == pytest.approx(1.10448, abs=1e-5)
    assert room.count_ratio(found, "pole", "1.2", "1.3") is None
    page = report.page(found, [])
    assert "| 1.2 | `pole` | +40.0 % | +50.0 %, +50.0 % | +10.4 % | the same |" in page
    assert "| 1.1 | 10.05 |" in page
    assert "| 1.2 | 11.1▲ |" in page
    assert "Not counted." in report.page(history(series, ratios), [])


def test_no_results_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no results of asv"):
        room.load(tmp_path, catalogue.bundle_path())


def test_two_machines_must_be_told_apart(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "machine.json").write_text("{}")
    with pytest.raises(InputError, match="one, two: name one by --machine"):
        room.load(tmp_path, catalogue.bundle_path())


# what is committed


def test_the_committed_page_is_what_the_committed_results_show() -> None:
    measured = room.load(ROOT / "results/asv", catalogue.bundle_path())
    causes = report.causes(ROOT / "benchmarks/causes.toml")
    page = (ROOT / "docs/history.md").read_text()
    assert page == report.page(measured, causes), "mjbench history -o docs/history.md"


def test_the_committed_results_span_the_releases() -> None:
    measured = room.load(ROOT / "results/asv", catalogue.bundle_path())
    assert len(measured.versions) >= 30
    minors: dict[str, list[str]] = {}
    for release in catalogue.read(catalogue.bundle_path()):
        if catalogue.key(release.version) >= (2, 3, 7):
            minors.setdefault(release.version.rpartition(".")[0], []).append(release.version)
    for versions in minors.values():
        assert {versions[0], versions[-1]} <= set(measured.versions)
    for series in measured.series:
        for version, point in series.points.items():
            assert len(point.rounds) == 2 or not series.timed or not point.measured, version


def test_the_committed_results_hold_no_paths_and_addresses() -> None:
    for file in (ROOT / "results/asv").rglob("*.json"):
        # an absolute path, or an address; a benchmark's code and texts have slashes within
        assert not re.search(r'://|(?<=["=\s])/\w+/\w', file.read_text()), file


def test_every_cause_is_an_item_of_its_release_in_the_changelog() -> None:
    changelog = Path(str(metadata.distribution("mujoco").locate_file("mujoco/doc/changelog.rst")))
    if not changelog.is_file():
        pytest.skip("this MuJoCo ships no changelog")
    parts = re.split(r"^Version (\d+\.\d+\.\d+).*$", changelog.read_text(), flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    for cause in report.causes(ROOT / "benchmarks/causes.toml"):
        assert cause.commit in sections[cause.release], cause


def test_the_series_that_the_page_is_made_of_are_there() -> None:
    known = json.loads((ROOT / "results/asv/benchmarks.json").read_text())
    assert {*room.TIMES, *room.WORK.values(), room.DRIFT, room.RATIO, room.COUNT} <= set(known)
