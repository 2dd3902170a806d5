"""What `mjbench compare --scaling` says: how many threads, which chunk size, how many simulations.

Rows and advice follow from the records of a search (`comparison.scaling`); the functions that print
come last.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mjbench import paths
from mjbench.comparison import scaling
from mjbench.comparison.plan import Variant
from mjbench.comparison.scaling import ENOUGH, ScalingPoint, ScalingRecord, Stage
from mjbench.instrument.stats import Estimate
from mjbench.instrument.topology import Beyond, Topology
from mjbench.paired.confirmation import MIN_EFFECT, ComparedSizes, ConfirmationRecord
from mjbench.report import comparison, tables
from mjbench.report.advice import Pairing
from mjbench.status import Status


@dataclass(frozen=True, kw_only=True)
class ScalingRow:
    """One path with its threads and chunk size, with one number of simulations.

    Attributes:
      model: its name.
      stage: what the run varied.
      path: the way of stepping.
      options: of the path.
      nthread: threads or worker processes.
      chunk: simulations that a thread takes at a time; None for the path's own.
      nbatch: simulations.
      nstep: steps of each.
      step_ns: nanoseconds of one step of one simulation, the median of the blocks.
      speedup: over the plain loop, in this process.
      over_one: over one thread of the same path, likewise; None where that was not timed.
      over_usual: over the path's own chunk size, likewise; None where that was not timed.
      cores_had: cores that threads got in this run; None without a calibration.
      efficiency: `over_one` as a share of the cores that so many threads can have had.
      beyond: what so many threads exceed.
    """

    model: str
    stage: Stage
    path: str
    options: Mapping[str, Any]
    nthread: int
    chunk: int | None
    nbatch: int
    nstep: int
    step_ns: float
    speedup: float
    over_one: float | None
    over_usual: float | None
    cores_had: float | None
    efficiency: float | None
    beyond: Sequence[Beyond]


@dataclass(frozen=True, kw_only=True)
class ThreadAdvice:
    """How many threads a path should have on a model.

    Attributes:
      model: its name.
      path: the way of stepping.
      options: of the path, with the threads and the chunk size to use.
      closed_loop: whether a policy can choose each control from the state before it.
      nthread: the smallest number of threads that is about as fast as any, and certainly faster
        than one; otherwise 1.
      knee: the smallest number of threads that reached 95 % of the best speed-up in the search.
      most_tried: the largest number of threads that was tried.
      nbatch: simulations with which threads were tried.
      speedup: of `knee` threads over one, in fresh processes; None where that was not measured.
      low: lower end of its 95 % interval.
      high: upper end.
      efficiency: of `knee` threads, in the search.
      cores_had: cores that threads got; None without a calibration.
      chunk: the chunk size that is certainly faster than the path's own; None without one.
      chunk_speedup: its speed-up, in fresh processes; None without one.
      enough_nbatch: the smallest number of simulations that reaches 95 % of the best speed.
      nbatch_tried: the numbers of simulations that were tried, from the smallest on.
      snippet: Python that does what the path does.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    closed_loop: bool
    nthread: int
    knee: int
    most_tried: int
    nbatch: int
    speedup: float | None
    low: float | None
    high: float | None
    efficiency: float | None
    cores_had: float | None
    chunk: int | None
    chunk_speedup: float | None
    enough_nbatch: int
    nbatch_tried: Sequence[int]
    snippet: str


@dataclass(frozen=True)
class ScalingResults:
    """The records of a search on one model.

    Attributes:
      records: of its runs.
      confirmations: comparisons of two variants in fresh processes.
    """

    records: tuple[ScalingRecord, ...]
    confirmations: tuple[ConfirmationRecord, ...] = ()

    @property
    def topology(self) -> Topology:
        """The cores that the search could use."""
        return self.records[0].topology

    @property
    def points(self) -> list[ScalingPoint]:
        """What the runs say of each variant that was timed."""
        return [point for record in self.records for point in scaling.points(record)]

    @property
    def compared_sizes(self) -> ComparedSizes:
        """The sizes with which threads were tried; needs a point."""
        point = self.points[0]
        return ComparedSizes(point.nbatch, point.nstep, point.step_s * point.speedup.median)

    def rows(self) -> list[ScalingRow]:
        """Return a row for each variant that was timed."""
        model = self.records[0].model.model
        return [
            ScalingRow(
                model=model,
                stage=point.stage,
                path=point.variant.path,
                options=point.variant.options,
                nthread=point.nthread,
                chunk=point.chunk,
                nbatch=point.nbatch,
                nstep=point.nstep,
                step_ns=1e9 * point.step_s,
                speedup=point.speedup.median,
                over_one=_median(point.over_one),
                over_usual=_median(point.over_usual),
                cores_had=point.cores_had,
                efficiency=point.efficiency,
                beyond=self.topology.beyond(point.nthread),
            )
            for point in self.points
        ]

    def advice(self) -> list[ThreadAdvice]:
        """Return the advice on each path that was timed."""
        knees = scaling.knees(self.points)
        return [self._advice(name, count) for name, count in knees.items()]

    def pairings(self) -> list[Pairing]:
        """Return the comparisons in fresh processes that the advice still needs."""
        needed = []
        for name, count in scaling.knees(self.points).items():
            own = [point for point in self.points if point.variant.path == name]
            one, many = _last(own, 1), _last(own, count)
            if many is not one:
                needed.append(Pairing(one.variant, many.variant))
            if chunked := _best_chunk(own):
                needed.append(Pairing(many.variant, chunked.variant))
        return [p for p in needed if self._confirmation(p.baseline, p.candidate) is None]

    def _advice(self, name: str, count: int) -> ThreadAdvice:
        own = [point for point in self.points if point.variant.path == name]
        one, many, chunked = _last(own, 1), _last(own, count), _best_chunk(own)
        confirmation = self._confirmation(one.variant, many.variant)
        ratio = confirmation.ratio if confirmation and confirmation.status == Status.OK else None
        is_certain = ratio is not None and ratio.high is not None and ratio.high < 1.0
        chosen = many if is_certain else one
        chunk_speedup = None
        if chunked is not None and is_certain:
            chunk_speedup = self._chunk_speedup(many, chunked)
            chosen = chunked if chunk_speedup else chosen
        speed_by_nbatch = {
            point.nbatch: point.speedup.median
            for point in own
            if point.nthread == count and point.chunk is None
        }
        return ThreadAdvice(
            model=self.records[0].model.model,
            path=name,
            options=chosen.variant.options,
            closed_loop=paths.find(name).closed_loop,
            nthread=chosen.nthread,
            knee=count,
            most_tried=max(point.nthread for point in own),
            nbatch=many.nbatch,
            speedup=1 / ratio.estimate if ratio else None,
            low=1 / ratio.high if ratio and ratio.high else None,
            high=1 / ratio.low if ratio and ratio.low else None,
            efficiency=many.efficiency,
            cores_had=many.cores_had,
            chunk=chosen.chunk,
            chunk_speedup=chunk_speedup,
            enough_nbatch=scaling.knee(speed_by_nbatch),
            nbatch_tried=sorted(speed_by_nbatch),
            snippet=self._snippet(chosen.variant),
        )

    def _chunk_speedup(self, usual: ScalingPoint, chunked: ScalingPoint) -> float | None:
        """Return how much faster a chunk size certainly is than the path's own; None if not."""
        confirmation = self._confirmation(usual.variant, chunked.variant)
        ratio = confirmation.ratio if confirmation else None
        if ratio is None or ratio.high is None or ratio.high >= 1.0:
            return None
        return 1 / ratio.estimate if ratio.estimate <= 1 / (1 + MIN_EFFECT) else None

    def _confirmation(self, baseline: Variant, candidate: Variant) -> ConfirmationRecord | None:
        for record in self.confirmations:
            sides = (
                Variant(record.baseline, record.baseline_options),
                Variant(record.candidate, record.candidate_options),
            )
            if sides == (baseline, candidate):
                return record
        return None

    def _snippet(self, variant: Variant) -> str:
        for record in self.records:
            for measurement in record.measurements:
                if Variant(measurement.path, measurement.options) == variant:
                    return measurement.snippet
        return ""


def by_model(
    records: Sequence[ScalingRecord], confirmations: Sequence[ConfirmationRecord]
) -> list[ScalingResults]:
    """Return the results of each model, in the order they were measured."""
    names = dict.fromkeys(record.model.model for record in records)
    return [
        ScalingResults(
            tuple(record for record in records if record.model.model == name),
            tuple(record for record in confirmations if record.model == name),
        )
        for name in names
    ]


def _last(own: Sequence[ScalingPoint], count: int) -> ScalingPoint:
    """Return the last point of a number of threads in the stage that varies them."""
    return [p for p in own if p.stage == Stage.THREADS and p.nthread == count][-1]


def _best_chunk(own: Sequence[ScalingPoint]) -> ScalingPoint | None:
    """Return the fastest chunk size, where it seems certainly faster than the path's own."""
    tried = [p for p in own if p.stage == Stage.CHUNK and p.chunk is not None and p.over_usual]
    best = max(tried, key=lambda p: p.speedup.median, default=None)
    if best is None or best.over_usual is None or best.over_usual.low is None:
        return None
    is_faster = best.over_usual.low > 1.0 and best.over_usual.median >= 1 + MIN_EFFECT
    return best if is_faster else None


def print_results(out: Console, results: ScalingResults, code: bool = False) -> None:
    """Print the search on one model: tables of each path, what hindered it, and the advice.

    Args:
      out: where to.
      results: of the model.
      code: whether to print the Python of what is advised.
    """
    out.print()
    for line in comparison.heading_lines(results.records[0].model):
        out.print(line, soft_wrap=True)
    advice = results.advice()
    if advice:
        out.print(_topology_line(results.topology), soft_wrap=True)
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


def _median(estimate: Estimate | None) -> float | None:
    return None if estimate is None else estimate.median


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
        usable = min(
            results.topology.hardware_threads,
            max((p.nthread for p in scaling.points(record)), default=1),
        )
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
    gain = "not compared again in fresh processes"
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
    range_text = f"{tried[0]:,} to {tried[-1]:,}"
    if advice.enough_nbatch == tried[0]:
        return f"Any number of simulations tried ({range_text}) will do."
    return (
        f"From {advice.enough_nbatch:,} simulations on it has {100 * ENOUGH:.0f} % of its best"
        f" speed-up over the plain loop (tried: {range_text})."
    )


def _threads(count: int) -> str:
    return "one thread" if count == 1 else f"{count:,} threads"


def _s(count: int) -> str:
    return "" if count == 1 else "s"
