import re
from pathlib import Path

import pytest
from commands import ROOT

from mjbench.errors import InputError
from mjbench.releases import asv_results, bundle
from mjbench.releases.release import version_key


def test_rounds_are_the_parts_of_the_samples() -> None:
    assert asv_results._round_medians([1.0, 2.0, 3.0, 10.0, 20.0, 30.0], 2) == (2.0, 20.0)
    assert asv_results._round_medians([], 2) == ()


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no results of asv"):
        asv_results.load(tmp_path, bundle.default_path())


def test_one_of_two_machines_must_be_named(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "machine.json").write_text("{}")
    with pytest.raises(InputError, match="one, two: name one by --machine"):
        asv_results.load(tmp_path, bundle.default_path())


@pytest.mark.parametrize(
    ("content", "reason"), [(None, "No such file or directory"), ("{", "Expecting .*")]
)
def test_a_file_that_cannot_be_read_is_named_once(
    tmp_path: Path, content: str | None, reason: str
) -> None:
    file = tmp_path / "benchmarks.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError, match=f"^cannot read {re.escape(str(file))}: {reason}$"):
        asv_results._read_json(file)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("benchmarks.json", '{"step.Time.time": {"version": "1"}}'),
        ("benchmarks.json", '{"step.Time.time": 3}'),
        ("here/machine.json", "[1]"),
        ("here/v4.0.0.json", '{"commit_hash": 1, "results": []}'),
        ("here/v4.0.0.json", "[]"),
    ],
)
def test_results_that_asv_did_not_write_are_an_input_error(
    tmp_path: Path, name: str, content: str
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here/machine.json").write_text('{"machine": "here"}')
    (tmp_path / "benchmarks.json").write_text("{}")
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError):
        asv_results.load(tmp_path, bundle.default_path())


def test_the_committed_results_span_the_releases() -> None:
    measured = asv_results.load(ROOT / "results/asv", bundle.default_path())
    assert len(measured.versions) >= 30
    minors: dict[str, list[str]] = {}
    for release in bundle.read(bundle.default_path()):
        if version_key(release.version) >= (2, 3, 7):
            minors.setdefault(release.version.rpartition(".")[0], []).append(release.version)
    for versions in minors.values():
        assert {versions[0], versions[-1]} <= set(measured.versions)
    for series in measured.series:
        for version, point in series.points.items():
            assert len(point.rounds) == 2 or not series.is_timed or not point.is_measured, version


def test_the_committed_results_hold_no_paths_and_addresses() -> None:
    files = list((ROOT / "results/asv").rglob("*.json"))
    assert len(files) > 40
    for file in files:
        # an absolute path, or an address; a benchmark's code and texts have slashes within
        assert not re.search(r'://|(?<=["=\s])/\w+/\w', file.read_text()), file
