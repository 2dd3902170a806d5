"""What observing costs: the program counts its steps on each side, and windows are paired."""

import pytest

from benchmarks.studies import observing
from benchmarks.studies.programs import side
from benchmarks.studies.programs.side import ALONE, ENDED, IN_TRANSIT, OBSERVED, Side
from mjbench.errors import MachineError
from mjbench.status import ExitCode


def test_a_program_prints_the_steps_that_it_took_on_each_side(tmp_path, capsys):
    file = tmp_path / "side"
    file.write_bytes(bytes([ALONE]))
    of_program, changer = Side(file), Side(file)
    # of blocks that begin on one side and end on another, no step counts
    sides = iter([ALONE, ALONE, IN_TRANSIT, OBSERVED, OBSERVED, IN_TRANSIT, ENDED])

    def block():
        changer.change(next(sides))
        return 10

    of_program.run(block)
    *windows, total = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [(int(which), int(nstep)) for which, _, nstep in windows] == [
        (ALONE, 20),
        (OBSERVED, 10),
    ]
    assert sum(float(seconds) for _, seconds, _ in windows) <= float(total[0])


def test_the_engines_own_function_steps_where_the_program_is_alone(tmp_path, monkeypatch):
    file = tmp_path / "side"
    file.write_bytes(bytes([ALONE]))
    of_program = Side(file)

    def replacement():
        """Stand for the engine's function."""

    replacement.__wrapped__ = side.mujoco.mj_step
    monkeypatch.setattr(side.mujoco, "mj_step", replacement)
    assert of_program.step is replacement.__wrapped__
    of_program.change(OBSERVED)
    assert of_program.step is replacement


def test_only_windows_that_follow_each_other_are_compared():
    windows = [
        observing.Window(which, step_s)
        for which, step_s in [
            (OBSERVED, 9),
            (ALONE, 1),
            (OBSERVED, 2),
            (ALONE, 8),
            (ALONE, 3),
            (OBSERVED, 6),
        ]
    ]
    assert observing.pairs_of(windows) == [(1, 2), (3, 6)]


def test_a_failure_is_a_line(monkeypatch, capsys):
    def observe(*_):
        raise MachineError("mjbench run failed")

    monkeypatch.setattr(observing, "observe", observe)
    assert observing.main(["processes"]) == ExitCode.ENVIRONMENT
    assert "observing: mjbench run failed" in capsys.readouterr().err


@pytest.mark.parametrize("name", observing.PROGRAMS)
def test_each_program_has_its_file(name):
    assert observing.program_of(name).is_file()
