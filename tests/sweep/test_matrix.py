"""From a plan to cells, and from cells to the command line that measures them."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import click
import pytest
from example_models import CONTACT_XML
from sweep_examples import count_cell, plan, verdict_cell

from mjbench.cli import cli
from mjbench.cli.sweep import check_command
from mjbench.paired.metrics import Metric
from mjbench.releases.release_names import INSTALLED, ReleaseSpec
from mjbench.simulation import models
from mjbench.sweep import matrix, software
from mjbench.sweep.cells import Cell, CellKind
from mjbench.sweep.commands import COMMANDS, batches
from mjbench.sweep.plan import Plan

SPECS = tuple(ReleaseSpec(version, version) for version in ("3.3.0", "3.9.0", "4.0.0"))
EVERYTHING = plan(
    models=tuple(models.resolve(name) for name in ("cartpole", "pile")),
    releases=SPECS,
    pairs=((SPECS[0], SPECS[1]), (SPECS[0], SPECS[2])),
    paths=("python_loop", "rollout"),
    metrics=(Metric.TIME, Metric.P99),
    options=dict.fromkeys(CellKind, ()),
)
HERE = software.installed()


def cells(of: Plan) -> tuple[Cell, ...]:
    return matrix.build(of, HERE).cells


def test_every_combination_is_one_cell() -> None:
    counts = Counter((cell.kind, cell.metric) for cell in cells(EVERYTHING))
    assert counts == {
        (CellKind.VERSIONS, Metric.TIME): 2 * 2 * 2,
        (CellKind.VERSIONS, Metric.P99): 2 * 2,  # of the plain loop only
        (CellKind.COMPARE, None): 2,
        (CellKind.INSTRUCTIONS, None): 2 * 3,
        (CellKind.HISTORY, None): 2 * 3,
    }
    keys = [cell.key for cell in cells(EVERYTHING)]
    assert len(set(keys)) == len(keys)


def test_each_machine_measures_all_of_them() -> None:
    of_two = cells(replace(EVERYTHING, machines=("epyc", "xeon")))
    assert Counter(cell.machine for cell in of_two) == {"epyc": 26, "xeon": 26}


def test_a_longer_plan_keeps_the_keys_of_a_shorter_one() -> None:
    shorter = replace(EVERYTHING, models=EVERYTHING.models[:1], pairs=EVERYTHING.pairs[:1])
    assert {c.key for c in cells(shorter)} < {c.key for c in cells(EVERYTHING)}


@pytest.mark.parametrize("change", ["options", "numpy", "model"])
def test_what_changes_a_result_makes_it_another_cell(change: str, tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(CONTACT_XML)
    own = replace(EVERYTHING, models=(models.ModelSource("robot.xml", file),))
    before = {cell.key for cell in cells(own)}
    here = HERE
    match change:
        case "options":
            own = replace(own, options=dict.fromkeys(CellKind, ("--seed", "1")))
        case "numpy":
            here = replace(HERE, numpy="1.0")
        case "model":
            file.write_text(CONTACT_XML.replace("<mujoco>", "<mujoco model='changed'>"))
    assert before.isdisjoint(cell.key for cell in matrix.build(own, here).cells)


def test_another_mujoco_beside_mjbench_changes_only_what_it_measures() -> None:
    other = matrix.build(EVERYTHING, replace(HERE, mujoco="3.17.0")).cells
    changed = {c.kind for c, d in zip(cells(EVERYTHING), other, strict=True) if c.key != d.key}
    assert changed == {CellKind.COMPARE}


def test_the_verdicts_of_one_machine_are_decided_together() -> None:
    assert matrix.build(EVERYTHING, HERE).comparisons == 12
    assert matrix.build(replace(EVERYTHING, machines=("a", "b")), HERE).comparisons == 12


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (
            CellKind.VERSIONS,
            "versions --old 3.3.0 --new 3.9.0 --paths python_loop --metric time --seed 1"
            " --family 12 -- cartpole pile",
        ),
        (CellKind.COMPARE, "compare --seed 1 -- cartpole"),
        (
            CellKind.INSTRUCTIONS,
            "profile --instructions --release 3.3.0 --release 3.9.0 --release 4.0.0 --seed 1"
            " -- cartpole",
        ),
        (
            CellKind.HISTORY,
            "history measure --no-operations --model cartpole --model pile -- 3.3.0",
        ),
    ],
)
def test_what_belongs_together_is_one_command_line(kind: CellKind, expected: str) -> None:
    options = () if kind == CellKind.HISTORY else ("--seed", "1")
    whole = matrix.build(replace(EVERYTHING, options={**EVERYTHING.options, kind: options}), HERE)
    of_kind = [cell for cell in whole.cells if cell.kind == kind]
    command = COMMANDS[kind]
    together = [c for c in of_kind if command.together(c) == command.together(of_kind[0])]
    line = whole.command_line(together[: command.most])
    assert " ".join([*line.arguments, "--", *line.operands]) == expected
    check_command([*line.arguments, "--", *line.operands])  # mjbench takes it


@pytest.mark.parametrize(
    ("nodes", "sizes"),
    [
        ({"": 1}, [10, 10, 5, 10, 10, 5]),  # of two releases
        ({"": 2}, [10, 10, 5, 10, 10, 5]),
        ({"": 5}, [5, 5, 5, 5, 5, 5, 5, 5, 5, 5]),
        ({"": 100}, [1] * 50),
    ],
)
def test_more_nodes_get_smaller_commands(nodes: dict[str, int], sizes: list[int]) -> None:
    of_two = [verdict_cell(f"m{i}", r) for r in ("3.9.0", "4.0.0") for i in range(25)]
    commands = batches(of_two, nodes)
    assert [len(cells) for cells in commands] == sizes
    assert [cell for cells in commands for cell in cells] == of_two


def test_a_count_is_measured_with_others_however_many_nodes_there_are() -> None:
    counts = [count_cell("a", f"3.{i}.0") for i in range(8)]
    assert [len(cells) for cells in batches(counts, {"": 100})] == [4, 4]


def test_machines_measure_apart() -> None:
    of_two = [verdict_cell("a", machine=machine) for machine in ("epyc", "xeon")]
    assert batches(of_two, {"epyc": 1, "xeon": 1}) == [(of_two[0],), (of_two[1],)]


def test_the_release_installed_beside_mjbench_is_named_so() -> None:
    here = ReleaseSpec(INSTALLED, HERE.mujoco)
    whole = matrix.build(
        plan(releases=(SPECS[0], here), pairs=((SPECS[0], here),), options={CellKind.VERSIONS: ()}),
        HERE,
    )
    (cell,) = whole.cells
    assert cell.release == HERE.mujoco
    assert "--new installed" in " ".join(whole.command_line([cell]).arguments)


def test_counts_of_a_part_of_the_releases_are_of_the_same_work() -> None:
    whole = matrix.build(EVERYTHING, HERE)
    last = next(c for c in whole.cells if (c.kind, c.release) == (CellKind.INSTRUCTIONS, "4.0.0"))
    assert whole.command_line([last]).arguments == (
        *("profile", "--instructions", "--release", "3.3.0", "--release", "4.0.0"),
    )


def test_only_the_users_own_models_travel(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(CONTACT_XML)
    own = models.ModelSource("robot.xml", file)
    whole = matrix.build(replace(EVERYTHING, models=(*EVERYTHING.models, own)), HERE)
    assert list(whole.carried) == ["robot.xml"]
    assert whole.models_of([c for c in whole.cells if c.model == "pile"]) == []
    assert [m.name for m in whole.models_of(whole.cells)] == ["robot.xml"]


def test_every_option_that_a_plan_can_set_is_one_of_its_command() -> None:
    for command in COMMANDS.values():
        found: click.Command | None = cli
        words = list(command.name)
        while words and isinstance(found, click.Group):
            _, found, words = found.resolve_command(click.Context(found), words)
        assert found is not None
        options = {name for parameter in found.params for name in parameter.opts}
        assert {f"--{option}" for option in command.options} <= options
