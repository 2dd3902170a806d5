"""The page docs/scale.md, written from the tally of simulated clusters and of what cells take."""

from collections.abc import Iterator

from benchmarks.studies.scale_tally import (
    CellCost,
    CellKind,
    CellTally,
    ClusterRow,
    ScaleTally,
)
from mjbench.report import markdown


def page(tally: ScaleTally, measured: CellTally) -> str:
    """Return the Markdown page of a tally, with what cells take beside it."""
    return "\n".join(_lines(tally, measured)) + "\n"


def row_line(row: ClusterRow) -> str:
    """Return how one cluster did, in a line that shows progress."""
    return (
        f"{row.nodes} nodes: {row.hours:.1f} h, efficiency {100 * row.efficiency:.0f} %,"
        f" driver busy {100 * row.driver_share:.2f} %"
    )


def _lines(tally: ScaleTally, measured: CellTally) -> Iterator[str]:
    yield "# What a cluster would do"
    yield ""
    yield _conclusion(tally)
    yield ""
    yield (
        "Written by `python -m benchmarks.studies.sweep_simulation` from `results/cells.json`,"
        " `results/sweep.json` and `results/scale.json`; do not edit. Costs are measured; clusters"
        " are simulated."
    )
    yield ""
    yield from _measured(measured)
    yield ""
    yield from _matrix(tally)
    yield ""
    yield from _clusters(tally)
    yield ""
    yield from _driver(tally, measured)
    yield from _tasks(tally)
    yield ""
    yield from _storage(tally, measured)
    yield ""
    yield from _assumptions(tally)
    yield from _HOW


def _conclusion(tally: ScaleTally) -> str:
    size, most = tally.size, max(tally.rows, key=lambda row: row.nodes)
    hours = sum(kind.node_hours for kind in tally.kinds)
    cells = sum(kind.cells for kind in tally.kinds)
    text = (
        f"{size.models} models on {size.processors} processors need {cells:,} results: for each"
        f" model and processor, {size.releases - 1} verdicts, {size.releases} counts of"
        f" instructions and one comparison. They take {hours:,.0f} node hours. In simulation, a"
        f" cluster of {most.nodes} nodes, {most.nodes // most.processors} of each processor, has"
        f" all of them after {_hours(most.hours)}."
    )
    whole = [row for row in tally.rows if row.processors == size.processors]
    night = [row for row in whole if row.night_cells < row.cells]
    if night:
        largest = max(night, key=lambda row: row.nodes)
        text += (
            f" In a night of eight hours, {largest.nodes} nodes measure"
            f" {_percent(largest.night_cells / largest.cells)} of them."
        )
    return text


def _measured(measured: CellTally) -> Iterator[str]:
    yield "## What a result costs"
    yield ""
    yield (
        f"Seconds for a verdict by time on {measured.old} → {measured.new}, for counting the"
        " instructions of a step in one release, and for comparing the paths. In brackets, the"
        " further time of a command, however many results it measures. Measured by `python -m"
        f" benchmarks.cell_cost` on {measured.date}, on {measured.usable_cores} cores of"
        f" {measured.processor}. A verdict may take 60 s: one that took as long was not certain"
        " by then."
    )
    yield ""
    by_model: dict[str, dict[CellKind, CellCost]] = {}
    for cell in sorted(measured.cells, key=lambda cell: cell.step_us):
        by_model.setdefault(cell.model, {})[cell.kind] = cell
    headings = ["model", "µs a step", *(f"{kind}, s" for kind in CellKind)]
    rows = (
        [
            f"`{model}`",
            _three_digits(next(iter(costs.values())).step_us),
            *(_cell(costs[kind]) for kind in CellKind),
        ]
        for model, costs in by_model.items()
    )
    yield from markdown.table(headings, rows, headings[1:])


def _cell(cost: CellCost) -> str:
    return f"{cost.cell_s:.0f}" + (f" ({cost.start_s:.0f})" if cost.start_s else "")


def _matrix(tally: ScaleTally) -> Iterator[str]:
    size = tally.size
    yield "## What the matrix costs"
    yield ""
    yield (
        "Verdicts compare each other release with the newest. A node runs as many counts at once as"
        " it has cores, but only one verdict or comparison."
    )
    yield ""
    headings = ["", "results", "node hours", "node hours of one processor"]
    rows = [
        [
            kind.kind.value,
            f"{kind.cells:,}",
            f"{kind.node_hours:,.0f}",
            f"{kind.node_hours / size.processors:,.0f}",
        ]
        for kind in tally.kinds
    ]
    hours = sum(kind.node_hours for kind in tally.kinds)
    cells = sum(kind.cells for kind in tally.kinds)
    rows.append(["all", f"{cells:,}", f"{hours:,.0f}", f"{hours / size.processors:,.0f}"])
    yield from markdown.table(headings, rows, headings[1:])


def _clusters(tally: ScaleTally) -> Iterator[str]:
    size = tally.size
    yield "## What a cluster does in a night"
    yield ""
    yield (
        "The simulation uses the scheduler of `mjbench sweep`, and the"
        " [assumptions](#what-is-assumed) below. *Efficiency* is the share of node time in commands"
        " that succeeded; the rest is scheduling, calibration, refusals, lost work, and waiting for"
        " other nodes at the end. Some nodes are slower than others, so a cluster's efficiency is"
        " not that of its node hours. *Lost* is node time in commands that died with their node;"
        " results that were finished before survive. A cluster of one node has one processor, and"
        f" measures {_percent(1 / size.processors)} of the matrix. Each cluster was simulated once:"
        " how many commands die is chance."
    )
    yield ""
    headings = [
        "nodes",
        "results",
        "hours",
        "after 8 hours",
        "efficiency",
        "lost, node minutes",
        "commands that died",
        "refusals",
        "without a result",
    ]
    rows = (
        [
            f"{row.nodes:,}",
            f"{row.cells:,}",
            f"{row.hours:,.1f}",
            f"{row.night_cells:,} ({_percent(row.night_cells / row.cells)})",
            _percent(row.efficiency),
            f"{60 * row.lost_hours:,.0f}",
            f"{row.deaths:,}",
            f"{row.refusals:,}",
            f"{row.given_up:,}",
        ]
        for row in tally.rows
    )
    yield from markdown.table(headings, rows, headings)


def _driver(tally: ScaleTally, measured: CellTally) -> Iterator[str]:
    stored_ms = [1e3 * cell.store_s for cell in measured.cells]
    low, high = min(stored_ms), max(stored_ms)
    cost = tally.scheduling
    most = max(tally.rows, key=lambda row: row.nodes)
    yield "## One driver"
    yield ""
    yield (
        f"One process, the driver, hands out all commands and stores all results. Each command took"
        f" it {1e3 * cost.command_s:.1f} ms, each result {low:.1f} to {high:.1f} ms, as measured. A"
        f" node starts a command {cost.handover_s:.2f} s after it was handed out, and"
        f" {cost.calibration_s:.1f} s later if it calibrates first. In the simulation of"
        f" {most.nodes} nodes, the driver is busy for {100 * most.driver_share:.2f} % of the time,"
        f" and nothing waits for it longer than {most.longest_wait_s:.1f} s. With about"
        f" {_two_digits(most.nodes_of_a_busy_driver)} nodes it would be busy all the time, and"
        " become the bottleneck."
    )


def _tasks(tally: ScaleTally) -> Iterator[str]:
    headings = ["local Ray nodes", "ms until a node has answered", "ms of the driver"]
    rows = (
        [f"{task.nodes}", f"{1e3 * task.latency_s:.1f}", f"{1e3 * task.driver_s:.1f}"]
        for task in tally.scheduling.tasks
    )
    yield ""
    yield "Measured overhead of a command that does nothing:"
    yield ""
    yield from markdown.table(headings, rows, headings)


def _storage(tally: ScaleTally, measured: CellTally) -> Iterator[str]:
    written = sum(kind.result_bytes for kind in tally.kinds)
    installs = tally.size.releases * measured.install_bytes
    yield "## Storage"
    yield ""
    yield (
        f"The run set of the whole matrix takes {written / 2**30:.1f} GiB, estimated from measured"
        f" results. Each node installs {tally.size.releases} releases, which take"
        f" {installs / 2**30:.1f} GiB: {measured.install_bytes / 2**20:.0f} MiB each, the mean of"
        " the two measured ones."
    )


def _assumptions(tally: ScaleTally) -> Iterator[str]:
    assumed = tally.assumptions
    yield "## What is assumed"
    yield ""
    yield "These values were not measured:"
    yield ""
    yield (
        f"- {tally.size.models} models are an assumption, about as many as the"
        " [foreign ones](foreign.md) that were tried. Each costs as much as one of those above,"
        " drawn at random, and each pair of releases as much as the one that was measured."
    )
    yield "- All processors are as fast as the one that was measured, and all nodes have its cores."
    yield (
        f"- The time that nodes take differs by {_percent(assumed.slowness_deviation)} (standard"
        " deviation of its logarithm)."
    )
    yield f"- A node refuses {_percent(assumed.refusals)} of the commands that need it quiet."
    yield (
        f"- A node dies at random, every {assumed.hours_between_deaths:g} hours on average. The"
        f" driver notices after {assumed.detection_s:g} s, and the node is back after"
        f" {assumed.outage_s / 60:g} minutes."
    )
    yield "- The releases are installed before the sweep begins."
    yield f"- The random seed is {tally.seed}. The same seed gives the same page."


def _hours(hours: float) -> str:
    return f"{hours:.1f} hours"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):,g}"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):,.0f}"


_HOW = """
## Run it again

`python -m benchmarks.studies.sweep_simulation` takes half a minute. Its inputs come from
`python -m benchmarks.cell_cost` and `python -m benchmarks.sweep_cost`; run nothing else beside
them.""".splitlines()
