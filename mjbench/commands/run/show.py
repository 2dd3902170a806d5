"""What `mjbench run` comes to: what to do first, and where the program's time goes."""

import signal
from collections.abc import Iterator, Mapping, Sequence

from mjbench import formats
from mjbench.commands.run import costly_places, late_iterations
from mjbench.commands.run.activities import WAITING, Activity
from mjbench.commands.run.call_times import CREATORS
from mjbench.commands.run.costly_places import CostlyPlaces
from mjbench.commands.run.loop_parts import FAR_BETTER
from mjbench.commands.run.loop_time import FEW_SAMPLES, MOSTLY_PHYSICS, LineTime, LoopTime
from mjbench.commands.run.remedies import listing
from mjbench.commands.run.remedies.remedy import LEAST_GAIN, Basis, Remedy, RemedyKind
from mjbench.commands.run.result import LoopReport, ProgramRow
from mjbench.commands.run.steps_show import steps_section
from mjbench.formats import count_of, duration, plain, whole_percent
from mjbench.interval import Interval
from mjbench.results.content import Cell, Column, Conclusion, DataTable, Section, Tone, filled
from mjbench.status import Status

# Smaller shares of a loop are left out; the JSON document has all.
_LEAST_SHARE = 0.005
# Smaller errors of a share that is timed are not shown.
_LEAST_ERROR = 0.01
# Growth of memory that is worth a line.
_LEAST_GROWTH_BYTES = 32 << 20
# Activities whose shares do not come from samples, whatever calls are timed.
_TIMED = (Activity.REST, Activity.COLLECTION)
# Share of the program's time from which on loops, or a line outside them, come first.
_LEAST_LOOPS = 0.05
# Lines and remedies that are printed; the JSON document has all.
_MOST_LINES, _MOST_REMEDIES = 8, 6
_MOST_TEXT = 60
_MEASURED = (Basis.PAIRED, Basis.RERUN)
# Half the width of an interval of a share from which on it is shown.
_CLOSE = 0.05
# The last tenth of so many iterations takes so many times as long as the first: they grow.
_LEAST_GROWING, _GROWN = 200, 1.5
# A loop that waits for this share is not what the program does.
_MOSTLY_WAITING = 0.5
# A loop of which JAX compiles for this share says little about its iterations.
MOSTLY_COMPILING = 0.5


def sections(rows: Sequence[ProgramRow]) -> Iterator[Section]:
    """Yield what each program comes to: what to do first, its loops, and its steps."""
    for row in rows:
        is_bad = row.status != Status.OK or bool(row.wrong)
        ended, wrong = ending(row), list(dict.fromkeys(map(_wrong, row.wrong)))
        if ended and row.has_crashed and not wrong:
            yield Section(row.program, [Conclusion(f"{row.program}: {ended}", Tone.BAD)])
            continue
        outside = _outside(row) if row.wrong else ""
        yield Section(
            row.program,
            [
                *([Conclusion(f"{row.program}: {ended}", Tone.BAD)] if ended else ()),
                Conclusion(
                    f"{row.program}: {conclusion(row)}", Tone.BAD if is_bad else Tone.NEUTRAL
                ),
                *(Conclusion(f"{row.program}: then, {text}", Tone.BAD) for text in wrong[1:]),
                *([Conclusion(f"Outside the loops that step, {outside}.")] if outside else ()),
                *map(Conclusion, [*_waiting_lines(row), *_growth_lines(row)]),
            ],
            facts=[*end_lines(row), *_untimed_lines(row), *_memory_lines(row)],
        )
        for report in row.loops:
            yield _loop_section(row, report)
        yield from steps_section(row)


def program_rows(row: ProgramRow) -> Iterator[Mapping[str, object]]:
    """Yield the activities in the loops of a program as rows of a flat table."""
    for report in row.loops:
        time = report.time
        for activity, share in time.activities.items():
            yield {
                "program": row.program,
                "loop": where(time),
                "activity": activity,
                "share": share,
                "share_error": time.error(share),
                "seconds": share * time.seconds,
            }


def ending(row: ProgramRow) -> str:
    """Return how a program failed, in one sentence; empty where it did not, or mjbench ended it."""
    number = row.exit_code - 128
    name = signal.Signals(number).name if number in set(signal.Signals) else ""
    if row.crash is not None:
        return f"it crashed{f' ({name})' if name else ''} at {row.crash}: {row.crash.text}"
    if row.was_ended or not row.exit_code:
        return ""
    if row.exception is not None:
        place = row.exception.place
        at_place = f" at {place}: {place.text}" if place else ""
        return f"it raised {row.exception.text}{at_place}"
    return f"it was ended by {name}" if name else f"it ended with exit code {row.exit_code}"


def end_lines(row: ProgramRow, without: str = "") -> list[str]:
    """Return after what time mjbench ended a program, as a sentence; none where it did not.

    Args:
      without: names options that would end it, too.
    """
    after = f"mjbench ended {row.program} after {plain(row.wall_s, 2)} s"
    return [f"{after}: --seconds none{without} runs it to its end."] if row.was_ended else []


def conclusion(row: ProgramRow) -> str:
    """Return the most important thing about a program's time and results, in one sentence."""
    if row.wrong:
        return "first, " + _wrong(row.wrong[0])
    if row.status != Status.OK:
        return f"no samples were taken: {row.detail}"
    if not row.loops:
        return _no_loop(row)
    loop = first_loop(row)
    remedy = listing.first(loop.remedies)
    if (finding := beside_remedies(row)) is None:
        assert remedy is not None, "otherwise there is something else to say"
        return "first, " + _first(loop.time, remedy)
    is_paced = bool(late_iterations.pace(loop.time, row.steps, row.queued_s))
    if remedy is None or is_paced:
        return finding
    return f"{finding}. Then, {_first(loop.time, remedy)}"


def beside_remedies(row: ProgramRow) -> str | None:
    """Return what matters more than the first remedy of the loops; None where nothing does."""
    loop = first_loop(row)
    time, remedy = loop.time, listing.first(loop.remedies)
    gain = 0.0 if remedy is None or remedy.gain is None else remedy.gain
    costly = costly_places.costliest(time, loop.remedies)
    physics = time.activities.get(Activity.PHYSICS, 0.0)
    if outside := _outside(row):
        loops_s = sum(report.time.seconds_of_thread for report in row.loops)
        return (
            f"first, look outside the loops that step, which take {plain(loops_s, 2)} s of the"
            f" program's {plain(row.wall_s, 2)} s: {outside}"
        )
    if pace := late_iterations.pace(time, row.steps, row.queued_s):
        return f"the loop in {where(time)} {pace}"
    if physics >= MOSTLY_PHYSICS and gain < 1 - MOSTLY_PHYSICS:
        return _mostly_physics(row, time)
    is_known = time.is_half_physics and time.samples >= FEW_SAMPLES
    has_most = is_known and (costly is None or costly.share < physics)
    if remedy is not None and (costly is None or costly.share <= _taken(remedy)):
        return None
    if has_most:
        beside = "" if costly is None else f"; {costly.with_share}, no change is known for this"
        return f"{_mostly_physics(row, time)}{beside}"
    if remedy is None or costly is None:
        return _nothing_to_do(time, costly)
    return _without_remedy(time, costly)


def _taken(remedy: Remedy) -> float:
    """Return the share of what a remedy is about; of the timer, which all steps read, its gain."""
    gain = remedy.gain or 0.0
    return gain if remedy.kind == RemedyKind.CLOCK else max(gain, remedy.share or 0.0)


def _no_loop(row: ProgramRow) -> str:
    of_step = _of_step(row)
    if row.single_calls and row.single_calls[0].seconds >= _LEAST_LOOPS * row.wall_s:
        sentence = row.single_calls[0].sentence(row.wall_s)
        return f"{sentence}. {of_step[:1].upper()}{of_step[1:]}" if of_step else sentence
    but, outside = "", _outside(row)
    if row.steps and not outside:
        but = ", although it steps; run it for longer"
    elif row.was_ended and not row.steps:
        but = f" in {plain(row.wall_s, 2)} s; run it for longer"
    return "no loop was seen that steps MuJoCo" + but + (f"; {outside}" if outside else "")


def first_loop(row: ProgramRow) -> LoopReport:
    """Return the first loop; where that waits for others, the one in which most can be saved."""
    if row.loops[0].time.waiting_share < _MOSTLY_WAITING:
        return row.loops[0]

    def saved(report: LoopReport) -> float:
        remedy = listing.first(report.remedies)
        if (
            remedy is None or remedy.gain is None
        ):  # one that works is worth more than one that waits
            return -report.time.waiting_share
        return remedy.gain

    return max(row.loops, key=saved)


def _waiting_lines(row: ProgramRow) -> Iterator[str]:
    """Yield that the main process waits for others, where these are what the report is about."""
    workers = [report.time for report in row.loops if not report.time.in_main]
    pids = {pid for time in workers for pid in time.pids}
    if workers and row.loops[0] is not first_loop(row) and len(pids) > 0:
        seconds = sum(time.seconds for time in workers)
        busy = sum(time.seconds * (1 - time.waiting_share) for time in workers) / seconds
        yield (
            f"{where(row.loops[0].time)} waits for {count_of(len(pids), 'worker')}, busy for"
            f" {whole_percent(busy)} of their time: nothing to save there"
        )


def _growth_lines(row: ProgramRow) -> Iterator[str]:
    """Yield that iterations take longer and longer, unless steps of the engine do."""
    for steps in row.steps[:1]:
        each, step = steps.iteration, steps.step
        if each is None or step is None or each.count < _LEAST_GROWING:
            continue
        grown_ns, of_steps_ns = each.end_ns - each.early_ns, step.end_ns - step.early_ns
        if each.end_ns >= _GROWN * each.early_ns and grown_ns > 2 * of_steps_ns:
            yield (
                f"An iteration takes longer and longer: {duration(each.early_ns)} at the start,"
                f" {duration(each.end_ns)} at the end"
            )


def _outside(row: ProgramRow) -> str:
    """Return what takes time outside loops, where that is more than they take; "" where it is not.

    Imports and what JAX compiles are made once, however long the program runs: they count where
    loops take next to nothing.
    """
    loops = sum(report.time.seconds for report in row.loops if report.time.in_main) / row.wall_s
    has_workers = any(not report.time.in_main for report in row.loops)
    apart = (Activity.IMPORT, Activity.KERNELS, *(WAITING if has_workers else ()))
    lines = [line for line in row.outside_loops if line.main_activity not in apart]
    kernels = sum(line.activities.get(Activity.KERNELS, 0.0) for line in row.outside_loops)
    imports = [line for line in row.outside_loops if line.main_activity == Activity.IMPORT]
    import_share = sum(line.share for line in imports)
    largest = max((line.share for line in lines), default=0.0)
    is_short = loops < _LEAST_LOOPS and import_share + kernels + largest > loops
    if not is_short:
        lines = [line for line in lines if line.main_activity != Activity.COMPILING]
        largest = max((line.share for line in lines), default=0.0)
    has_kernels = kernels >= _LEAST_LOOPS and (is_short or kernels > loops)
    if not is_short and not has_kernels and (largest < _LEAST_LOOPS or largest < loops):
        return ""
    parts = [
        f"{line.place} takes {plain(line.share * row.wall_s, 2)} s ({line.place.text})"
        for line in lines[:2]
        if line.share >= LEAST_GAIN
    ]
    if has_kernels:
        parts.insert(
            0 if kernels > largest else len(parts),
            f"compiling Warp kernels: {plain(kernels * row.wall_s, 2)} s, once per machine: they"
            " are kept in Warp's cache",
        )
    if imports and (is_short or import_share > largest):
        places = ", ".join(str(line.place) for line in imports[:3])
        parts.append(f"imports take {plain(import_share * row.wall_s, 2)} s ({places})")
    return "; ".join(parts)


def _mostly_physics(row: ProgramRow, time: LoopTime) -> str:
    physics = time.activities[Activity.PHYSICS]
    of_step = f"; {each}" if (each := _of_step(row)) else ""
    shares = {line.place: line.activities.get(Activity.PHYSICS, 0.0) for line in time.lines}
    most = max(shares, key=lambda place: shares[place], default=None)
    at_line = ""
    if most is not None and LEAST_GAIN < shares[most] < physics - LEAST_GAIN:
        at_line = f", {whole_percent(shares[most])} at {most}"
    return (
        f"physics takes {whole_percent(physics)} of the loop in {where(time)}{at_line}{of_step}."
        " `mjbench tune` tries settings of the model, `mjbench compare` other ways of"
        " stepping it"
    )


def _of_step(row: ProgramRow) -> str:
    """Return which stage takes most of a step, and how often the dynamics are evaluated."""
    if row.physics is None:
        return ""
    stage, share = row.physics.main_stage
    text = f"of a step, {whole_percent(share)} is {stage}"
    if (cost := row.physics.main_cost) is not None:
        text += f", most of it {cost}"
    if row.physics.evaluations is not None and (often := row.physics.evaluations.sentence):
        text += f". {often}"
    return text


def _without_remedy(time: LoopTime, costly: CostlyPlaces) -> str:
    return f"{costly.with_share} of the loop in {where(time)}; no change is known for this"


def _nothing_to_do(time: LoopTime, costly: CostlyPlaces | None) -> str:
    if time.activities.get(Activity.COMPILING, 0.0) >= MOSTLY_COMPILING:
        seconds = time.activities[Activity.COMPILING] * time.seconds
        lines = [line for line in time.lines if Activity.COMPILING in line.activities]
        at_line = f", most at {lines[0].place}" if lines else ""
        return (
            f"JAX compiles for {plain(seconds, 2)} s of the {plain(time.seconds, 2)} s in"
            f" {where(time)}{at_line}: once for each function and each type of its arguments; if"
            " the function was called before, JAX_EXPLAIN_CACHE_MISSES=1 says which argument"
            " differs (its weak type, dtype or shape)"
        )
    physics = time.activities.get(Activity.PHYSICS, 0.0)
    if time.samples < FEW_SAMPLES:
        seconds = max(1.0, FEW_SAMPLES * time.seconds / max(1, time.samples))
        return (
            f"physics takes {whole_percent(physics)} of the loop in {where(time)}; {time.samples}"
            f" samples are too few for the rest: let it run for {plain(seconds, 2)} s or longer"
        )
    if costly is not None:
        return f"{_without_remedy(time, costly)}. Physics takes {whole_percent(physics)}"
    return (
        f"physics takes {whole_percent(physics)} of the loop in {where(time)}; no change of the"
        f" program is worth {whole_percent(LEAST_GAIN)}"
    )


def _first(time: LoopTime, remedy: Remedy) -> str:
    place = f" at {remedy.where}" if remedy.where else ""
    assert remedy.gain is not None, "wrong results come before"
    if remedy.basis == Basis.BOUND:
        share = remedy.gain if remedy.share is None else remedy.share
        return (
            f"{remedy.activity}{place}: {whole_percent(share)} of the loop in {where(time)};"
            f" {remedy.text}; that saves at most {whole_percent(remedy.gain)}"
        )
    # the timer takes a part of each step, and what a call creates is freed elsewhere
    is_part = remedy.kind == RemedyKind.CLOCK or (remedy.share or 0.0) < remedy.gain
    now = "" if is_part else f" {whole_percent(remedy.share or 0.0)} of the loop now;"
    where_to = f"at {remedy.where}, " if remedy.where else ""
    if remedy.kind == RemedyKind.COLLECTION:
        where_to += f"{remedy.activity}: "
    gain = _uncertain(remedy)
    ends = "" if gain is None else f" ({1 - (gain.high or 1):.2f} to {1 - (gain.low or 0):.2f})"
    return (
        f"{where_to}{remedy.text}:{now} with the change, the loop takes about"
        f" {1 - remedy.gain:.2f} of today's time{ends}"
    )


def _uncertain(remedy: Remedy) -> Interval | None:
    """Return the share that was measured to be saved, if its interval is wide, as of threads."""
    gain = remedy.share_saved
    if remedy.basis not in _MEASURED or gain is None or gain.low is None or gain.high is None:
        return None
    return gain if gain.high - gain.low > 2 * _CLOSE else None


def _wrong(remedy: Remedy) -> str:
    return f"correct a wrong result at {remedy.place}: {remedy.text}"


def where(time: LoopTime) -> str:
    loop = time.loop
    lines = f"{loop.first}" if loop.first == loop.last else f"{loop.first}–{loop.last}"
    return f"{loop.file}:{lines}"


def _untimed_lines(row: ProgramRow) -> list[str]:
    if not row.untimed_processes:
        return []
    of = f" of {row.untimed_processes} processes" if row.untimed_processes > 1 else ""
    return [
        f"Steps{of} were not timed: no space is left in the folder for temporary files. Set TMPDIR"
        " to another folder."
    ]


def _memory_lines(row: ProgramRow) -> list[str]:
    growth = row.memory_growth_bytes or 0
    if growth < _LEAST_GROWTH_BYTES:
        return []
    calls = [call for report in row.loops for call in report.time.calls]
    makers = [call for call in calls if call.callee in CREATORS]
    most = max(makers, key=lambda call: call.calls, default=None)
    why = f"; {most.place} makes {round(most.calls):,} × {most.callee}" if most else ""
    seconds = max((steps.span_s for steps in row.steps), default=0.0)
    rate = f" ({plain(growth / 2**20 / seconds, 2)} MiB per second)" if seconds else ""
    return [f"Memory grew by {growth / 2**20:,.0f} MiB while it stepped{rate}{why}."]


def _loop_section(row: ProgramRow, report: LoopReport) -> Section:
    time = report.time
    by = f" by {len(time.pids)} processes" if len(time.pids) > 1 else ""
    costly = costly_places.costliest(time, report.remedies)
    return Section(
        f"{row.program}: the loop in {where(time)}",
        facts=[
            f"{plain(time.seconds, 3)} s{by}, {time.samples:,} samples; the program took"
            f" {plain(row.wall_s, 3)} s",
            *([f"Not in the list below: {costly.with_share} of the loop"] if costly else ()),
        ],
        tables=filled(
            _remedies_table(report.remedies),
            _activities_table(time, row.step_error(time)),
            _lines_table("Lines of your code", "line of your code", time.lines),
            _lines_table("Functions of packages", "function of a package", time.inner_functions),
        ),
    )


def _remedies_table(remedies: Sequence[Remedy]) -> DataTable:
    return DataTable.of(
        "What to do first, and what it saves of the loop",
        enumerate(remedies[:_MOST_REMEDIES], 1),
        (Column("", str), lambda row: row[0]),
        (Column("saves", has_figures=True), lambda row: saving(row[1])),
        (Column("where"), lambda row: row[1].where or "the loop"),
        (Column("what", wraps=True), lambda row: _described(row[1])),
    )


def _described(remedy: Remedy) -> str:
    code = f" ({remedy.code})" if remedy.code else ""
    changes = "" if remedy.effect in ("", "nothing") else f"; it changes {remedy.effect}"
    return f"{subject(remedy)}{remedy.text}{code}{changes}"


def subject(remedy: Remedy) -> str:
    """Return whose time a remedy saves, before what it says; empty where lint says it."""
    return f"{remedy.activity}: " if remedy.activity is not None and not remedy.code else ""


def saving(remedy: Remedy) -> str:
    if remedy.gain is None:
        return "wrong result"
    gain = _uncertain(remedy)
    ends = "" if gain is None else formats.in_brackets(gain, whole_percent)
    return f"{'≤ ' if remedy.basis == Basis.BOUND else ''}{whole_percent(remedy.gain)}{ends}"


def _activities_table(time: LoopTime, step_error: float) -> DataTable:
    columns = (
        Column("time goes to"),
        Column("share", whole_percent),
        Column("±", has_figures=True),
        Column("", is_bar=True),
    )
    rows: list[Sequence[Cell]] = []
    for activity, share in time.activities.items():
        if share < _LEAST_SHARE:
            continue
        is_timed = time.is_timed(activity) or activity in _TIMED
        # steps are timed in bursts, which may differ: then enough samples tell better
        of_bursts = share * step_error if activity == Activity.PHYSICS else 0.0
        if time.samples >= FEW_SAMPLES and of_bursts > FAR_BETTER * time.error(share):
            of_bursts = time.error(share)
        is_exact = is_timed and of_bursts < _LEAST_ERROR
        error = whole_percent(of_bursts if is_timed else time.error(share))
        rows.append((str(activity), share, "timed" if is_exact else error, formats.bar(share)))
    return DataTable("Where the time goes", columns, rows)


def _lines_table(title: str, heading: str, lines: Sequence[LineTime]) -> DataTable:
    return DataTable.of(
        title,
        lines[:_MOST_LINES],
        (Column(heading), lambda line: str(line.place)),
        (Column("share", whole_percent), lambda line: line.share),
        (Column("mostly"), lambda line: line.main_activity.value),
        (Column("text", wraps=True), lambda line: _shortened(line.place.text)),
    )


def _shortened(text: str) -> str:
    return text if len(text) <= _MOST_TEXT else text[: _MOST_TEXT - 1] + "…"
