"""The comparison of foreign models, on a package that the test makes: nothing is downloaded."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from example_models import CONTACT_XML

from benchmarks.studies import (
    foreign,
    foreign_packages,
    foreign_page,
    foreign_progress,
    foreign_tally,
)
from benchmarks.studies.foreign_packages import Package, PackageFiles
from benchmarks.studies.foreign_tally import FileResult, Outcome
from benchmarks.studies.page_part import PagePart, of_lines
from mjbench.errors import InputError, MachineError
from mjbench.status import ExitCode

PACKAGE = Package("robots", "1.0")
MODELS = {
    "bots/contact.xml": CONTACT_XML,
    "bots/still.xml": "<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>",
    "bots/lost_mesh.xml": "<mujoco><asset><mesh file='no.stl'/></asset></mujoco>",
    "bots/parts/whole.xml": "<mujoco><include file='parts/contact.xml'/></mujoco>",
    "bots/sensor.xml": "<mujoco><sensor><jointpos joint='none'/></sensor></mujoco>",
    "bots/wrong.xml": "<mujoco><wheel/></mujoco>",
    "bots/diverging.xml": "<mujoco><option timestep='1e9'/><worldbody><body><freejoint/>"
    "<geom size='.1'/></body></worldbody></mujoco>",
}
EXPECTED = {
    "bots/contact.xml": Outcome.AGREES,
    "bots/still.xml": Outcome.NOTHING_TO_STEP,
    "bots/lost_mesh.xml": Outcome.FILE_MISSING,
    "bots/parts/whole.xml": Outcome.FILE_ELSEWHERE,
    "bots/sensor.xml": Outcome.NAME_MISSING,
    "bots/wrong.xml": Outcome.REJECTED,
}


def package_of(root: Path, models: dict[str, str]) -> PackageFiles:
    for name, xml in models.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(xml)
    return foreign_packages.list_files(PACKAGE, root)


def files_in(folder: Path) -> foreign.Files:
    part = PagePart(str(folder / "page.md"), "foreign", "a test")
    part.file.write_text("<!-- foreign: written by a test -->\n<!-- end -->\n")
    return foreign.Files(folder, folder / "progress.jsonl", folder / "foreign.json", part)


def results_of(tally: foreign_tally.ForeignTally) -> dict[str, Outcome]:
    return {r.file: r.outcome for package in tally.packages for r in package.results}


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Compare no model: every file agrees. Yields the files that were asked for."""
    asked: list[str] = []

    def compare_file(package: PackageFiles, file: str, limit_s: float) -> FileResult:
        asked.append(file)
        return FileResult(file, Outcome.AGREES)

    monkeypatch.setattr(foreign, "compare_file", compare_file)
    return asked


# -- the real comparison ------------------------------------------------------------------------


@pytest.mark.parametrize("file", EXPECTED)
def test_a_file_ends_as_what_it_is(tmp_path: Path, file: str) -> None:
    package = package_of(tmp_path, MODELS)
    result = foreign.compare_file(package, file, 60.0)
    assert result.outcome == EXPECTED[file], result.detail
    assert str(tmp_path) not in result.detail
    if result.outcome == Outcome.AGREES:
        assert set(result.statuses) == set(map(str, foreign.plan().variants))


def test_a_model_of_which_every_simulation_diverges_is_refused_with_the_reason(
    tmp_path: Path,
) -> None:
    package = package_of(tmp_path, MODELS)
    result = foreign.compare_file(package, "bots/diverging.xml", 60.0)
    assert result.outcome == Outcome.REFUSED
    assert result.detail.startswith("every simulation diverges (BAD")


def test_the_variants_do_not_depend_on_the_cores_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from mjbench.host import machine

    variants = foreign.plan().variants
    monkeypatch.setattr(machine, "usable_cores", lambda: 64)
    assert foreign.plan().variants == variants
    assert len(variants) == 13


# -- a run --------------------------------------------------------------------------------------


def test_a_run_writes_a_tally_and_its_page_and_forgets_its_progress(
    tmp_path: Path, compared: list[str]
) -> None:
    package, files = package_of(tmp_path / "robots", MODELS), files_in(tmp_path)
    tally = foreign.run_all([package], files, 60.0)
    assert foreign_tally.load(files.tally) == tally
    assert files.part.text() == of_lines(foreign_page.lines(tally))
    assert compared == sorted(MODELS)
    assert not files.progress.exists()


def test_a_run_that_was_stopped_continues(
    tmp_path: Path, compared: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    package, files = package_of(tmp_path / "robots", MODELS), files_in(tmp_path)
    compare_file = foreign.compare_file

    def stopped(package: PackageFiles, file: str, limit_s: float) -> FileResult:
        if len(compared) == 3:
            raise KeyboardInterrupt
        return compare_file(package, file, limit_s)

    with monkeypatch.context() as patch:
        patch.setattr(foreign, "compare_file", stopped)
        with pytest.raises(KeyboardInterrupt):
            foreign.run_all([package], files, 60.0)
    assert not files.tally.exists()
    with files.progress.open("a") as progress:  # as if killed in the middle of a line
        progress.write('{"package": "robots')
    tally = foreign.run_all([package], files, 60.0)
    assert compared == sorted(MODELS)
    assert set(results_of(tally)) == set(MODELS)


def test_progress_of_other_conditions_is_not_continued(tmp_path: Path) -> None:
    file, result = tmp_path / "progress.jsonl", FileResult("a.xml", Outcome.AGREES)
    foreign_progress.Progress(file, "mujoco 3").append(PACKAGE, result)
    assert foreign_progress.Progress(file, "mujoco 3").result(PACKAGE, "a.xml") == result
    assert foreign_progress.Progress(file, "mujoco 4").result(PACKAGE, "a.xml") is None


def test_one_file_runs_again_and_the_rest_of_the_tally_stays(
    tmp_path: Path, compared: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    package, files = package_of(tmp_path / "robots", MODELS), files_in(tmp_path)
    foreign.run_all([package], files, 60.0)
    refused = FileResult("bots/still.xml", Outcome.REFUSED, "it stands still")
    monkeypatch.setattr(foreign, "compare_file", lambda *arguments: refused)
    tally = foreign.run_only([package], ["still"], files, 60.0)
    assert results_of(tally) == dict.fromkeys(MODELS, Outcome.AGREES) | {
        refused.file: Outcome.REFUSED
    }
    assert foreign_tally.load(files.tally) == tally
    assert tally.packages[0].remarks == (refused,)
    assert (tally.packages[0].models, tally.packages[0].agree) == (len(MODELS), len(MODELS) - 1)


def test_a_package_of_another_version_cannot_run_again_alone(
    tmp_path: Path, compared: list[str]
) -> None:
    package, files = package_of(tmp_path / "robots", MODELS), files_in(tmp_path)
    foreign.run_all([package], files, 60.0)
    newer = PackageFiles(Package("robots", "2.0"), package.root, package.mjcf, 0)
    with pytest.raises(InputError, match=r"robots==1\.0.*robots==2\.0.*without --only"):
        foreign.run_only([newer], ["still"], files, 60.0)


def test_a_name_that_stands_for_no_file_is_refused(tmp_path: Path) -> None:
    package = package_of(tmp_path, MODELS)
    assert len(foreign.select([package], ["robots", "still"])) == len(MODELS)
    with pytest.raises(InputError, match=r"--only ant: no such .* packages are robots"):
        foreign.select([package], ["ant"])


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (Outcome.AGREES, ExitCode.OK),
        (Outcome.REFUSED, ExitCode.OK),
        (Outcome.REJECTED, ExitCode.OK),
        (Outcome.DISAGREES, ExitCode.FINDING),
        (Outcome.CRASHED, ExitCode.ENVIRONMENT),
        (Outcome.TIMEOUT, ExitCode.ENVIRONMENT),
        (Outcome.FAILED, ExitCode.ENVIRONMENT),
    ],
)
def test_the_exit_code_is_that_of_the_worst_outcome(
    tmp_path: Path, outcome: Outcome, code: ExitCode
) -> None:
    package = package_of(tmp_path, MODELS)
    results = [FileResult("a.xml", outcome, "why"), FileResult("b.xml", Outcome.AGREES)]
    assert foreign.exit_code(foreign.tally_of([package], {"robots": results})) == code


def test_two_runs_do_not_share_a_cache_folder(tmp_path: Path) -> None:
    with (
        foreign._locked(tmp_path),
        pytest.raises(MachineError, match="another run"),
        foreign._locked(tmp_path),
    ):
        pass


# -- the command --------------------------------------------------------------------------------


def test_a_package_that_cannot_be_downloaded_ends_the_command_before_anything_is_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def download(package: Package, folder: Path) -> Path:
        raise MachineError(f"cannot download {package}: no such release")

    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(foreign_packages, "_download", download)
    before = foreign.TALLY.read_bytes()
    assert foreign.main([]) == ExitCode.ENVIRONMENT
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"foreign: cannot download {foreign.PACKAGES[0]}: no such release"
    assert foreign.TALLY.read_bytes() == before


@pytest.mark.parametrize("arguments", [[], ["--only", "still"]])
def test_an_interrupted_command_keeps_what_was_compared_and_says_where(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    compared: list[str],
    arguments: list[str],
) -> None:
    files = files_in(tmp_path)
    package = package_of(tmp_path / "robots", MODELS)
    foreign.run_all([package], files, 60.0)

    def stopped(package: PackageFiles, file: str, limit_s: float) -> FileResult:
        raise KeyboardInterrupt

    monkeypatch.setenv("MJBENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(foreign, "compare_file", stopped)
    monkeypatch.setattr(foreign, "PACKAGES", (PACKAGE,))
    monkeypatch.setattr(foreign, "_fetched", lambda *arguments: package)
    monkeypatch.setattr(foreign, "TALLY", files.tally)
    monkeypatch.setattr(foreign_page, "PART", files.part)
    assert foreign.main(arguments) == ExitCode.INTERRUPTED
    stored = "the tally has what was compared" if arguments else "the same command continues"
    assert capsys.readouterr().err == f"foreign: interrupted; {stored}\n"
    assert set(results_of(foreign_tally.load(files.tally))) == set(MODELS)


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "soon"])
def test_a_time_limit_is_a_number_of_seconds_above_0(limit: str) -> None:
    with pytest.raises(SystemExit) as ended:
        foreign.main(["--time-limit", limit])
    assert ended.value.code == ExitCode.USAGE
