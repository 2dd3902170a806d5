"""What `mjbench tune` says: which settings are recommended, what they cost, and what to paste."""

from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import quoteattr

from mjbench import formats
from mjbench.commands.tune import expected_gains, knobs
from mjbench.commands.tune.notes import in_units, notes, percent
from mjbench.commands.tune.reference import SAME_SHARE, CurrentSettings
from mjbench.commands.tune.result import (
    SAME_ERROR,
    Accuracy,
    Attempt,
    Effect,
    Recommendation,
    TuneRecord,
    fresh_ratio,
    saves_time,
)
from mjbench.commands.tune.settings import Edit, Part, Setting, edits_of, label, loop_change
from mjbench.formats import count_of, short_percent
from mjbench.interval import Interval
from mjbench.results import charts
from mjbench.results.content import Column, Conclusion, DataTable, Figure, Section, Snippet, Tone
from mjbench.simulation import engine_clock
from mjbench.status import Status

# Settings alone that are named.
_MOST_ALONE = 12
# Stages that are named as the reason of a gain.
_MOST_STAGES = 2
_PRESENT, _TRIED, _CONFIRMED = "present settings", "tried", "confirmed"
_COLOURS = {_PRESENT: charts.GREY, _TRIED: charts.BLUE, _CONFIRMED: charts.ORANGE}
_RESULTS = {
    Effect.FREE: "same (free)",
    Effect.EQUIVALENT: "within tolerance (equivalent)",
    Effect.APPROXIMATE: "differ (approximate)",
}


def rows(record: TuneRecord) -> Iterator[Mapping[str, object]]:
    """Yield what is recommended as rows of a flat table.

    `ratio` is the time of a simulated second over that of the present settings. `error`, as a share
    of the motion, is of nine runs in ten; it is None without a reference.
    """
    for each in record.front:
        yield {
            "model": record.model,
            "settings": label(each.settings),
            "effect": each.effect,
            "ratio": each.ratio,
            "error": each.error.share if each.error else None,
        }


def sections(records: Sequence[TuneRecord]) -> Iterator[Section]:
    for record in records:
        tone = Tone.GOOD if record.best() is not None else Tone.NEUTRAL
        first = Conclusion(conclusion(record), tone if record.status == Status.OK else Tone.BAD)
        present = record.present
        if present is None:
            yield Section(record.model, [first])
            continue
        yield Section(
            heading=f"{record.model}: settings",
            conclusions=[*_conclusions(record, first)],
            figures=[_front_figure(record, present)] if present.error else [],
            tables=[
                *([_front_table(record, present)] if record.front else []),
                _alone_table(record),
            ],
            notes=notes(record),
            snippets=[snippet for each in advised(record) for snippet in to_apply(each.settings)],
            shows_code=True,
        )


def _conclusions(record: TuneRecord, first: Conclusion) -> Iterator[Conclusion]:
    """Yield what to know before the first conclusion, it, and what runs are too short to show."""
    present = record.present
    if present is not None and not present.is_converged:
        yield Conclusion(
            f"The solver does not converge: it stops at its limit of iterations in"
            f" {short_percent(present.solver_limited)} of the steps. Results depend on that limit,"
            " so settings that change them are recommended only if they err no more than a solver"
            " that converges",
            Tone.UNSURE,
        )
    yield first
    settings = [one for each in advised(record) for one in each.settings]
    for text in dict.fromkeys(slow_lines(settings)):
        yield Conclusion(text, Tone.UNSURE)


def slow_lines(settings: Sequence[Setting]) -> list[str]:
    """Return what settings prevent that is slower than the runs show, in sentences."""
    return [
        f"Not shown by simulations this short: with {each.label}, {slow}"
        for each in settings
        if (slow := knobs.find(each.knob).slow)
    ]


def _front_figure(record: TuneRecord, present: CurrentSettings) -> Figure:
    """Return time against error: what was tried from all starts, and what was confirmed."""
    assert present.error is not None, "it has a reference"
    rows = [(label(()), 100 * present.error.share, 1.0, _PRESENT)]
    rows += [
        (label(row.settings), 100 * row.error.share, row.time_ratio, _TRIED)
        for row in record.attempts
        if row.error is not None and row.time_ratio is not None
    ]
    rows += [
        (label(each.settings), 100 * each.error.share, each.ratio.estimate, _CONFIRMED)
        for each in record.front
        if each.error is not None
    ]
    error, time = "error, % of the motion", "time of a simulated second"
    columns = (
        Column("settings"),
        Column(error, formats.digits(3)),
        Column(time, formats.digits(4)),
        Column("point"),
    )
    data = DataTable("Time and error", columns, rows)
    points = {
        "x": charts.quantity(time, f"{time}, present settings = 1"),
        "y": charts.quantity(error, error, log=all(row[1] > 0 for row in rows)),
        "color": charts.colour("point", _COLOURS),
    }
    return charts.figure(
        f"{record.model}: time and error of settings",
        f"{len(rows)} points: the farther left, the faster; the lower, the more accurate."
        f" Confirmed from new starts: {len(record.front)}.",
        data,
        [charts.layer("point", points, filled=True, size=60, tooltip={"content": "data"})],
        height=320,
    )


def _front_table(record: TuneRecord, present: CurrentSettings) -> DataTable:
    four_digits, listed = formats.digits(4), advised(record)
    rows = [(Recommendation((), Interval(1.0, None, None), present.error), False)]
    rows += [(each, each in listed) for each in record.front]
    return DataTable.of(
        "Recommended settings",
        rows,
        (Column("advised"), lambda row: "yes" if row[1] else None),
        (
            Column("results", wraps=True, leaves=3),
            lambda row: _result(row[0]) if row[0].settings else None,
        ),
        (Column("time of a simulated second", four_digits), lambda row: row[0].ratio.estimate),
        (Column("95 %", formats.ends_in(four_digits)), lambda row: row[0].ratio),
        (
            Column("error, % of the motion", formats.digits(3)),
            lambda row: 100 * error.share if (error := row[0].error) else None,
        ),
        (
            Column("in units", leaves=2),
            lambda row: in_units(error) if (error := row[0].error) else None,
        ),
        (
            Column("% of the motion changed", formats.digits(3), leaves=1),
            lambda row: 100 * known.distance.share if (known := row[0].accuracy) else None,
        ),
        (Column("settings"), lambda row: label(row[0].settings)),
    )


def _alone_table(record: TuneRecord) -> DataTable:
    return DataTable.of(
        "Settings that alone are certainly faster",
        faster_alone(record)[:_MOST_ALONE],
        (Column("setting alone"), lambda row: row.settings[0].label),
        (Column("results"), lambda row: _result(row.accuracy) if row.accuracy else None),
        (
            Column("time of a simulated second", formats.digits(4)),
            lambda row: row.ratio.estimate if row.ratio else row.time_ratio,
        ),
        (Column("why it helps", wraps=True, leaves=1), lambda row: why(row, record)),
        (Column("what it may change", wraps=True, leaves=2), changes),
    )


def conclusion(record: TuneRecord) -> str:
    model = record.model
    if record.status == Status.INTERRUPTED and not record.front:
        return f"{model}: interrupted before settings could be recommended"
    if record.status not in (Status.OK, Status.INTERRUPTED):
        return f"{model}: {record.status}: {record.detail}"
    parts = [
        f"{formats.factor(1 / each.ratio.estimate)} times as fast{_results(each, record)}:"
        f" {label(each.settings)}"
        for each in advised(record)
    ]
    parts += [f"{each.text}: {each.setting.label}" for each in expected_gains.unjudged(record)]
    if not parts:
        return f"{model}: no settings are certainly faster{_within(record)}"
    return f"{model}: {'; '.join(parts)}"


def advised(record: TuneRecord) -> list[Recommendation]:
    if (best := record.best()) is None:
        return []
    exact = [each for each in record.front if each.effect.rank < best.effect.rank]
    return [*(each for each in exact if each.is_allowed), best]


def _within(record: TuneRecord) -> str:
    if record.allow == Effect.FREE:
        return " with the same results"
    if record.allow == Effect.EQUIVALENT:
        return " within the solver's tolerance"
    limits = record.limits
    text = _within_shares(limits.max_error, limits.max_change)
    error = record.present.error if record.present else None
    if limits.max_error and error and error.share > limits.max_error:
        text += f"; the present settings have an error of {percent(error.share)}"
    return text


def _within_shares(error: float | None, change: float | None) -> str:
    shares = [f"an error of at most {percent(error)}"] if error is not None else []
    shares += [f"a change of at most {percent(change)}"] if change is not None else []
    return f" with {' and '.join(shares)} of the motion" if shares else " without a larger error"


def _results(each: Recommendation, record: TuneRecord) -> str:
    if each.effect == Effect.FREE:
        return " with the same results"
    if each.effect == Effect.EQUIVALENT:
        sensors = _sensors(each.accuracy)
        return f" within the solver's tolerance{f' ({sensors})' if sensors else ''}"
    assert each.error and record.present and record.present.error, (
        "the reference tells it from equivalent ones"
    )
    is_same = each.error.share <= (1 + SAME_ERROR) * record.present.error.share
    limits, change = record.limits, each.accuracy.distance.share if each.accuracy else None
    is_told = not (limits.max_error is None and (is_same or limits.max_change))
    return _within_shares(
        each.error.share if is_told else None, change if limits.max_change else None
    )


def _result(known: Recommendation | Accuracy) -> str:
    accuracy = known.accuracy if isinstance(known, Recommendation) else known
    sensors = _sensors(accuracy) if known.effect == Effect.EQUIVALENT else ""
    return f"{_RESULTS[known.effect]}; {sensors}" if sensors else _RESULTS[known.effect]


def _sensors(accuracy: Accuracy | None) -> str:
    """Return by how much sensor data differ; empty where it is no more than states may."""
    share = accuracy.sensor_share if accuracy else 0.0
    return f"sensor data differ by up to {percent(share)}" if share > SAME_SHARE else ""


def faster_alone(record: TuneRecord) -> list[Attempt]:
    """Return the settings that alone are certainly faster in fresh processes, the fastest first.

    Those that failed, or that further starts did not confirm, are not among them. Those that these
    confirmed are; others are judged so strictly that all are right together, however many were
    timed.
    """
    alone = [
        (each.ratio.estimate, each)
        for each in record.attempts
        if len(each.settings) == 1 and each.ratio and each.launches and each.status == Status.OK
    ]
    withdrawn = {label(each.settings) for each in record.withdrawn}
    confirmed = {label(each.settings) for each in record.front}
    faster = [
        (estimate, each)
        for estimate, each in alone
        if (name := label(each.settings)) not in withdrawn
        and (name in confirmed or saves_time(fresh_ratio(each.launches, count=len(alone))))
    ]
    return [each for _, each in sorted(faster, key=lambda pair: pair[0])]


def why(attempt: Attempt, record: TuneRecord) -> str:
    """Return why a setting alone is faster: what it saves by stage, and what was seen."""
    (setting,) = attempt.settings
    knob = knobs.find(setting.knob)
    parts = [setting.evidence] if setting.evidence else []
    parts += [knob.helps] if knob.helps else []
    if knob.stages:
        saved = [(stage, share) for stage, share in record.saved(attempt).items() if share > 0]
        most = [f"{100 * share:.0f} % less in {stage}" for stage, share in saved[:_MOST_STAGES]]
        parts += [", ".join(most)] if most else []
    if setting.loses:
        parts.append(f"gives up {setting.loses}")
    return "; ".join(parts)


def changes(attempt: Attempt) -> str:
    """Return what a setting alone may change, and what it prevents that runs are too short for."""
    knob = knobs.find(attempt.settings[0].knob)
    count = attempt.accuracy.changed_sensors if attempt.accuracy else 0
    sensors = [f"Here, the data of {count_of(count, 'sensor')} changed."] if count else []
    slow = [f"Not shown by simulations this short: {knob.slow}."] if knob.slow else []
    return " ".join([*sensors, knob.changes, *slow])


def to_apply(settings: Sequence[Setting]) -> Iterator[Snippet]:
    edits, name = edits_of(settings), label(settings)
    if mjcf := [*_mjcf(edits)]:
        yield Snippet(f"To apply {name}, in the model, last in <mujoco>", "\n".join(mjcf))
    loop = loop_change(settings)
    code = [engine_clock.OFF_SNIPPET] if loop.is_clock_off else []
    if loop.engine_threads:
        code.append(f"mujoco.mju_threadpool(data, {loop.engine_threads})")
    if any((edit.part, edit.name) == (Part.OPTION, "timestep") for edit in edits):
        code.append("# hold each control for fewer steps (frame_skip), so that it lasts as long")
    if code:
        yield Snippet(f"To apply {name}, in the program", "\n".join(code))


def _mjcf(edits: Sequence[Edit]) -> Iterator[str]:
    option, flags = _attributes(edits, Part.OPTION), _attributes(edits, Part.FLAG)
    if flags:
        yield f"<option{option}><flag{flags}/></option>"
    elif option:
        yield f"<option{option}/>"
    if compiler := _attributes(edits, Part.COMPILER):
        yield f"<compiler{compiler}/>"
    if meshes := _attributes(edits, Part.MESHES):
        yield f"<default><mesh{meshes}/></default>"
    if tendons := [edit.name for edit in edits if edit.part == Part.TENDON]:
        yield f"<!-- remove from <tendon>: {', '.join(tendons)} -->"
    if pairs := [edit for edit in edits if edit.part == Part.EXCLUDE]:
        yield "<contact>"
        for pair in pairs:
            bodies = (quoteattr(pair.name), quoteattr(pair.value))
            yield "  <exclude body1={} body2={}/>".format(*bodies)
        yield "</contact>"


def _attributes(edits: Sequence[Edit], part: Part) -> str:
    return "".join(f' {edit.name}="{edit.value}"' for edit in edits if edit.part == part)
