"""The C program does what the paths do, and gets no figure beside a path that does not."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import python

from benchmarks.studies import c_floor, c_floor_page
from benchmarks.studies.c_floor_tally import FloorRow, LaunchTimes, Spread
from benchmarks.studies.page_part import of_lines
from mjbench import paths
from mjbench.errors import MachineError
from mjbench.simulation import models, reference_run, workload
from mjbench.verification.plan import choose_sizes

needs_compiler = pytest.mark.skipif(
    not shutil.which("cc"), reason="no C compiler (cc) on this machine"
)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_floor.build(tmp_path_factory.mktemp("c_floor"))


@pytest.fixture
def running(
    program: Path, tmp_path: Path, model: mujoco.MjModel
) -> Iterator[tuple[c_floor.CProgram, workload.Workload]]:
    random_workload = workload.make(model, nbatch=4, nstep=12, hold=3)
    with c_floor.CProgram(program, random_workload, tmp_path) as c_program:
        yield c_program, random_workload


@needs_compiler
@pytest.mark.parametrize("returns", list(workload.Product))
@pytest.mark.parametrize("has_timer", [False, True])
def test_the_c_program_reaches_the_same_states(
    program: Path, tmp_path: Path, returns: workload.Product, has_timer: bool, model: mujoco.MjModel
) -> None:
    random_workload = workload.make(model, nbatch=4, nstep=12, hold=3).returning(returns)
    with c_floor.CProgram(program, random_workload, tmp_path) as c_program:
        for _ in range(2):
            assert c_program.block_ns(has_timer) > 0
        final_states = c_program.final_states()
    np.testing.assert_array_equal(final_states, reference_run.observe(random_workload).final_state)


@needs_compiler
def test_a_path_that_reaches_other_states_is_refused(
    running: tuple[c_floor.CProgram, workload.Workload], model: mujoco.MjModel
) -> None:
    c_program, random_workload = running
    c_program.block_ns(has_timer=False)
    states = reference_run.observe(random_workload).final_state
    c_floor.check(paths.States(states), c_program.final_states(), model)
    states[2, 1] = np.nextafter(states[2, 1], 1.0)
    with pytest.raises(MachineError, match="the path disagrees with the C program"):
        c_floor.check(paths.States(states), c_program.final_states(), model)


def test_a_program_that_ends_by_itself_is_an_error(tmp_path: Path, model: mujoco.MjModel) -> None:
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\nread command\nexit 3\n")
    program.chmod(0o755)
    with (
        c_floor.CProgram(program, workload.make(model, nbatch=4, nstep=12), tmp_path) as c_program,
        pytest.raises(MachineError, match="the C program ended with status 3"),
    ):
        c_program.block_ns(has_timer=False)


@pytest.mark.parametrize("name", models.shipped())
def test_every_model_has_sizes_for_every_case(name: str) -> None:
    model = models.load(models.resolve(name))
    for hold in {case.hold for case in c_floor.CASES}:
        sizes = choose_sizes(reference_run.step_s(model), hold=hold)
        assert sizes.nbatch >= 1
        assert sizes.nstep >= hold
        assert sizes.nstep % hold == 0


@needs_compiler
def test_the_command_prints_four_times_and_two_ratios_for_each_model_and_path() -> None:
    """Run as users do, with `-m`: requests then travel from `__main__` to child processes."""
    command = (
        "import runpy, sys\n"
        "from benchmarks.studies import c_floor\n"
        "c_floor.CASES = c_floor.CASES[:1]\n"
        "sys.argv = ['c_floor', 'cube_table', '--budget', '0', '--launches', '1']\n"
        "runpy.run_module('benchmarks.studies.c_floor', run_name='__main__', alter_sys=True)\n"
    )
    completed = python("-W", "ignore", "-c", command)
    assert completed.returncode == 0, completed.stderr
    header, row = completed.stdout.splitlines()
    assert header == c_floor_page.HEADING
    assert re.fullmatch(r"cube_table +mj_step\(nstep=50\)( +[\d,]+){4}( +\d+\.\d{3}){2}", row)


def test_a_launch_that_fails_names_the_model_and_the_path(tmp_path: Path) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco>")
    source = models.resolve(str(tmp_path / "broken.xml"))
    request = c_floor.LaunchRequest(tmp_path / "no program", source, c_floor.CASES[1], 0.0)
    with pytest.raises(MachineError, match=r"broken\.xml, rollout: input: .*cannot load"):
        c_floor.launch(request)


def test_a_row_has_medians_of_its_launches_and_the_range_of_their_ratios() -> None:
    launches = [LaunchTimes(c_ns, 0, 0, 0, ratio, 1.0) for c_ns, ratio in ((1, 3), (2, 1), (9, 2))]
    row = FloorRow.of("robot", "rollout", launches)
    assert (row.c_ns, row.ratio) == (2, Spread(2, 1, 3))


def test_the_page_says_what_the_committed_figures_say() -> None:
    assert c_floor_page.PART.text() == of_lines(c_floor_page.lines(c_floor.stored()))


def test_blocks_take_turns_in_opposite_orders_until_the_budget_ends() -> None:
    order: list[int] = []
    blocks = {key: lambda key=key: order.append(key) or 10 * key for key in range(3)}
    # each of these blocks takes 0.1 s
    rows = c_floor.rounds(blocks, 3.05, clock=lambda: 0.1 * len(order))
    assert rows == [{0: 0, 1: 10, 2: 20}] * 10
    turns = [order[i : i + 3] for i in range(0, len(order), 3)]
    assert all(turns[i] == turns[i + 1][::-1] for i in range(0, 10, 2))
    assert len(c_floor.rounds(blocks, 0.0)) == c_floor.LEAST_ROUNDS
