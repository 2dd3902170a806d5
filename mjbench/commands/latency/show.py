"""What `mjbench latency` comes to."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from mjbench import formats
from mjbench.commands.latency.measure import LatencyRow, Pace, SlowFeature, histogram_quantiles
from mjbench.formats import count_of, duration, plain
from mjbench.results import charts, content
from mjbench.results.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.results.starts import starts_lines

# Slow ticks have a feature in common if they have so many times as much of it as all ticks, and at
# least this much in every tenth of them.
_FACTOR, _LEAST = 1.2, 0.1
# What helps where slow ticks have much of a feature, by its name (see `measure.py`).
_SCHEDULER = (
    "other programs took the core, physics is not slow: end them, or give the program a core of its"
    " own and a real-time priority (taskset, chrt)"
)
_FASTER_STEPS = "`mjbench tune` looks for faster settings"
_PHYSICS = f"these steps have more to compute: {_FASTER_STEPS}"
_REMEDIES = {
    "µs of late start": _SCHEDULER,
    "preemptions": _SCHEDULER,
    "page faults": "memory was allocated in the loop: allocate it before, and write into it",
    "garbage collections": "call gc.freeze() before the loop, or gc.disable() in it",
    "contacts": _PHYSICS,
    "solver iterations": _PHYSICS,
}
# Latency is drawn at the shares of ticks that are one in so many.
_ONE_IN = np.logspace(0, 4, 41)
_PACES = {Pace.FREE.value: charts.BLUE, Pace.PACED.value: charts.ORANGE}


def sections(rows: Sequence[LatencyRow]) -> Iterator[Section]:
    for model, group in itertools.groupby(rows, lambda row: row.model):
        of_model = list(group)
        work = of_model[0].work
        if work is None:
            yield content.failure(model, of_model[0].status, of_model[0].detail)
            continue
        yield Section(
            heading=f"{model}: latency of ticks",
            conclusions=[_missed(row) for row in of_model],
            facts=[
                f"A tick is {count_of(of_model[0].tick, 'step')}; {work.contacts:.1f} contacts and"
                f" {work.solver_iterations:.1f} solver iterations a step",
                *starts_lines(of_model[0].starts),
                _resolution(of_model),
            ],
            figures=[_figure(model, of_model)],
            tables=[_table(of_model)],
            notes=[
                *(f"Slow ticks, {row.pace}: {_common(row.slow)}" for row in of_model),
                *_remedies(of_model),
            ],
        )


def _remedies(rows: Sequence[LatencyRow]) -> list[str]:
    names = dict.fromkeys(feature.name for row in rows for feature in _common_features(row.slow))
    causes: dict[str, list[str]] = {}
    for name in names:
        causes.setdefault(_REMEDIES.get(name, ""), []).append(name)
    remedies = [f"{', '.join(same)}: {remedy}" for remedy, same in causes.items() if remedy]
    if not remedies and any((row.missed or 0) > (row.ntick or 0) / 2 for row in rows):
        return [f"Most ticks take longer than the deadline: {_FASTER_STEPS}"]
    if not remedies and any(row.missed for row in rows):
        return ["`mjbench doctor` says what delays programs on this machine"]
    return remedies


def _missed(row: LatencyRow) -> Conclusion:
    assert row.deadline_s is not None, "it was measured"
    missed = row.missed or 0
    ticks = f"{missed:,} of {row.ntick:,} ticks missed {duration(1e9 * row.deadline_s)}"
    return Conclusion(f"{row.model}, {row.pace}: {ticks}", Tone.BAD if missed else Tone.GOOD)


def _resolution(rows: Sequence[LatencyRow]) -> str:
    rarest = (f"1 in {row.one_in_seen:,} ({row.pace})" for row in rows)
    return f"Misses rarer than {', '.join(rarest)} may not show: --nstep measures more ticks"


def _table(rows: Sequence[LatencyRow]) -> DataTable:
    return DataTable.of(
        "Latency",
        rows,
        (
            Column("pace"),
            lambda row: f"{row.pace} at {plain(row.rate_hz, 3)} Hz" if row.rate_hz else row.pace,
        ),
        (Column("ticks", formats.count, leaves=1), lambda row: row.ntick),
        *(
            (Column(f"p{100 * q.quantile:g}", duration), lambda row, i=i: row.quantiles[i].ns)
            for i, q in enumerate(rows[0].quantiles)
        ),
        (Column("max", duration), lambda row: row.max_ns),
        (Column("deadline", duration, leaves=2), lambda row: 1e9 * (row.deadline_s or 0.0)),
        (Column("missed", formats.count), lambda row: row.missed),
    )


def _common(features: Sequence[SlowFeature]) -> str:
    parts = [
        f"{plain(feature.slow, 2)} {feature.name} a tick instead of {plain(feature.all, 2)}"
        for feature in _common_features(features)
    ]
    return ", ".join(parts) or "nothing in common that was recorded"


def _common_features(features: Sequence[SlowFeature]) -> list[SlowFeature]:
    return [f for f in features if f.slow >= _LEAST and f.slow > _FACTOR * f.all]


def _figure(model: str, rows: Sequence[LatencyRow]) -> Figure:
    four = formats.digits(4)
    columns = (Column("one tick in", four), Column("latency, µs", four), Column("pace"))
    cells = [
        (float(one_in), ns / 1e3, str(row.pace))
        for row in rows
        for one_in, ns in zip(
            _ONE_IN, histogram_quantiles(row.histogram, (1 - 1 / _ONE_IN).tolist()), strict=True
        )
        if one_in <= (row.ntick or 0)
    ]
    data = DataTable("Latency by share of ticks", columns, cells)
    lines = {
        "x": charts.quantity("one tick in", "one tick in so many is slower", log=True),
        "y": charts.quantity("latency, µs", "latency, µs", log=True),
        "color": charts.colour("pace", _PACES),
    }
    longest = max((row.max_ns or 0.0) / 1e3 for row in rows)
    return charts.figure(
        f"{model}: latency of ticks",
        f"Lines that rise from the usual tick to the slowest, {longest:,.0f} µs.",
        data,
        [charts.layer("line", lines, interpolate="step-after")],
        height=240,
    )
