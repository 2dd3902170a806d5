"""The simulation of a cluster: every cell once, whatever nodes do, and the page written from it."""

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import cell_cost
from benchmarks.studies import scale_page, sweep_simulation, tally_command, tally_file
from benchmarks.studies.scale_tally import (
    Assumptions,
    CellCost,
    CellKind,
    CellTally,
    MatrixSize,
    ScaleTally,
    SchedulingCost,
    load_cells,
    load_scale,
    load_scheduling,
)
from benchmarks.studies.simulated_cluster import Course, SimulatedNode, Work, simulate
from benchmarks.studies.sweep_simulation import Matrix
from mjbench.errors import InputError
from mjbench.instrument.runs import to_json
from mjbench.paired.outcomes import Metric
from mjbench.status import ExitCode
from mjbench.sweep.cells import Cell, Kind
from mjbench.sweep.scheduler import Node

SCHEDULING = SchedulingCost(handover_s=2.0, calibration_s=1.0, command_s=0.0)
CALM = Assumptions(slowness_deviation=0.0, refusals=0.0, hours_between_deaths=math.inf)
ROUGH = Assumptions(refusals=0.2, hours_between_deaths=0.2, detection_s=30.0, outage_s=60.0)
WORK = Work(lambda cell: 3.0, lambda cell: 10.0, store_s=lambda cell: 0.0)
COSTS = [
    CellCost(kind, model, step_us=5.0, start_s=start, cell_s=each, cell_bytes=1000, store_s=0.0)
    for model, factor in (("light", 1.0), ("heavy", 2.0))
    for kind, start, each in (
        (CellKind.VERDICT, 3.0, 20.0 * factor),
        (CellKind.COUNT, 2.0, 30.0 * factor),
        (CellKind.COMPARISON, 0.0, 60.0 * factor),
    )
]
MEASURED = CellTally("2026-01-02", "a processor", 2, "3.3.0", "4.0.0", 160 << 20, COSTS)
SMALL = MatrixSize(models=3, releases=10, processors=2)


def verdicts(models: int, releases: int, labels: str = "") -> list[Cell]:
    return [
        Cell(
            Kind.VERSIONS,
            str(model),
            str(release),
            "newest",
            path="python_loop",
            metric=Metric.TIME,
            machine=label,
        )
        for label in labels or [""]
        for release in range(releases)
        for model in range(models)
    ]


def nodes(count: int, labels: Sequence[str] = ("",), cores: int = 1) -> list[SimulatedNode]:
    return [
        SimulatedNode(Node(str(i), f"node {i}", str(i), labels[i % len(labels)], cores))
        for i in range(count)
    ]


def measured_once(course: Course, cells: Sequence[Cell]) -> bool:
    """Return whether each cell has one result, or was given up, and not both."""
    ended = [*(cell for cell, _ in course.delivered), *course.given_up]
    return len(ended) == len(cells) and set(ended) == set(cells)


def test_one_node_takes_as_long_as_its_commands() -> None:
    cells = verdicts(models=5, releases=2)
    course = simulate(cells, nodes(1), WORK, SCHEDULING, CALM)
    each = 2.0 + 1.0 + 3.0 + 5 * 10.0
    assert course.end_s == pytest.approx(2 * each)
    assert course.work_s == pytest.approx(2 * (3.0 + 5 * 10.0))
    assert (course.commands, course.deaths, course.refusals, course.lost_s) == (2, 0, 0, 0.0)
    assert [cell for cell, _ in course.delivered] == cells


def test_a_slow_node_takes_longer() -> None:
    slow = [SimulatedNode(nodes(1)[0].node, slowness=2.0)]
    course = simulate(verdicts(5, 1), slow, WORK, SCHEDULING, CALM)
    assert course.end_s == pytest.approx(2.0 + 1.0 + 2 * (3.0 + 5 * 10.0))


def test_counts_run_beside_each_other_and_need_no_calibration() -> None:
    cells = [Cell(Kind.INSTRUCTIONS, str(m), str(r), "0") for m in range(2) for r in range(4)]
    course = simulate(cells, nodes(1, cores=2), WORK, SCHEDULING, CALM)
    assert course.end_s == pytest.approx(2.0 + 3.0 + 4 * 10.0)
    assert course.work_s == pytest.approx(3.0 + 4 * 10.0), "each has half of the node"


@pytest.mark.parametrize("seed", range(8))
def test_each_cell_is_measured_once_while_nodes_die_and_refuse(seed: int) -> None:
    cells = verdicts(models=10, releases=20, labels="ab")
    course = simulate(cells, nodes(6, "ab"), WORK, SCHEDULING, ROUGH, seed)
    assert measured_once(course, cells)
    assert course.deaths > 0
    assert course.refusals > 0
    assert course.lost_s > 0
    times = [time_s for _, time_s in course.delivered]
    assert times == sorted(times)


def test_the_same_seed_gives_the_same_course_and_another_one_does_not() -> None:
    courses = [
        simulate(verdicts(5, 10), nodes(3), WORK, SCHEDULING, ROUGH, seed) for seed in (1, 1, 2)
    ]
    assert courses[0] == courses[1]
    assert courses[0].end_s != courses[2].end_s


def test_what_a_node_delivered_before_it_died_is_not_lost() -> None:
    """A node dies within every second command: its results before that are not measured again."""
    cells = verdicts(models=8, releases=3)
    often = replace(CALM, hours_between_deaths=0.05)
    course = simulate(cells, nodes(1), WORK, SCHEDULING, often, seed=3)
    assert course.deaths > 0
    assert measured_once(course, cells)
    assert course.lost_s <= course.deaths * (3.0 + 10.0)


def test_a_label_is_measured_by_its_own_nodes() -> None:
    cells = verdicts(models=4, releases=8, labels="ab")
    course = simulate(cells, nodes(3, "aab"), WORK, SCHEDULING, CALM)
    ends = {
        label: max(time_s for cell, time_s in course.delivered if cell.machine == label)
        for label in "ab"
    }
    assert measured_once(course, cells)
    assert ends["b"] > 1.5 * ends["a"]


def test_a_driver_that_is_busy_all_the_time_decides_how_long_it_takes() -> None:
    cells = verdicts(models=1, releases=200)
    slow_driver = replace(SCHEDULING, command_s=5.0)
    course = simulate(cells, nodes(100), WORK, slow_driver, CALM)
    assert course.commands == 200
    assert course.driver_s == pytest.approx(200 * 5.0)
    assert course.driver_s / course.end_s > 0.98
    assert course.longest_wait_s >= 100 * 5.0


def test_no_node_leaves_no_results() -> None:
    course = simulate(verdicts(1, 1), [], WORK, SCHEDULING, CALM)
    assert (course.delivered, course.end_s) == ([], 0.0)


# the matrix


def test_the_full_matrix_has_as_many_results_as_its_size_says() -> None:
    matrix = Matrix.drawn(SMALL, MEASURED, seed=0)
    cells = matrix.cells(["a", "b"])
    assert len(set(cells)) == len(cells) == 2 * sum(map(SMALL.cells, CellKind))
    assert sum(MatrixSize().processors * MatrixSize().cells(kind) for kind in CellKind) == 111_216


def test_each_model_of_the_matrix_is_like_a_measured_one() -> None:
    matrix = Matrix.drawn(MatrixSize(models=50), MEASURED, seed=0)
    assert set(matrix.like) == {"light", "heavy"}
    cell = Cell(Kind.COMPARE, str(matrix.like.index("heavy")))
    assert matrix.cost(cell).cell_s == 120.0


def test_a_calm_cluster_works_as_many_hours_as_the_matrix_costs() -> None:
    one = replace(SMALL, processors=1)
    matrix = Matrix.drawn(one, MEASURED, seed=0)
    row = sweep_simulation.simulated(matrix, 1, 2, SCHEDULING, CALM, seed=0)
    costs = matrix.kind_costs(cores=2)
    assert row.node_hours == pytest.approx(sum(kind.node_hours for kind in costs))
    assert row.cells == sum(kind.cells for kind in costs)
    assert (row.given_up, row.lost_hours) == (0, 0.0)
    assert 0.8 < row.efficiency < 1.0


def test_a_larger_cluster_is_done_earlier_and_has_more_after_a_night() -> None:
    size = MatrixSize(models=60, releases=42, processors=2)
    matrix = Matrix.drawn(size, MEASURED, seed=0)
    rows = [
        sweep_simulation.simulated(matrix, count, 2, SCHEDULING, CALM, seed=0)
        for count in (2, 4, 8)
    ]
    for small, large in itertools.pairwise(rows):
        assert large.hours < small.hours
        assert large.night_cells > small.night_cells
        assert large.night_cells <= large.cells == small.cells


# the page


def test_the_page_says_what_is_measured_what_is_simulated_and_what_is_assumed() -> None:
    matrix = Matrix.drawn(SMALL, MEASURED, seed=0)
    cost = SchedulingCost(handover_s=2.0, calibration_s=1.0, command_s=0.02)
    rows = [sweep_simulation.simulated(matrix, count, 2, cost, ROUGH, seed=0) for count in (1, 4)]
    tally = ScaleTally(SMALL, cost, ROUGH, 0, matrix.kind_costs(cores=2), rows)
    lines = scale_page.page(tally, MEASURED).splitlines()
    assert lines[2].startswith("3 models on 2 processors need 120 results: for each model")
    assert "Costs are measured; clusters are simulated." in lines[4]
    assert "| `heavy` | 5 | 40 (3) | 60 (2) | 120 |" in lines
    assert any(line.startswith("- A node refuses 20 % of the commands") for line in lines)
    assert "## Storage" in lines


def test_the_page_is_written_from_the_committed_tallies() -> None:
    tally = load_scale(sweep_simulation.TALLY)
    measured = load_cells(sweep_simulation.CELLS)
    assert sweep_simulation.PAGE.read_text(encoding="utf-8") == scale_page.page(tally, measured)
    assert json.loads(sweep_simulation.TALLY.read_text(encoding="utf-8")) == to_json(tally)
    assert [row.nodes for row in tally.rows] == list(sweep_simulation.NODES)
    assert tally.size == MatrixSize()


def test_what_handing_out_takes_is_read_from_the_committed_costs_of_a_sweep() -> None:
    cost = load_scheduling(sweep_simulation.SCHEDULING)
    assert cost.handover_s == cost.tasks[-1].latency_s
    assert cost.command_s > cost.tasks[-1].driver_s


def test_a_model_cannot_be_measured_in_other_releases_than_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = tmp_path / "cells.json"
    cells.write_text(tally_file.dumps(MEASURED))
    monkeypatch.setattr(cell_cost, "TALLY", cells)
    monkeypatch.setattr("shutil.which", lambda name: name)
    with pytest.raises(InputError, match=r"cells\.json is of 3\.3\.0 and 4\.0\.0"):
        cell_cost.run(["cartpole"], "3.5.0", "4.0.0")


def test_one_kind_can_be_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = tmp_path / "cells.json"
    cells.write_text(tally_file.dumps(replace(MEASURED, old="3.3.0", new="4.0.0")))
    model = MEASURED.cells[0].model
    monkeypatch.setattr(cell_cost, "TALLY", cells)
    monkeypatch.setattr("shutil.which", lambda name: name)
    monkeypatch.setattr(cell_cost.models, "shipped", lambda: [model])
    monkeypatch.setattr(cell_cost, "_install_bytes", lambda release: 100)

    def measured(model: str, old: str, new: str, kind: CellKind, step_us: float | None) -> CellCost:
        return CellCost(kind, model, step_us or 0.0, 1.0, 2.5, 10, 0.1)

    monkeypatch.setattr(cell_cost, "measured", measured)
    tally = cell_cost.run([], "3.3.0", "4.0.0", [CellKind.COUNT])
    earlier = {cell.kind: cell for cell in MEASURED.cells if cell.model == model}
    later = {cell.kind: cell for cell in tally.cells if cell.model == model}
    assert later[CellKind.COUNT].cell_s == 2.5
    assert later[CellKind.COUNT].step_us == earlier[CellKind.COMPARISON].step_us
    assert later[CellKind.VERDICT] == earlier[CellKind.VERDICT]
    cells.unlink()
    with pytest.raises(InputError, match="measure all kinds first"):
        cell_cost.run([model], "3.3.0", "4.0.0", [CellKind.COUNT])


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("no such model"), ExitCode.USAGE, "a_command: no such model"),
        (KeyboardInterrupt(), ExitCode.INTERRUPTED, "a_command: interrupted; nothing was written"),
    ],
)
def test_a_command_that_fails_says_so_in_a_line(
    capsys: pytest.CaptureFixture[str], error: BaseException, code: ExitCode, line: str
) -> None:
    def action() -> ExitCode:
        raise error

    assert tally_command.run("a_command", action, "nothing was written") == code
    assert capsys.readouterr().err == f"{line}\n"
