"""What paired comparisons come to: each verdict in a sentence, and the table of all."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mjbench import formats
from mjbench.commands.versions import family
from mjbench.commands.versions.family import Family
from mjbench.formats import count_of, duration
from mjbench.interval import Interval
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import MIN_EFFECT, Cause, ResultsOutcome, Verdict
from mjbench.paired.records import (
    CompilationFigures,
    ControlRow,
    TargetRow,
    VerdictRecord,
    VerdictRow,
)
from mjbench.paths import BASE
from mjbench.releases import named_packages
from mjbench.results import charts
from mjbench.results.content import (
    Column,
    Conclusion,
    DataTable,
    Figure,
    Section,
    Tone,
    after_disturbances,
    filled,
)
from mjbench.results.runs import Run
from mjbench.results.starts import starts_lines
from mjbench.simulation import changed_work
from mjbench.simulation.engine_warnings import warning_lines
from mjbench.status import Status

# Calls whose time changes by more than this factor within a process are noted. Without state it was
# 0.99 to 1.03, in six comparisons on a busy machine; with it, 4.0 and 4.6.
_STEADY = 1.5

_WORK = {True: "changed", False: "same"}
_TONES = {
    Verdict.SLOWER: Tone.BAD,
    Verdict.FASTER: Tone.GOOD,
    Verdict.SAME: Tone.NEUTRAL,
    Verdict.INCONCLUSIVE: Tone.UNSURE,
}
_COLOURS = {
    Verdict.FASTER.value: charts.BLUE,
    Verdict.SAME.value: charts.GREY,
    Verdict.SLOWER.value: charts.ORANGE,
    Verdict.INCONCLUSIVE.value: charts.PINK,
}
# From this factor on, a change is a factor and not a percentage.
_LARGE = 2.0
_TIMES = formats.digits(3)


def sections(run: Run) -> list[Section]:
    return after_disturbances(run, [section(verdict_rows(run), *family.rule_of(run.header))])


def verdict_rows(run: Run) -> list[VerdictRow]:
    return [record.row() for record in run.of_type(VerdictRecord)]


def section(
    rows: Sequence[VerdictRow], confidence: float, min_effect: float = MIN_EFFECT
) -> Section:
    """Return what comparisons come to, decided together (see `family.adjust_for_family`)."""
    return Section(
        heading="Verdicts",
        conclusions=[*_conclusions(rows, confidence)],
        figures=[_forest(rows, min_effect)] if any(row.ratio for row in rows) else [],
        tables=[_table(rows), *_compile_tables(rows)],
        notes=[
            *(f"{label(row)}: {line}" for row in rows for line in notes(row)),
            *_what_would_decide(rows, min_effect),
        ],
    )


def _what_would_decide(rows: Sequence[VerdictRow], min_effect: float) -> Iterator[str]:
    undecided = [row for row in rows if row.verdict == Verdict.INCONCLUSIVE]
    if not undecided:
        return
    times = [seconds for row in undecided if (seconds := _deciding_s(row, min_effect))]
    about = ""
    if times:
        about_s = 60 * math.ceil(len(rows) * max(times) / 60)  # each verdict has an equal share
        about = f" (at this noise about --budget {about_s}s)"
    yield (
        f"To decide what is inconclusive: give it more time{about}, end other programs, or accept a"
        " larger --min-effect; `mjbench doctor` says what this machine can decide"
    )


def _deciding_s(row: VerdictRow, min_effect: float) -> float | None:
    """Return in which time the interval would be as narrow as the effect; None if unknown.

    Its width falls with the square root of the time.
    """
    if row.ratio is None or not (row.ratio.low and row.ratio.high and row.seconds):
        return None
    half_width = math.log(row.ratio.high / row.ratio.low) / 2
    return row.seconds * (half_width / math.log1p(min_effect)) ** 2


def _conclusions(rows: Sequence[VerdictRow], confidence: float) -> Iterator[Conclusion]:
    tones = [_tone(row) for row in rows]
    if len(rows) > 1:
        together = describe_family(family.adjust_for_family(rows, confidence), confidence)
        yield Conclusion(together, Tone.BAD if Tone.BAD in tones else Tone.NEUTRAL)
    for row, tone in zip(rows, tones, strict=True):
        yield Conclusion(describe_verdict(row), tone)


def _tone(row: VerdictRow) -> Tone:
    if row.status == Status.NEW:
        return Tone.UNSURE
    tone = Tone.BAD if row.verdict is None else _TONES[row.verdict]
    return Tone.UNSURE if row.changed_work and tone == Tone.NEUTRAL else tone


def label(row: VerdictRow) -> str:
    name = _subject(row)
    return name if row.path in (BASE, "") else f"{name}, {row.path}"


def describe_family(decided: Family, confidence: float) -> str:
    changes = [*decided.slower, *decided.faster]
    spec = METRICS[changes[0].metric if changes else Metric.TIME]
    parts = [
        f"{outcome} in {_count_of_models(rows)}"
        for outcome, rows in (
            (spec.more, decided.slower),
            (spec.less, decided.faster),
            ("undecided", decided.undecided),
        )
    ]
    sentence = f"All {decided.count} together: {', '.join(parts)}."
    if not all(METRICS[row.metric].is_exact for row in changes):
        outcomes = {spec.more: decided.slower, spec.less: decided.faster}
        sentence += _false_alarms([word for word, rows in outcomes.items() if rows], confidence)
    return sentence


def _false_alarms(named: Sequence[str], confidence: float) -> str:
    """Return how many of the changes that are named may be wrong; empty where none is named."""
    if not named:
        return ""
    each = " each" if len(named) == 2 else ""
    return (
        f" Of those named {' and '.join(named)}, at most {100 * (1 - confidence):g} %{each} are"
        " expected to be false alarms."
    )


def _count_of_models(rows: Sequence[VerdictRow]) -> str:
    models = dict.fromkeys(row.model for row in rows)
    return f"{len(rows)} ({', '.join(models)})" if rows else "none"


def describe_verdict(row: VerdictRow) -> str:
    """Return a comparison as a sentence, such as `humanoid, 3.3.0 → 4.0.0: slower by 1.4 % …`."""
    spec = METRICS[row.metric]
    suffix = "" if spec.is_exact else spec.suffix
    name = f"{_subject(row)}{suffix}"
    outcome = f"{row.verdict}: " if row.verdict and row.ratio is None else ""
    return f"{name}: {outcome}{describe_change(row)}"


def describe_change(row: VerdictRow) -> str:
    """Return what a comparison with a ratio comes to, without its name."""
    if row.verdict is None or row.ratio is None:
        return row.detail or "not measured"
    work = _describe_results(row) or (
        f"changed work: {describe_work(row)}" if row.changed_work else _same_work(row)
    )
    detail = f"; {row.detail}" if row.detail else ""
    ratio = describe_ratio(row.metric, row.verdict, row.ratio)
    if row.timesteps_s is not None and METRICS[row.metric].is_of_steps:
        steps_s = row.timesteps_s
        ratio += f" per simulated second (timestep {steps_s.old:g} → {steps_s.new:g} s)"
    return f"{ratio}{_describe_cause(row)}, {work}{_describe_placement(row)}{detail}"


def _describe_results(row: VerdictRow) -> str:
    detail = f" ({row.results_detail})"
    return {
        None: "",
        ResultsOutcome.SAME: "same results",
        ResultsOutcome.ROUNDING: f"same results but for rounding{detail}",
        ResultsOutcome.DIFFERENT: f"other results{detail}",
        ResultsOutcome.RANDOM: "results are random, so they were not compared",
        ResultsOutcome.NONE: f"results were not compared{detail}",
    }[row.results]


def _same_work(row: VerdictRow) -> str:
    """Return that the work is the same, and where simulations drift apart nevertheless."""
    drifted = next((d for d in row.run_drift if d.difference > changed_work.ROUNDING), None)
    if drifted is None:
        return "same work"
    by = f"by {drifted.difference:.0e} after {drifted.step} steps"
    return f"same work (simulations drift apart: {by})"


def notes(row: VerdictRow) -> list[str]:
    """Return which states or code a comparison was of, and what MuJoCo warned of, a line each."""
    return [*_package_lines(row), *_starts_lines(row), *_warning_lines(row), *_revision_lines(row)]


def _package_lines(row: VerdictRow) -> list[str]:
    named = frozenset().union(*(named_packages.names_in(side.packages) for side in row.sides))
    others = [
        f"{each.name} {each.old or 'none'} → {each.new or 'none'}"
        for each in row.packages
        if each.old != each.new and each.name not in named
    ]
    return [f"other packages differ, too: {', '.join(others)}"] if others else []


def _revision_lines(row: VerdictRow) -> list[str]:
    lines = []
    if any(side.revision for side in row.sides):
        named = (f"{s.revision} is {s.commit or 'not committed'}" for s in row.sides)
        lines.append(", ".join(dict.fromkeys(named)))
    if row.calls_s is not None:
        lines.append(f"a call takes about {duration(1e9 * row.calls_s.old)} in {row.old}")
    if row.slowing is not None and max(row.slowing, 1 / row.slowing) > _STEADY:
        lines.append(
            f"calls took {formats.factor(row.slowing)} times as long at the end of a process as at"
            " its beginning: the benchmark keeps state or warms up, so the ratio depends on how"
            " often it is called"
        )
    if row.control is not None:
        lines.append(describe_control(row.control))
    return lines


def describe_control(control: ControlRow) -> str:
    text = f"control, the baseline against itself: {_change(control.ratio)}"
    if control.covers:
        return text
    return f"{text}; it should hold 0, so this machine was too noisy for this verdict"


def _change(ratio: Interval) -> str:
    interval = formats.ends(ratio, formats.change)
    certainty = f"interval {interval}" if interval else "too few launches for an interval"
    return f"{formats.change(ratio.estimate)} ({certainty})"


def _starts_lines(row: VerdictRow) -> list[str]:
    """Return which states were stepped from; of each side where they are not the same."""
    if row.candidate_starts is None:
        return starts_lines(row.starts, with_warnings=False)
    sides = (row.starts, row.candidate_starts)
    return _by_role(*(starts_lines(starts, with_warnings=False) for starts in sides))


def _warning_lines(row: VerdictRow) -> list[str]:
    """Return what MuJoCo's warnings mean for a comparison; once if both targets have the same."""
    if row.warnings is None:
        return []
    baseline, candidate = map(warning_lines, (row.warnings.old, row.warnings.new))
    return baseline if baseline == candidate else _by_role(baseline, candidate)


def _by_role(baseline: Sequence[str], candidate: Sequence[str]) -> list[str]:
    lines = {"baseline": baseline, "candidate": candidate}
    return [f"{role}: {line}" for role, of_role in lines.items() for line in of_role]


def _subject(row: VerdictRow) -> str:
    """Return what was compared: the model, unless each side names its own, and both sides."""
    has_one_model = len({side.model for side in row.sides}) == 1
    return f"{row.model}, {describe_targets(row)}" if has_one_model else describe_targets(row)


def describe_targets(row: VerdictRow) -> str:
    baseline, candidate = (_settings(target) for target in row.sides)
    keys = [k for k in {**baseline, **candidate} if baseline.get(k) != candidate.get(k)]
    if keys in (["release"], ["rev"], ["packages"], []):
        return f"{row.old} → {row.new}"
    if keys == ["model"]:
        return " → ".join(side.model for side in row.sides)
    return " → ".join(
        " ".join(f"{key}={settings[key]}" for key in keys if key in settings) or "default"
        for settings in (baseline, candidate)
    )


def describe_work(row: VerdictRow) -> str:
    """Return how the work changed, such as `contacts 1 → 5`; empty where it did not."""
    if row.work is None or row.diverged is None:
        return ""
    return ", ".join(
        changed_work.work_changes(
            row.work.old, row.work.new, row.drift, (row.diverged.old, row.diverged.new)
        )
    )


def _describe_cause(row: VerdictRow) -> str:
    is_different = row.verdict in (Verdict.FASTER, Verdict.SLOWER)
    if row.cause == Cause.CODE:
        return " because of its code"
    if row.cause == Cause.UNDECIDED and is_different:
        return " because of its code or of where that lies in memory"
    return ""


def _describe_placement(row: VerdictRow) -> str:
    placement = row.placement
    if placement is None:
        return ""
    if placement.problem:
        return f"; compared as shipped: {placement.problem}"
    if placement.effect is None:
        return ""
    return f"; the placement of these builds adds {_change(placement.effect)}"


def _settings(target: TargetRow) -> Mapping[str, Any]:
    return {
        **({"rev": target.revision} if target.revision else {}),
        **({"packages": target.packages} if target.packages else {"release": target.release}),
        "model": target.model,
        "path": target.path,
        **target.options,
        **target.model_options,
        **({} if target.has_timer else {"timer": "off"}),
    }


def _table(rows: Sequence[VerdictRow]) -> DataTable:
    names, digits = formats.short_names([row.model for row in rows]), formats.decimals(4)
    return DataTable.of(
        "Verdicts",
        rows,
        (Column("model"), lambda row: names[row.model]),
        (Column("old → new", wraps=True), describe_targets),
        (Column("new / old", digits), lambda row: row.ratio.estimate if row.ratio else None),
        (Column("interval", formats.ends_in(digits)), lambda row: row.ratio),
        (Column("verdict"), _outcome),
        (Column("cause", leaves=6), lambda row: row.cause.value if row.cause else None),
        (Column("placement", formats.change, leaves=4), _added_by_placement),
        (
            Column("work", leaves=5),
            lambda row: None if row.changed_work is None else _WORK[row.changed_work],
        ),
        (Column("drift", lambda drift: f"{drift:.1g}", leaves=1), lambda row: row.drift),
        (Column("launches", formats.count, leaves=3), lambda row: row.launches),
        (Column("seconds", formats.tenths, leaves=2), lambda row: row.seconds),
    )


def _compile_tables(rows: Sequence[VerdictRow]) -> list[DataTable]:
    """Return one table of all comparisons whose runs are compiled first; none without any."""
    sides = [
        (row.model, label, figures)
        for row in rows
        if (both := row.compiling) is not None
        for label, figures in ((row.old, both.old), (row.new, both.new))
    ]
    table = DataTable.of(
        "Compiling",
        sides,
        (Column("model", leaves=2), lambda side: side[0]),
        (Column("environment", wraps=True), lambda side: side[1]),
        (Column("trace"), lambda side: _time(side[2].trace_s, side[2].processes)),
        (Column("compile"), lambda side: _compile_time(side[2])),
        (Column("first run"), lambda side: _time(side[2].first_run_s, side[2].processes)),
        (Column("steady run"), lambda side: _time(side[2].steady_run_s, side[2].processes)),
        (Column("programs", formats.count, leaves=1), lambda side: side[2].programs),
    )
    return filled(table)


def _compile_time(figures: CompilationFigures) -> str:
    """Return the time without a cache; an earlier comparison of the run may have filled that."""
    return _time(figures.compile_s, figures.compiling_processes) or "from the cache"


def _time(seconds: Interval | None, processes: int) -> str:
    """Return a median with its interval, or of how many processes it is."""
    if seconds is None:
        return ""
    interval = formats.in_brackets(seconds, lambda end: duration(1e9 * end))
    count = "one process" if processes == 1 else f"{processes} processes"
    return f"{duration(1e9 * seconds.estimate)}{interval or f' ({count})'}"


def _outcome(row: VerdictRow) -> str:
    return METRICS[row.metric].outcome(row.verdict) if row.verdict else row.status.value


def _added_by_placement(row: VerdictRow) -> float | None:
    effect = row.placement.effect if row.placement else None
    return effect.estimate if effect else None


def _percent(ratio: float | None) -> float | None:
    return None if ratio is None else 100 * (ratio - 1)


def _forest(rows: Sequence[VerdictRow], min_effect: float) -> Figure:
    percent = 100 * min_effect
    data = DataTable.of(
        "Changes in percent",
        [(row, row.ratio) for row in rows if row.ratio is not None],
        (Column("comparison"), lambda row: label(row[0])),
        (Column("change", formats.digits(3)), lambda row: _percent(row[1].estimate)),
        (Column("low", formats.digits(3)), lambda row: _percent(row[1].low)),
        (Column("high", formats.digits(3)), lambda row: _percent(row[1].high)),
        (Column("verdict"), lambda row: (row[0].verdict or Verdict.INCONCLUSIVE).value),
        (Column("cause", leaves=6), lambda row: row[0].cause.value if row[0].cause else ""),
    )
    title = "change, % (above 0 is slower)"
    shared = {"y": charts.names(data), "color": charts.colour("verdict", _COLOURS, "verdict")}
    counts = Counter(row[4] for row in data.rows)
    summary = ", ".join(f"{counts[verdict]} {verdict}" for verdict in _COLOURS if counts[verdict])
    return charts.figure(
        "Changes with their intervals",
        f"{count_of(len(data.rows), 'comparison')}: {summary}. Dashed: no change, and changes of"
        f" {percent:g} %, the smallest that matter.",
        data,
        [
            *(charts.rule_at(value) for value in (-percent, 0.0, percent)),
            *charts.estimates("change", title, shared, "isValid(datum.low) && isValid(datum.high)"),
        ],
    )


def describe_ratio(metric: Metric, verdict: Verdict, ratio: Interval) -> str:
    """Return a verdict with its ratio, such as `slower by 1.4 % (interval +1.1 to +1.7 %)`."""
    spec = METRICS[metric]
    if verdict == Verdict.SAME:
        ends = [end for end in (ratio.low, ratio.high) if end is not None]
        return f"same within {formats.short_percent(max(abs(end - 1) for end in ends))}"
    if verdict == Verdict.INCONCLUSIVE:
        interval = formats.ends(ratio, formats.change) or "unknown"
        return f"inconclusive, {formats.change(ratio.estimate)} (interval {interval})"
    if not spec.is_of_memory and ratio.low is not None and ratio.high is not None:
        if verdict == Verdict.FASTER and ratio.estimate <= 1 / _LARGE:
            interval = formats.ends(ratio.inverse, _TIMES)
            return f"faster, {_TIMES(1 / ratio.estimate)} times as fast (interval {interval})"
        if verdict == Verdict.SLOWER and ratio.estimate >= _LARGE:
            interval = formats.ends(ratio, _TIMES)
            return f"slower, takes {_TIMES(ratio.estimate)} times as long (interval {interval})"
    size = formats.short_percent(abs(ratio.estimate - 1))
    interval = formats.ends(ratio, formats.change) or "unknown"
    is_point = ratio.low is not None and ratio.low == ratio.high  # without any noise
    return f"{spec.outcome(verdict)} by {size}" + ("" if is_point else f" (interval {interval})")
