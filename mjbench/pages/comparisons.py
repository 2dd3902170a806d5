"""The part of a report that a run of `mjbench compare` gives."""

from collections.abc import Iterator, Mapping, Sequence

from mjbench.comparison.plan import Variant
from mjbench.comparison.records import ModelRecord
from mjbench.pages import charts
from mjbench.pages.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.paired.race_record import Loop
from mjbench.paths import BASE
from mjbench.report import comparison, conclusions, tables, vega
from mjbench.report.advice import Advice, advise, advise_clock
from mjbench.report.crossovers import crossovers, describe_crossover
from mjbench.report.results import ModelResults, PathResult
from mjbench.report.thread_advice import advise_threads
from mjbench.report.work_crossovers import describe_work_crossover, work_crossovers
from mjbench.status import Status

# Colours of paths by whether a policy can choose each control.
_LOOPS = {Loop.OPEN.value: vega.ORANGE, Loop.CLOSED.value: vega.BLUE}
# A speed-up, and the ends of its interval.
_SPEEDUPS = tuple(Column(title, 3, is_factor=True) for title in ("speed-up", "low", "high"))


def _conclusions(model_results: ModelResults) -> Iterator[Conclusion]:
    """Yield what the comparison on a model comes to.

    What to know before the numbers comes first, then what went wrong, then advice.
    """
    record = model_results.model
    for text in conclusions.cautions(model_results):
        name = "" if text == conclusions.FORMER else f"{_name(record)}: "
        yield Conclusion(f"{name}{text}", Tone.CAUTION)
    if record.status not in (Status.OK, Status.INTERRUPTED):
        yield Conclusion(f"{record.model}: {record.status}: {record.detail}", Tone.BAD)
    for result in model_results.results:
        if result.status == Status.DISAGREES:
            text = f"{result.model}: {result.variant} does other work than the plain loop"
            yield Conclusion(f"{text}: {result.agreement}", Tone.BAD)
    for advice in advise(model_results):
        yield _conclusion(advice)
    clock = advise_clock(model_results)
    if clock is not None:
        begin, rest = conclusions.clock_conclusion(clock)
        yield Conclusion(f"{_name(record)}: {begin}{rest}", Tone.GOOD)
    for row in advise_threads(model_results):
        begin, rest = conclusions.thread_conclusion(row)
        tone = Tone.GOOD if row.is_certain else Tone.UNSURE
        yield Conclusion(f"{_name(record)}: {begin}{rest}", tone)


def _conclusion(advice: Advice) -> Conclusion:
    begin, rest = conclusions.conclusion(advice)
    tone = Tone.GOOD if advice.speedup is not None else Tone.NEUTRAL
    return Conclusion(
        f"{_sized(advice.model, advice.nbatch)}: {begin}{rest}",
        tone if advice.is_certain else Tone.UNSURE,
    )


def _name(record: ModelRecord) -> str:
    return _sized(record.model, record.nbatch)


def _sized(model: str, nbatch: int | None) -> str:
    """Return the name of a model with its simulations, where there were any."""
    return f"{model}, {tables.count_of(nbatch, 'simulation')}" if nbatch else model


def sections(models: Sequence[ModelResults], command: str) -> Iterator[Section]:
    """Yield a section for each model at each size, and one for crossovers where there are any."""
    for model_results in models:
        yield _section(model_results, command)
    results = [result for model in models for result in model.results]
    if rows := crossovers(results):
        yield _crossover_section(
            "From how many simulations on is an accelerated path faster?",
            {describe_crossover(row): row.model for row in rows},
            models,
            command,
        )
    if work_rows := work_crossovers(results):
        yield _crossover_section(
            "From how much work per call on is Ray faster?",
            {describe_work_crossover(row): row.model for row in work_rows},
            models,
            command,
        )


def _section(model_results: ModelResults, command: str) -> Section:
    record = model_results.model
    notes = [str(comparison.heading(record)), *comparison.detail_lines(record)]
    table = _path_table(model_results)
    timed = [r for r in model_results.results if r.speedup is not None]
    return Section(
        heading=_name(record),
        command=command,
        conclusions=[*_conclusions(model_results)],
        figures=[_speedup_figure(model_results, timed)] if timed else [],
        tables=[table],
        notes=[*notes, *map(str, comparison.notes(model_results))],
    )


def _path_table(model_results: ModelResults) -> DataTable:
    columns = (
        Column("advised"),
        Column("path"),
        Column("ns/step", 4),
        *_SPEEDUPS,
        Column("× real time", 3),
        Column("loop"),
        Column("agrees"),
        Column("launches", 3),
        Column("why not"),
    )
    marks = comparison.marks(model_results)
    rows = [
        (
            marks.get(str(r.variant), ""),
            str(r.variant),
            r.step_ns,
            *_ends(r),
            r.realtime_factor,
            (Loop.CLOSED if r.closed_loop else Loop.OPEN).value,
            comparison.agrees(r),
            r.launches or None,
            r.detail,
        )
        for r in model_results.results
    ]
    return DataTable("Paths", columns, rows)


def _ends(result: PathResult) -> tuple[float | None, float | None, float | None]:
    """Return a path's speed-up, and the ends of its interval."""
    speedup = result.speedup
    if speedup is None:
        return None, None, None
    if result.variant == Variant(BASE, {}):  # 1 by definition
        return speedup.estimate, None, None
    return speedup.estimate, speedup.low, speedup.high


def _speedup_figure(model_results: ModelResults, timed: Sequence[PathResult]) -> Figure:
    """Return speed-ups as bars, with their intervals as lines."""
    model = model_results.model.model
    columns = (
        Column("path"),
        *_SPEEDUPS,
        Column("loop"),
    )
    rows = [
        (str(r.variant), *_ends(r), (Loop.CLOSED if r.closed_loop else Loop.OPEN).value)
        for r in timed
    ]
    data = DataTable("Speed-ups", columns, rows)
    fastest = max(rows, key=lambda row: float(row[1] or 0.0))
    x = charts.quantity("speed-up", "times as fast as the plain loop", zero=True)
    y = charts.names("path", labels=[row[0] for row in rows])
    layers: list[vega.Spec] = [
        charts.rule_at(1.0),
        {
            "mark": {"type": "bar", "height": 10},
            "encoding": {"x": x, "y": y, "color": charts.colour("loop", _LOOPS, "loop")},
        },
    ]
    intervals = ""
    if any(row[2] is not None for row in rows):
        intervals = " Lines are 95 % intervals."
        layers.append(
            {
                "mark": {"type": "rule", "strokeWidth": 2, "color": "currentColor"},
                "transform": [{"filter": "isValid(datum.low)"}],
                "encoding": {
                    "x": charts.quantity("low", "times as fast as the plain loop", zero=True),
                    "x2": {"field": "high"},
                    "y": y,
                },
            }
        )
    return Figure(
        title=f"{model}: speed-up over the plain loop",
        alternative=f"Bars of {len(rows)} paths; the longest is {fastest[0]}, {fastest[1]:.2f}×."
        f"{intervals}",
        specification=charts.chart(data, layers),
        data=data,
    )


def _crossover_section(
    heading: str, model_of: Mapping[str, str], models: Sequence[ModelResults], command: str
) -> Section:
    """Return a section of conclusions, each with its model, and a figure of each model."""
    return Section(
        heading=heading,
        command=command,
        conclusions=[Conclusion(text) for text in model_of],
        figures=[_crossover_figure(name, models) for name in dict.fromkeys(model_of.values())],
    )


def _crossover_figure(name: str, models: Sequence[ModelResults]) -> Figure:
    columns = (Column("simulations", 4), Column("steps per second", 4), Column("path"))
    rows = [
        (r.nbatch, r.steps_per_s, str(r.variant))
        for model_results in models
        if model_results.model.model == name
        for r in model_results.results
        if r.steps_per_s and r.nbatch
    ]
    data = DataTable("Speeds by the number of simulations", columns, rows)
    palette = (vega.BLUE, vega.ORANGE, vega.GREEN, vega.SKY, vega.PINK, vega.GREY)
    paths = list(dict.fromkeys(row[2] for row in rows))
    colours = {path: palette[i % len(palette)] for i, path in enumerate(paths)}
    layer: vega.Spec = {
        "mark": {"type": "line", "point": True},
        "encoding": {
            "x": charts.quantity("simulations", "simulations", log=True),
            "y": charts.quantity("steps per second", "steps per second", log=True),
            "color": charts.colour("path", colours),
        },
    }
    return Figure(
        title=f"{name}: speed by the number of simulations",
        alternative=f"Lines of {len(paths)} paths over {len({row[0] for row in rows})} sizes.",
        specification=charts.chart(data, [layer], height=260),
        data=data,
    )
