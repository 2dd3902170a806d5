"""Check-ups beside longer commands: the commands, the page, and what is measured again."""

from pathlib import Path
from typing import Any

import pytest
from set_files import run_of

from benchmarks.studies import checkups, tally_file
from benchmarks.studies.checkup_tally import CheckupTally, CheckupTrial
from benchmarks.studies.checkups import Target
from benchmarks.studies.page_part import of_lines
from mjbench.commands.checkup.result import CheckedPart, CheckupPart
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.tune.result import TuneRecord
from mjbench.errors import InputError, MachineError
from mjbench.results.runs import Run
from mjbench.status import ExitCode

HOPPER, ANT = (Target(name, TargetKind.ENVIRONMENT) for name in ("Hopper-v5", "Ant-v5"))


def test_runs_of_commands_are_the_parts_of_a_checkup() -> None:
    record = TuneRecord(model="m")
    whole = checkups.as_checkup(
        HOPPER, [("compare", run_of("compare")), ("tune", run_of("tune", record))]
    )
    parts = whole.of_type(CheckedPart)
    assert [part.part for part in parts] == [CheckupPart.PATHS, CheckupPart.SETTINGS]
    assert whole.of_type(TuneRecord) == [record]


def test_arguments_of_a_program_follow_it_in_every_command() -> None:
    target = Target("mujoco:rollout.py", TargetKind.PROGRAM, ("--nstep", "9"))
    assert target.checkup == (target.word, "--nstep", "9")
    assert target.closer == (("run", ("--seconds", "60s", target.word, "--nstep", "9")),)
    assert target.copied.is_file()
    assert target.word == "rollout.py"
    with pytest.raises(InputError, match="robots is not installed"):
        _ = Target("robots:train.py", TargetKind.PROGRAM).word


def test_a_target_whose_command_fails_has_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def failed(target: Target, command: str, arguments: Any) -> Run:
        raise MachineError(f"no {arguments[0]}")

    monkeypatch.setattr(checkups, "_measured", failed)
    trial = checkups.measure(HOPPER)
    assert trial.detail == "no Hopper-v5"
    assert not trial.is_right


def test_what_the_tally_has_is_measured_again_only_where_it_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measured = []

    def measure(target: Target) -> CheckupTrial:
        measured.append(target.name)
        return CheckupTrial(name=target.name, kind=target.kind, seconds=9.0, again=1.0)

    monkeypatch.setattr(checkups, "measure", measure)
    monkeypatch.setattr(checkups, "TARGETS", (HOPPER, ANT))
    monkeypatch.setattr(checkups, "TALLY", tmp_path / "checkups.json")
    assert checkups.run(["Ant-v5"], writes_page=False) == ExitCode.OK
    checkups.run([], writes_page=False)
    checkups.run(["Ant-v5"], writes_page=False)
    assert measured == ["Ant-v5", "Hopper-v5", "Ant-v5"]


def test_the_page_has_the_committed_results() -> None:
    tally = CheckupTally("", "", 0, ())
    if checkups.TALLY.exists():
        tally = tally_file.load(checkups.TALLY, CheckupTally, "check-ups")
    assert checkups.PART.text() == of_lines(tally.lines())
