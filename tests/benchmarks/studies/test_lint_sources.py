"""Findings in sources are counted, and new ones are to be read."""

from pathlib import Path

import pytest

from benchmarks.studies import foreign_packages, lint_sources, tally_file
from benchmarks.studies.foreign_packages import Package
from benchmarks.studies.lint_sources import LintTally, SourceFinding
from benchmarks.studies.page_part import PagePart
from mjbench.status import ExitCode

PACKAGE = Package("robots", "1.0")
LOOP = """
import mujoco
for _ in range(1000):
    mujoco.mj_step(model, data)
    log.append(data.qpos)
"""


def test_a_finding_is_refused_until_it_was_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/loop.py").write_text(LOOP)
    page = tmp_path / "page.md"
    page.write_text("<!-- sources: written by a test -->\n<!-- end -->\n")
    monkeypatch.setattr(foreign_packages, "fetch", lambda package, cache: tmp_path / "robots")
    monkeypatch.setattr(lint_sources, "PACKAGES", (PACKAGE,))
    monkeypatch.setattr(lint_sources, "TALLY", tmp_path / "tally.json")
    monkeypatch.setattr(lint_sources, "PART", PagePart(str(page), "sources", "a test"))
    for _ in range(2):
        assert lint_sources.main([]) == ExitCode.FINDING
        assert capsys.readouterr().out == "robots==1.0: loop.py:5 MJB001: read it\n"
    assert lint_sources.main(["--read"]) == ExitCode.OK
    capsys.readouterr()
    assert lint_sources.main([]) == ExitCode.OK
    assert capsys.readouterr().out == ""
    tally = tally_file.load(tmp_path / "tally.json", LintTally, "lint")
    assert [*tally] == [(PACKAGE, SourceFinding("loop.py", 5, "MJB001"))]
    assert (
        "In 1 Python files of robots (releases in `results/tally.json`), lint has 1 findings"
        in page.read_text()
    )


def test_the_page_has_the_committed_tally() -> None:
    tally = tally_file.load(lint_sources.TALLY, LintTally, "lint")
    assert lint_sources.PART.text().splitlines() == [*lint_sources.lines(tally)]
