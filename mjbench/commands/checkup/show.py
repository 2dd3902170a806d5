"""What a check-up comes to: one ranked list, what it rests on, and which command looks closer."""

import shlex
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mjbench import formats, paths
from mjbench.commands.checkup import ranking
from mjbench.commands.checkup.item import CheckupItem, GainGroup, GainUnit, ResultChange
from mjbench.commands.checkup.ranking import combination_gain
from mjbench.commands.checkup.result import CheckedPart, CheckupPart, Combination
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.compare import advice
from mjbench.commands.compare.results import ModelResults, derive_all
from mjbench.commands.env import show as environment
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.profile import model_costs
from mjbench.commands.profile import show as profile
from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.run import show as program
from mjbench.commands.run.result import ProgramRow
from mjbench.commands.tune import expected_gains
from mjbench.commands.tune import notes as tuning_notes
from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.result import MIN_EFFECT, Attempt, Effect, TuneRecord
from mjbench.commands.tune.settings import label
from mjbench.errors import file_argument
from mjbench.formats import count_of, listed
from mjbench.host.machine import Machine
from mjbench.interval import Interval
from mjbench.results.content import Column, Conclusion, DataTable, Section, Snippet, Tone
from mjbench.results.runs import SCHEMA, Run
from mjbench.results.starts import starts_lines
from mjbench.status import Status

# Stages of a step, and items, that are named at most.
_MOST_STAGES, _MOST_ITEMS = 3, 12
_HEADINGS = {
    CheckupPart.STEP: "Where a step's time goes",
    CheckupPart.PATHS: "Ways of stepping",
    CheckupPart.SETTINGS: "Settings",
    CheckupPart.TOGETHER: "All that changes no result, together",
    CheckupPart.PROGRAM: "The program",
    CheckupPart.SOURCE: "Its code",
    CheckupPart.ENVIRONMENT: "Where the time of env.step goes",
}
# Of items of these groups, only one can be followed.
_ALTERNATIVES = (GainGroup.PATHS, GainGroup.SETTINGS, GainGroup.PHYSICS)
_Key = TypeVar("_Key")


@dataclass(frozen=True, kw_only=True)
class CheckupDocument:
    """What `mjbench checkup --json` writes; the run file has the records of each part."""

    schema: int = SCHEMA
    machine: Machine
    parts: Sequence[CheckedPart]
    items: Sequence[CheckupItem]

    @classmethod
    def of(cls, run: Run) -> "CheckupDocument":
        return cls(
            machine=run.header.machine, parts=run.of_type(CheckedPart), items=ranking.items(run)
        )


def sections(run: Run) -> Iterator[Section]:
    if run.of_type(CheckedPart):
        yield list_section(run)
        yield from part_sections(run)


def summary(run: Run) -> list[Section]:
    """Return the list, unless nothing was measured: why is then known."""
    parts = run.of_type(CheckedPart)
    has_results = len(run.records) > len(parts) or any(part.has_ended_well for part in parts)
    return [list_section(run)] if has_results else []


def list_section(run: Run) -> Section:
    """Return the ranked list, with its conclusions and the commands that look closer."""
    parts, listed_items = run.of_type(CheckedPart), ranking.items(run)[:_MOST_ITEMS]
    name = ranking.short_name(parts[0].target) if parts else ""
    return Section(
        heading=f"{name}: what to do first",
        conclusions=[*_conclusions(run, name, listed_items)],
        tables=[_table(listed_items)],
        notes=[*_notes(run, parts, listed_items)],
        snippets=[
            Snippet(f"{number}: {item.action}", item.snippet)
            for number, item in enumerate(listed_items, 1)
            if item.snippet
        ],
        is_open=True,
    )


def part_sections(run: Run) -> Iterator[Section]:
    """Yield what parts of a check-up came to, as soon as they are measured."""
    for part in run.of_type(CheckedPart):
        if lines := [*_lines(run, part)]:
            yield Section(_HEADINGS[part.part], facts=lines)


# -- conclusions -----------------------------------------------------------------------------------


def _conclusions(run: Run, name: str, listed_items: Sequence[CheckupItem]) -> Iterator[Conclusion]:
    """Yield what comes first: what spoils figures, wrong results, then the largest gain."""
    if any(part.status == Status.INTERRUPTED for part in run.of_type(CheckedPart)):
        yield Conclusion(f"{name}: interrupted, so the list is not complete", Tone.CAUTION)
    for row in run.of_type(ProgramRow):
        if ended := program.ending(row):
            yield Conclusion(f"{name}: {ended}", Tone.BAD)
        if ended and row.has_crashed:
            return
    for each in derive_all(run.records):
        for caution in each.cautions:
            yield Conclusion(caution, Tone.CAUTION, name)
    for item in listed_items:
        if item.change == ResultChange.CORRECTED:
            yield Conclusion(f"{name}: first, what is wrong: {item.action}", Tone.BAD)
    parts = run.of_type(CheckedPart)
    failed = [part for part in parts if not part.has_ended_well]
    is_read_only = all(part.part == CheckupPart.SOURCE for part in parts)
    for part in failed:
        yield Conclusion(f"{name}: {_failure(part)}", Tone.BAD)
    gains = [item for item in listed_items if item.gain is not None]
    most = gains[0].times if gains else 1.0
    untouched = [*filter(None, map(expected_gains.untouched_stage, run.of_type(TuneRecord)))]
    for stage in untouched:
        if stage.most_gain > most:
            yield Conclusion(f"{name}: {stage.text}", Tone.UNSURE)
    rows = [row for row in run.of_type(ProgramRow) if row.loops and not row.wrong]
    if combined := _combined(run, least=_best_alone(listed_items)):
        yield Conclusion(f"{name}: {combined}", Tone.GOOD)
    elif findings := [each for each in map(program.beside_remedies, rows) if each]:
        yield from (Conclusion(f"{name}: {each}") for each in findings)
    elif gains:
        first = gains[0]
        is_same = first.change == ResultChange.NONE and not first.change_detail
        changes = "" if is_same else f"; changes in results: {first.change_text}"
        tone = Tone.GOOD if first.change.keeps else Tone.UNSURE
        yield Conclusion(f"{name}: {first.sentence}{changes}", tone)
    elif others := [each for each in listed_items if each.change != ResultChange.CORRECTED]:
        yield Conclusion(f"{name}: {others[0].action}; what it gains was not measured")
    elif not failed and not (listed_items and is_read_only):
        yield Conclusion(f"{name}: {_nothing(run)}: {_why_nothing(run)}", Tone.NEUTRAL)
    for stage in untouched:
        if stage.most_gain <= most:
            yield Conclusion(f"{name}: {stage.text}", Tone.UNSURE)


def _nothing(run: Run) -> str:
    """Return how sure it is that there is nothing to gain."""
    rows = run.of_type(ProgramRow)
    if rows and not any(row.loops for row in rows):
        return "nothing was measured"
    return "nothing to gain here" if _is_certain(run) else "no gain is certain yet"


def _failure(part: CheckedPart) -> str:
    return part.detail if part.status == Status.INPUT else f"{part.status}: {part.detail}"


def _best_alone(listed_items: Sequence[CheckupItem]) -> float:
    """Return how many times as fast the best item alone is: it keeps results or halves the work."""
    named = [each for each in listed_items if each.change.keeps or each.is_halving]
    return max((each.times for each in named), default=1)


def _combined(run: Run, least: float = 1.0) -> str:
    """Return what all that changes nothing gains together; empty unless that is at least `least`.

    It is empty, too, where it is not certain.
    """
    for part in run.of_type(CheckedPart):
        gain = combination_gain(part.verdict)
        if gain is not None and gain.estimate >= least and part.combination is not None:
            return f"{formats.as_fast(gain)} with {_described(part.combination)}, same results"
    return ""


def _described(combination: Combination) -> str:
    parts = []
    if combination.variant.path != paths.BASE:
        parts.append(advice.described(combination.variant))
    if not combination.has_timer:
        parts.append("timer off")
    if combination.settings:
        parts.append(label(combination.settings))
    return ", ".join(parts)


def _is_certain(run: Run) -> bool:
    """Return whether all that may gain something was looked at enough."""
    parts = run.of_type(CheckedPart)
    if any(part.status != Status.OK for part in parts):
        return False
    if parts[0].kind != TargetKind.MODEL:
        return True
    rows = [row for results in derive_all(run.records) for row in results.advice]
    searches = run.of_type(TuneRecord)
    is_decided = bool(rows) and all(row.is_certain for row in rows)
    return is_decided and bool(searches) and all(map(_is_decided, searches))


def _is_decided(record: TuneRecord) -> bool:
    is_open = record.untried or record.untried_combinations or record.no_second_look
    return not (is_open or record.withdrawn or any(map(_may_gain, record.attempts)))


def _may_gain(attempt: Attempt) -> bool:
    """Return whether a setting that keeps results seems faster, but not certainly."""
    if attempt.accuracy is not None and attempt.accuracy.effect == Effect.APPROXIMATE:
        return False
    ratio = attempt.ratio or (
        Interval(attempt.time_ratio, None, None) if attempt.time_ratio else None
    )
    return ratio is not None and ratio.estimate <= 1 - MIN_EFFECT and ratio.covers(1.0)


def _why_nothing(run: Run) -> str:
    reasons = []
    for steps in filter(None, (row.steps for row in run.of_type(ProfileRow))):
        share = 1.0 if steps.is_all_engine else steps.engine_ns / steps.loop_ns
        whole = formats.whole_percent(share)
        reasons.append(f"{whole} of a step is the engine ({_stages(steps)})")
    reasons += map(_why_no_path, derive_all(run.records))
    reasons += map(_why_no_setting, run.of_type(TuneRecord))
    reasons += map(program.conclusion, run.of_type(ProgramRow))
    for record in run.of_type(EnvironmentRecord):
        reasons += [_without_name(each, record) for each in environment.conclusions(record)]
    if not reasons:
        reasons.append("lint finds nothing in its code, which was not run")
    return "; ".join(filter(None, reasons))


def _why_no_path(results: ModelResults) -> str:
    rows = results.advice
    if not rows:
        return "other ways of stepping were not timed"
    if all(row.is_certain for row in rows):
        return "no other way of stepping is faster by 5 %"
    return "no other way of stepping is certainly faster"


def _why_no_setting(record: TuneRecord) -> str:
    tried = sum(len(each.settings) == 1 for each in record.attempts)
    if not tried:
        return "there was no time to try settings" if record.untried else ""
    return f"none of {count_of(tried, 'setting')} is certainly faster with the same results"


def _stages(steps: ProfiledSteps) -> str:
    """Return the longest stages, and what costs most in the first."""
    largest = sorted(steps.stages.items(), key=lambda stage: -stage[1])[:_MOST_STAGES]
    named = [f"{name} {formats.whole_percent(share)}" for name, share in largest if share]
    cost = model_costs.main_cost(steps.stages, steps.costs)
    return ", ".join(named) + (f"; {cost}" if cost is not None else "")


# -- the list --------------------------------------------------------------------------------------


def _table(listed_items: Sequence[CheckupItem]) -> DataTable:
    return DataTable.of(
        "What to do, the most important first",
        enumerate(listed_items, 1),
        (Column("", str), lambda row: row[0]),
        (Column("gain", has_figures=True), lambda row: row[1].gain_text or None),
        (Column("95 %", has_figures=True), lambda row: row[1].ends_text or None),
        (Column("what to do", wraps=True), lambda row: row[1].action),
        (Column("changes in results", wraps=True), lambda row: row[1].change_text),
    )


def _notes(
    run: Run, parts: Sequence[CheckedPart], listed_items: Sequence[CheckupItem]
) -> Iterator[str]:
    yield from _units(run, listed_items)
    for number, item in enumerate(listed_items, 1):
        if item.change == ResultChange.NONE and item.change_detail:
            yield f"{number} may change in other states: {item.change_detail}"
    yield from _overlaps(listed_items)
    for command, of_command in _numbers_by(listed_items, lambda item: item.command).items():
        yield f"Look closer at {listed(of_command)}: {command}"
    for part in parts:
        yield from _combination_lines(part, _best_alone(listed_items))
        if part.status == Status.UNAVAILABLE:
            yield f"Not done: mjbench {part.part}: {part.detail}"
    for record in run.of_type(TuneRecord):
        yield from ranking.far_settings(record, shlex.quote(file_argument(parts[0].target)))
        yield from tuning_notes.left_out(record)
    yield from dict.fromkeys(slow for item in listed_items for slow in item.slow_effects)
    is_open = not _is_certain(run) and all(item.gain is None for item in listed_items)
    if is_open and parts[0].kind == TargetKind.MODEL and run.of_type(ProfileRow):
        commands = ["compare", *("tune" for _ in run.of_type(TuneRecord))]
        target = shlex.quote(file_argument(parts[0].target))
        lines = ", ".join(f"mjbench {command} {target}" for command in commands)
        yield f"To decide what is not certain, in more time: {lines}"
    yield from _not_tried(run, parts)


def _numbers_by(
    listed_items: Sequence[CheckupItem], key: Callable[[CheckupItem], _Key | None]
) -> dict[_Key, list[str]]:
    """Return the numbers of items by what a key is; without those of which it is None."""
    numbers = defaultdict[_Key, list[str]](list)
    for number, item in enumerate(listed_items, 1):
        if (of_item := key(item)) is not None:
            numbers[of_item].append(str(number))
    return numbers


def _units(run: Run, listed_items: Sequence[CheckupItem]) -> Iterator[str]:
    """Yield what gains are multiples of."""
    numbers = _numbers_by(listed_items, lambda item: item.unit if item.gain else None)
    nbatch = max((each.model.nbatch or 1 for each in derive_all(run.records)), default=1)
    for unit, of_unit in numbers.items():
        at_once = f", {nbatch} simulations at once" if unit == GainUnit.PLAIN_LOOP else ""
        yield f"Gain of {listed(of_unit)}: {unit}{at_once}"


def _overlaps(listed_items: Sequence[CheckupItem]) -> Iterator[str]:
    """Yield which items replace each other, and that gains do not add up."""
    groups = _numbers_by(listed_items, lambda item: item.group if item.gain else None)
    for group in _ALTERNATIVES:
        if len(numbers := groups.get(group, ())) > 1:
            yield f"Use one of {listed(numbers)} ({group})"
    if sum(map(len, groups.values())) > 1:
        yield "Gains overlap: they neither add up nor multiply"


def _combination_lines(part: CheckedPart, best_alone: float) -> Iterator[str]:
    """Yield how to measure a combination again, if it gains more than the best change alone."""
    target, gain = shlex.quote(file_argument(part.target)), combination_gain(part.verdict)
    combination = part.combination
    if combination is None or gain is None or gain.estimate < best_alone:
        return
    if combination.settings:
        command = f"mjbench tune {target} --allow free"
        yield f"Add to a copy, tuned.xml, the settings that this prints: {command}"
    yield f"Look closer at all of them: {ranking.combination_command(combination, target)}"


def _not_tried(run: Run, parts: Sequence[CheckedPart]) -> Iterator[str]:
    """Yield what a check-up has no time for, with the command that tries it."""
    if not parts:
        return
    target, kind = shlex.quote(file_argument(parts[0].target)), parts[0].kind
    done = {part.part for part in parts}
    if kind == TargetKind.MODEL and run.of_type(ProfileRow):
        if CheckupPart.SETTINGS not in done:
            yield f"Settings were not tried: mjbench tune {target}"
        command = f"mjbench compare {target} --paths mjx,rollout"
        yield f"MJX and Warp, which compile first, were not tried: {command}"
    if kind == TargetKind.ENVIRONMENT and parts[0].is_quick:
        yield f"Several environments at once were not tried: mjbench env {target}"


# -- parts -----------------------------------------------------------------------------------------


def _lines(run: Run, part: CheckedPart) -> Iterator[str]:
    if part.status not in (Status.OK, Status.INTERRUPTED):
        yield _failure(part)
        return
    match part.part:
        case CheckupPart.STEP:
            yield from _step_lines(run.of_type(ProfileRow))
        case CheckupPart.PATHS:
            for results in derive_all(run.records):
                yield from map(advice.conclusion, reversed(results.advice))
                if (clock := results.clock_advice) is not None:
                    yield advice.clock_conclusion(clock)
        case CheckupPart.SETTINGS:
            for record in run.of_type(TuneRecord):
                yield tuning.conclusion(record).removeprefix(f"{part.target}: ")
        case CheckupPart.TOGETHER:
            yield from filter(None, [_combined(run)])
        case CheckupPart.PROGRAM:
            for row in run.of_type(ProgramRow):
                ended = program.ending(row)
                concluded = "" if row.has_crashed else program.conclusion(row)
                yield from filter(None, (ended, concluded))
                yield from program.end_lines(row, ", without --budget and --quick,")
        case CheckupPart.SOURCE:
            yield f"lint has {count_of(len(part.findings), 'finding')}"
        case CheckupPart.ENVIRONMENT:
            for environment_record in run.of_type(EnvironmentRecord):
                for sentence in environment.conclusions(environment_record):
                    yield _without_name(sentence, environment_record)


def _without_name(sentence: str, record: EnvironmentRecord) -> str:
    """Return a sentence about an environment without its name, and without a full stop."""
    return sentence.removeprefix(f"{record.environment}: ").removesuffix(".")


def _step_lines(rows: Sequence[ProfileRow]) -> Iterator[str]:
    for row in rows:
        if (steps := row.steps) is not None:
            first = next(profile.conclusions(row.model, steps))
            yield first.text.removeprefix(f"{row.model}: ")
            yield f"Of the engine's time: {_stages(steps)}"
            yield profile.work_line(steps)
            yield from starts_lines(steps.starts)
