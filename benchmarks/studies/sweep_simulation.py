"""What the full matrix would cost, and what a cluster does of it in a night, simulated.

    python -m benchmarks.studies.sweep_simulation [--page]

reads what cells take from results/cells.json (`python -m benchmarks.cell_cost`), and what handing
them out takes from results/sweep.json (`python -m benchmarks.sweep_cost`). It simulates clusters
from 1 to 100 nodes with the scheduler of `mjbench sweep`, and writes results/scale.json and
docs/scale.md. It takes half a minute, whatever else runs. `--page` only writes the page again.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.studies import scale_page, tally_command, tally_file
from benchmarks.studies.scale_tally import (
    Assumptions,
    CellCost,
    CellKind,
    CellTally,
    ClusterRow,
    KindCost,
    MatrixSize,
    ScaleTally,
    SchedulingCost,
    load_cells,
    load_scale,
    load_scheduling,
)
from benchmarks.studies.simulated_cluster import SimulatedNode, Work, simulate
from mjbench.paired.outcomes import Metric
from mjbench.paths import BASE
from mjbench.status import ExitCode
from mjbench.sweep.cells import Cell, Kind
from mjbench.sweep.commands import COMMANDS
from mjbench.sweep.scheduler import Node

ROOT = Path(__file__).resolve().parents[2]
CELLS, SCHEDULING = ROOT / "results" / "cells.json", ROOT / "results" / "sweep.json"
TALLY, PAGE = ROOT / "results" / "scale.json", ROOT / "docs" / "scale.md"
# Nodes of each processor. One node has one processor; all others have every processor.
NODES = (1, 4, 8, 20, 40, 100)
NIGHT_S = 8 * 3600.0
SEED = 0
# The kinds of cells, by what a sweep calls them.
_SWEEP_KIND = {
    CellKind.VERDICT: Kind.VERSIONS,
    CellKind.COUNT: Kind.INSTRUCTIONS,
    CellKind.COMPARISON: Kind.COMPARE,
}
_KIND_OF = {kind: own for own, kind in _SWEEP_KIND.items()}


@dataclass(frozen=True)
class Matrix:
    """The full matrix, and which measured model each of its models is like.

    Attributes:
      size: of the matrix.
      like: name of a measured model for each model.
      costs: by kind and measured model.
    """

    size: MatrixSize
    like: Sequence[str]
    costs: Mapping[tuple[CellKind, str], CellCost]

    @classmethod
    def drawn(cls, size: MatrixSize, tally: CellTally, seed: int) -> "Matrix":
        """Return a matrix whose models are like measured ones, drawn at random."""
        names = list(dict.fromkeys(cell.model for cell in tally.cells))
        like = np.random.default_rng([seed, 0]).choice(names, size.models).tolist()
        return cls(size, like, {(cell.kind, cell.model): cell for cell in tally.cells})

    def cells(self, labels: Sequence[str]) -> list[Cell]:
        """Return all cells of processors with these labels."""
        models, releases = range(self.size.models), range(self.size.releases)
        newest = str(releases[-1])
        cells: list[Cell] = []
        for label in labels:
            for model in models:
                cells += [
                    Cell(
                        Kind.VERSIONS,
                        str(model),
                        str(release),
                        newest,
                        path=BASE,
                        metric=Metric.TIME,
                        machine=label,
                    )
                    for release in releases[:-1]
                ]
            for model in models:
                cells += [
                    Cell(Kind.INSTRUCTIONS, str(model), str(release), "0", machine=label)
                    for release in releases
                ]
            cells += [Cell(Kind.COMPARE, str(model), machine=label) for model in models]
        return cells

    def cost(self, cell: Cell) -> CellCost:
        """Return what a cell takes."""
        return self.costs[_KIND_OF[cell.kind], self.like[int(cell.model)]]

    def start_s(self, cell: Cell) -> float:
        """Return what the command of a cell takes beside its cells.

        A command that counts counts its first release once more, which draws the start states.
        """
        cost = self.cost(cell)
        return cost.start_s + (cost.cell_s if cost.kind == CellKind.COUNT else 0.0)

    def kind_costs(self, cores: int) -> list[KindCost]:
        """Return what all cells of each kind take, in commands as large as a sweep makes them.

        Args:
          cores: of a node, which runs as many counts at once.
        """
        processors, rows = self.size.processors, []
        all_cells = self.cells([""])
        for kind in CellKind:
            command = COMMANDS[_SWEEP_KIND[kind]]
            cells = [cell for cell in all_cells if cell.kind == _SWEEP_KIND[kind]]
            together: dict[tuple[str, ...], list[Cell]] = {}
            for cell in cells:
                together.setdefault(command.together(cell), []).append(cell)
            first = [
                group[i] for group in together.values() for i in range(0, len(group), command.most)
            ]
            seconds = sum(map(self.start_s, first)) + sum(self.cost(cell).cell_s for cell in cells)
            written = sum(self.cost(cell).cell_bytes for cell in cells)
            share = 1 if command.needs_quiet else cores
            rows.append(
                KindCost(
                    kind,
                    processors * len(cells),
                    processors * seconds / 3600 / share,
                    processors * written,
                )
            )
        return rows


def simulated(
    matrix: Matrix,
    nodes: int,
    cores: int,
    scheduling: SchedulingCost,
    assumptions: Assumptions,
    seed: int,
) -> ClusterRow:
    """Return how a sweep of the matrix goes on a cluster.

    Args:
      matrix: to measure.
      nodes: of the cluster; fewer than there are processors have one processor.
      cores: of each node.
      scheduling: what handing out takes.
      assumptions: how nodes differ, refuse and die.
      seed: of what is drawn.
    """
    processors = matrix.size.processors if nodes >= matrix.size.processors else 1
    labels = [f"processor {i}" for i in range(processors)]
    cells = matrix.cells(labels)
    slowness = np.random.default_rng([seed, 1]).normal(0, assumptions.slowness_deviation, nodes)
    members = [
        SimulatedNode(
            Node(str(i), f"node {i}", str(i), labels[i % processors], cores), math.exp(each)
        )
        for i, each in enumerate(slowness.tolist())
    ]
    work = Work(
        matrix.start_s,
        lambda cell: matrix.cost(cell).cell_s,
        lambda cell: matrix.cost(cell).store_s,
    )
    course = simulate(cells, members, work, scheduling, assumptions, seed)
    return ClusterRow(
        nodes=nodes,
        processors=processors,
        cells=len(cells),
        hours=course.end_s / 3600,
        night_cells=sum(time_s <= NIGHT_S for _, time_s in course.delivered),
        node_hours=course.work_s / 3600,
        lost_hours=course.lost_s / 3600,
        deaths=course.deaths,
        refusals=course.refusals,
        given_up=len(course.given_up),
        commands=course.commands,
        driver_share=course.driver_s / course.end_s,
        longest_wait_s=course.longest_wait_s,
    )


def run() -> ScaleTally:
    """Simulate all clusters, and write the tally and the page."""
    size, assumptions = MatrixSize(), Assumptions()
    measured, scheduling = load_cells(CELLS), load_scheduling(SCHEDULING)
    matrix = Matrix.drawn(size, measured, SEED)
    rows = []
    for nodes in NODES:
        cores = measured.usable_cores
        rows.append(simulated(matrix, nodes, cores, scheduling, assumptions, SEED))
        print(scale_page.row_line(rows[-1]), flush=True)
    kinds = matrix.kind_costs(measured.usable_cores)
    tally = ScaleTally(size, scheduling, assumptions, SEED, kinds, rows)
    TALLY.write_text(tally_file.dumps(tally), encoding="utf-8")
    write_page(tally, measured)
    return tally


def write_page(tally: ScaleTally, measured: CellTally) -> None:
    """Write the page of a tally."""
    PAGE.write_text(scale_page.page(tally, measured), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", action="store_true", help="only write the page again")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        if options.page:
            write_page(load_scale(TALLY), load_cells(CELLS))
        else:
            run()
        return ExitCode.OK

    return tally_command.run("sweep_simulation", action, "nothing was written")


if __name__ == "__main__":
    sys.exit(main())
