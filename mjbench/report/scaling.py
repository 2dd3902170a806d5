"""What `mjbench compare --scaling` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mjbench.comparison import scaling
from mjbench.comparison.plan import Variant
from mjbench.comparison.scaling import ENOUGH, ScalingPoint, Stage
from mjbench.instrument.stats import Estimate
from mjbench.instrument.topology import Topology
from mjbench.report import comparison, tables
from mjbench.report.thread_advice import ScalingResults, ThreadAdvice
from mjbench.status import Status


def print_results(out: Console, results: ScalingResults, code: bool = False) -> None:
    """Print the search on one model: tables of each path, what hindered it, and the advice.

    Args:
      code: whether to print the Python of what is advised.
    """
    out.print()
    for line in comparison.heading_lines(results.records[0].model):
        out.print(line, soft_wrap=True)
    advice = results.advice()
    if advice:
        out.print(_topology_line(results.topology), soft_wrap=True)
    elif results.points:
        out.print("No advice: no path was timed with one thread.", soft_wrap=True)
    for row in advice:
        own = [point for point in results.points if point.variant.path == row.path]
        _print_path(out, own, row, results.topology)
    for line in problem_lines(results):
        out.print(line, soft_wrap=True)
    for row in advice:
        _print_advice(out, row, results.topology)
    if code:
        for row in advice:
            comparison.print_snippet(out, str(Variant(row.path, row.options)), row.snippet)


def _topology_line(topology: Topology) -> str:
    threads = f"{topology.hardware_threads} hardware thread{_s(topology.hardware_threads)}"
    parts = [f"This process may use {threads}"]
    if topology.cores is not None:
        parts.append(f"of {topology.cores} core{_s(topology.cores)}")
    if topology.node_sizes:
        parts.append(f"on {len(topology.node_sizes)} NUMA node{_s(len(topology.node_sizes))}")
    quota = "no quota"
    if topology.quota_cores is not None:
        quota = f"a quota of {tables.plain(topology.quota_cores, 3)} cores"
    return f"{' '.join(parts)}, with {quota}."


def _print_path(
    out: Console, own: Sequence[ScalingPoint], advice: ThreadAdvice, topology: Topology
) -> None:
    def section(stage: Stage) -> list[ScalingPoint]:
        return [point for point in own if point.stage == stage]

    out.print()
    heading = f"{advice.path}, numbers of threads"
    out.print(tables.headed(heading, f" ({advice.nbatch:,} simulations)"), soft_wrap=True)
    by_count = {point.nthread: point for point in section(Stage.THREADS)}
    out.print(_thread_table([by_count[count] for count in sorted(by_count)], topology))
    if chunks := section(Stage.CHUNK):
        heading = f"{advice.path}, chunk sizes"
        out.print(tables.headed(heading, f" ({advice.knee} threads)"), soft_wrap=True)
        out.print(_chunk_table([point for point in chunks if point.nthread == advice.knee]))
    if sizes := section(Stage.NBATCH):
        first = [p for p in section(Stage.THREADS) if p.nthread in (1, advice.knee)]
        out.print(tables.headed(f"{advice.path}, numbers of simulations", ""))
        out.print(_nbatch_table([*first, *sizes], advice.knee))


def _thread_table(points: Sequence[ScalingPoint], topology: Topology) -> Table:
    table = tables.plain_table(
        ["threads", "ns/step", "× plain", "× 1 thread", "efficiency", ""], right=range(5)
    )
    for point in points:
        table.add_row(
            str(point.nthread),
            f"{1e9 * point.step_s:,.0f}",
            tables.factor(point.speedup.median),
            _factor(point.over_one),
            _percent(point.efficiency),
            "; ".join(topology.beyond(point.nthread)),
        )
    return table


def _chunk_table(points: Sequence[ScalingPoint]) -> Table:
    table = tables.plain_table(["chunk", "ns/step", "× usual"], right=range(3))
    for point in sorted(points, key=lambda p: p.chunk or 0):
        table.add_row(
            "usual" if point.chunk is None else f"{point.chunk:,}",
            f"{1e9 * point.step_s:,.0f}",
            _factor(point.over_usual),
        )
    return table


def _nbatch_table(points: Sequence[ScalingPoint], count: int) -> Table:
    headings = ["simulations", "1 thread ns/step"]
    if count > 1:
        headings += [f"{count} threads ns/step", "× 1 thread", "efficiency"]
    headings.append("× plain")
    table = tables.plain_table(headings, right=range(len(headings)))
    for nbatch in sorted({point.nbatch for point in points}):
        of_size = {p.nthread: p for p in points if p.nbatch == nbatch}
        one, many = of_size.get(1), of_size.get(count)
        cells = [f"{nbatch:,}", "" if one is None else f"{1e9 * one.step_s:,.0f}"]
        if count > 1:
            cells += [
                f"{1e9 * many.step_s:,.0f}" if many else "",
                _factor(many.over_one if many else None),
                _percent(many.efficiency if many else None),
            ]
        table.add_row(*cells, tables.factor(many.speedup.median) if many else "")
    return table


def _factor(estimate: Estimate | None) -> str:
    """Return the cell of a speed-up; it has no interval, because one process cannot give one."""
    return "" if estimate is None else tables.factor(estimate.median)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


def problem_lines(results: ScalingResults) -> list[str | Text]:
    """Return what went wrong, and what a reader must know of the cores: each line once."""
    lines: dict[str, Text | str] = {}
    for record in results.records:
        if record.model.status not in (Status.OK, Status.INTERRUPTED):
            text = f"{record.stage}: {record.model.status}: {record.model.detail}"
            lines[text] = text
        for measurement in record.measurements:
            if measurement.detail and measurement.status != Status.UNAVAILABLE:
                variant = Variant(measurement.path, measurement.options)
                text = f"{variant}: {measurement.status}: {measurement.detail}"
                lines[text] = text
            elif measurement.detail:
                text = f"Not compared: {measurement.path}: {measurement.detail}"
                lines[text] = text
        most = max((p.nthread for p in scaling.points(record)), default=1)
        usable = min(record.model.usable_cores, most)
        had = [point.cores_had for point in scaling.points(record) if point.cores_had]
        if had and had[0] < comparison.POOR_CORES * usable:
            text = (
                f"Warning: threads had {had[0]:.2f} of {usable} cores in a run (calibration)."
                " Efficiencies allow for that; speed-ups are low by about as much."
            )
            lines["cores"] = Text(text, style="yellow")
    return list(lines.values())


def _print_advice(out: Console, advice: ThreadAdvice, topology: Topology) -> None:
    heading, why = _heading(advice), _why(advice, topology)
    out.print(tables.headed(heading, f", {why}"), soft_wrap=True)
    out.print(f"  {_simulations(advice)}", soft_wrap=True)


def describe_advice(advice: ThreadAdvice, topology: Topology) -> str:
    """Return how many threads a path should have, and why, in a sentence or two."""
    return f"{_heading(advice)}, {_why(advice, topology)}. {_simulations(advice)}"


def _heading(advice: ThreadAdvice) -> str:
    loop = "closed" if advice.closed_loop else "open"
    heading = f"{advice.path} ({loop} loop): {_threads(advice.nthread)}"
    return heading if advice.chunk is None else f"{heading}, chunk size {advice.chunk}"


def _why(advice: ThreadAdvice, topology: Topology) -> str:
    if advice.knee == 1:
        return f"as fast as any number up to {advice.most_tried}, within {100 * (1 - ENOUGH):.0f} %"
    gain = f"not compared again in fresh processes{': ' + advice.detail if advice.detail else ''}"
    if advice.speedup is not None and advice.low is not None and advice.high is not None:
        low, high = tables.factor(advice.low), tables.factor(advice.high)
        gain = f"{tables.factor(advice.speedup)}× one thread ({low} to {high} in fresh processes)"
    if advice.nthread == 1:
        return f"because {_threads(advice.knee)} seem faster, but not certainly: {gain}"
    if advice.efficiency is not None and advice.cores_had is not None:
        possible = min(advice.knee, advice.cores_had)
        gain += f", {100 * advice.efficiency:.0f} % of the {possible:.2f} cores that there were"
    if advice.chunk_speedup is not None:
        gain += f"; the chunk size another {tables.factor(advice.chunk_speedup)}×"
    if advice.knee == advice.most_tried:
        return f"{gain}; more were not tried"
    reasons = topology.beyond(advice.knee + 1)
    text = f"{gain}; more gain less than {100 * (1 - ENOUGH):.0f} %"
    return f"{text} ({'; '.join(reasons)})" if reasons else text


def _simulations(advice: ThreadAdvice) -> str:
    tried = advice.nbatch_tried
    if len(tried) == 1:
        return f"Tried with {tried[0]:,} simulations alone."
    if list(advice.good_nbatch) == list(tried):
        return f"Any number of simulations tried ({tried[0]:,} to {tried[-1]:,}) will do."
    return (
        f"It has {100 * ENOUGH:.0f} % of its best speed-up over the plain loop with"
        f" {_numbers(advice.good_nbatch)} simulations (tried: {_numbers(tried)})."
    )


def _numbers(numbers: Sequence[int]) -> str:
    return ", ".join(f"{number:,}" for number in numbers)


def _threads(count: int) -> str:
    return "one thread" if count == 1 else f"{count:,} threads"


def _s(count: int) -> str:
    return "" if count == 1 else "s"
