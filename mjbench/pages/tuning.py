"""The part of a report that `mjbench tune` gives."""

from collections.abc import Iterator, Sequence

from mjbench.pages import charts
from mjbench.pages.content import Cell, Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.report import tuning, tuning_accelerated, vega
from mjbench.status import Status
from mjbench.tuning import knobs
from mjbench.tuning.accelerated_records import EngineProgram, EngineTuneRecord
from mjbench.tuning.records import AttemptRow, TuneRecord
from mjbench.tuning.reference import Present
from mjbench.tuning.settings import label

_PRESENT, _TRIED, _CONFIRMED = "present settings", "tried", "confirmed"
_COLOURS = {_PRESENT: vega.GREY, _TRIED: vega.BLUE, _CONFIRMED: vega.ORANGE}


def sections(records: Sequence[TuneRecord], command: str) -> Iterator[Section]:
    """Yield a section for each model for which settings were searched."""
    for record in records:
        best = record.best()
        tone = Tone.GOOD if best is not None else Tone.NEUTRAL
        first = Conclusion(
            tuning.conclusion(record), tone if record.status == Status.OK else Tone.BAD
        )
        if record.present is None:
            yield Section(record.model, command, [first])
            continue
        yield Section(
            heading=f"{record.model}: settings",
            command=command,
            conclusions=[first],
            figures=[_front_figure(record, record.present)],
            tables=[_front_table(record, record.present), _alone_table(record)],
            notes=tuning.notes(record),
        )


def _front_figure(record: TuneRecord, present: Present) -> Figure:
    """Return time against error: what was tried from all starts, and what was confirmed."""
    columns = (
        Column("settings"),
        Column("error, % of the motion", 3),
        Column("time of a simulated second", 4),
        Column("point"),
    )
    most = max(
        (len(row.accuracy.run_errors) for row in record.attempts if row.accuracy is not None),
        default=0,
    )
    rows = [(label(()), 100 * present.error.share, 1.0, _PRESENT)]
    rows += [
        (label(row.settings), 100 * row.accuracy.error.share, row.time_ratio, _TRIED)
        for row in record.attempts
        if row.accuracy is not None
        and row.time_ratio is not None
        and len(row.accuracy.run_errors) == most  # errors of fewer runs are of another kind
    ]
    rows += [
        (label(each.settings), 100 * each.error.share, each.ratio.estimate, _CONFIRMED)
        for each in record.front
    ]
    data = DataTable("Time and error", columns, rows)
    error, time_ratio = columns[1].title, columns[2].title
    layer: vega.Spec = {
        "mark": {"type": "point", "filled": True, "size": 60, "tooltip": {"content": "data"}},
        "encoding": {
            "x": charts.quantity(time_ratio, f"{time_ratio}, present settings = 1"),
            "y": charts.quantity(error, error, log=all(row[1] > 0 for row in rows)),
            "color": charts.colour("point", _COLOURS),
        },
    }
    return Figure(
        title=f"{record.model}: time and error of settings",
        alternative=f"{len(rows)} points: the farther left, the faster; the lower, the more"
        f" accurate. {len(record.front)} are confirmed from new starts.",
        specification=charts.chart(data, [layer], height=320),
        data=data,
    )


def _front_table(record: TuneRecord, present: Present) -> DataTable:
    """Return what is recommended."""
    columns = (
        Column("settings"),
        Column("recommended"),
        Column("results"),
        Column("time of a simulated second", 4),
        Column("low", 4),
        Column("high", 4),
        Column("error, % of the motion", 3),
    )
    listed = tuning.advised(record)
    first = (label(()), "", "", 1.0, None, None, 100 * present.error.share)
    rows: list[tuple[Cell, ...]] = [first]
    rows += [
        (
            label(each.settings),
            "yes" if each in listed else "",
            each.effect.value,
            each.ratio.estimate,
            each.ratio.low,
            each.ratio.high,
            100 * each.error.share,
        )
        for each in record.front
    ]
    return DataTable("Confirmed from new starts", columns, rows)


def _alone_table(record: TuneRecord) -> DataTable:
    """Return what each setting does alone."""
    columns = (
        Column("setting alone"),
        Column("results"),
        Column("time of a simulated second", 4),
        Column("why it can help"),
        Column("what it may change"),
    )
    alone = [row for row in record.attempts if len(row.settings) == 1]
    return DataTable("Settings", columns, [_alone_row(row, record) for row in alone])


def _alone_row(row: AttemptRow, record: TuneRecord) -> tuple[str, str, float | None, str, str]:
    (setting,) = row.settings
    effect = row.accuracy.effect.value if row.accuracy is not None else row.detail
    ratio = row.ratio.estimate if row.ratio is not None else row.time_ratio
    changes = knobs.find(setting.knob).changes
    return setting.label, effect, ratio, tuning.why(setting, record), changes


def engine_sections(records: Sequence[EngineTuneRecord], command: str) -> Iterator[Section]:
    """Yield a section for each model for which settings of MJX or Warp were searched."""
    for record in records:
        tone = Tone.GOOD if record.front else Tone.NEUTRAL
        first = Conclusion(
            tuning_accelerated.conclusion(record), tone if record.status == Status.OK else Tone.BAD
        )
        if record.facts is None or record.present is None:
            yield Section(record.model, command, [first])
            continue
        yield Section(
            heading=f"{record.model}: settings of {tuning_accelerated.engine_name(record.engine)}",
            command=command,
            conclusions=[first],
            tables=[_engine_table(record, record.present)],
            notes=tuning_accelerated.notes(record, record.facts),
        )


def _engine_table(record: EngineTuneRecord, present: EngineProgram) -> DataTable:
    """Return the recommendations, and all that was tried, with times and transfer errors."""
    columns = (
        Column("settings"),
        Column("time of a batched step", 4),
        Column("low", 4),
        Column("high", 4),
        Column("transfer error, % of the motion", 3),
        Column("compile s", 3),
    )
    first = (label(()), 1.0, None, None, _percent(present), present.compile_s)
    rows: list[tuple[Cell, ...]] = [first]
    rows += [
        (
            f"{label(each.settings)} (recommended)",
            each.ratio.estimate,
            each.ratio.low,
            each.ratio.high,
            100 * each.error.share,
            each.program.compile_s,
        )
        for each in record.front
    ]
    rows += [
        (
            label(each.settings),
            each.time_ratio,
            None,
            None,
            _percent(each.program),
            each.program.compile_s,
        )
        for each in tuning_accelerated.tried(record)
        if each.program is not None
    ]
    return DataTable("Settings", columns, rows)


def _percent(program: EngineProgram) -> float | None:
    """Return a transfer error in percent of the motion."""
    return None if program.error is None else 100 * program.error.share
